"""Types of the values of experiment files: names, lists of them, and what is wrong with others."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterable
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo

from algorithms.registry import ALGORITHMS
from benchmark.experiment.loggers import LOGGERS
from benchmark.scripted import SCRIPTED_POLICIES
from smarts.config import UnfitError
from smarts.errors import SmartsError, nearest_names
from smarts.registry import is_own_name
from smarts.sstudio.locating import resolved, suite
from smarts.types.actions import ActionSpaceType
from smarts.types.traffic import TRAFFIC_ENGINES

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
ACTION_NAMES = tuple(kind.name for kind in ActionSpaceType if kind != ActionSpaceType.Empty)

KEPT = "kept"
"""Context of values that were checked before and kept with results: their scenarios may be gone."""

Positive = Annotated[int, Field(ge=1)]
# Sequences are written as lists, and kept as tuples, since nothing of a config changes.
SEVERAL = Field(min_length=1, strict=False)


def _name(text: str) -> str:
    if not NAME.fullmatch(text):
        letters = "use letters, digits, '.', '_' and '-'"
        remedy = "give {name: ..., scenarios: [...]}" if glob.has_magic(text) else letters
        raise UnfitError(f"{text!r} cannot name a folder", remedy)
    return text


def _named(kind: str, known: Iterable[str], *, own: bool = True) -> AfterValidator:
    """Return a check that a name is registered or, with `own`, a `module:Class`, which is imported later."""

    def check(name: str) -> str:
        if name not in [*known] and not (own and is_own_name(name)):
            raise UnfitError(f"there is no {kind} {name!r}", nearest_names(name, known))
        return name

    return AfterValidator(check)


def _metric(name: str) -> str:
    if is_own_name(name):
        return name
    from benchmark.metrics.registry import METRICS  # here: loads pandas, and most files choose none

    if name not in METRICS:
        raise UnfitError(f"there is no metric {name!r}", nearest_names(name, METRICS))
    return name


def _scenario(name: str, info: ValidationInfo) -> str:
    if info.context == KEPT:
        return name
    folder, _, variation = name.partition("@")
    is_there = folder and (folder in suite() or Path(folder).exists())
    if is_there and glob.has_magic(variation):
        from smarts.sstudio.build import matching

        found = (each.partition("@")[2] for each in matching(f"{folder}@*"))
        splits = {re.sub(r"-\d+$", "-*", each) for each in found if each != "*"}
        raise UnfitError(f"no variation of {folder!r} fits {variation!r}", nearest_names(variation, splits))
    if not is_there:
        raise UnfitError(
            f"there is no scenario {name!r}, neither in the suite nor as a folder here",
            nearest_names(folder, suite()),
        )
    return resolved(name)


def _matched(given: Any) -> Any:
    """Return a list of names with each pattern replaced by the scenarios that it stands for."""
    names = given if isinstance(given, list) else []
    patterns = [each for each in names if isinstance(each, str) and glob.has_magic(each)]
    if not patterns:
        return given
    from smarts.sstudio.build import matching  # here: reports need no builder

    try:
        return [name for each in names for name in (matching(each) if each in patterns else [each])]
    except SmartsError as error:
        raise UnfitError(": ".join(filter(None, (error.place, error.problem))), error.remedy) from error


def distinct(values: Iterable[Any]) -> Any:
    """Return values as a tuple, or raise if one of them is there twice."""
    values = tuple(values)
    twice = sorted({str(value) for value in values if values.count(value) > 1})
    if twice:
        raise UnfitError(f"{', '.join(twice)} is there twice", "name each once")
    return values


def _sorted(values: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(sorted(values))


FolderName = Annotated[str, AfterValidator(_name)]
Algorithm = Annotated[str, _named("algorithm", ALGORITHMS)]
Policy = Annotated[str, _named("scripted policy", SCRIPTED_POLICIES)]
Metric = Annotated[str, AfterValidator(_metric)]
Scenario = Annotated[str, AfterValidator(_scenario)]
Scenarios = Annotated[tuple[Scenario, ...], Field(strict=False), BeforeValidator(_matched)]
Gpus = Annotated[float, Field(ge=0)]
Engine = Annotated[str, _named("traffic engine", TRAFFIC_ENGINES)]


DISTINCT = AfterValidator(distinct)
Names = Annotated[tuple[str, ...], SEVERAL, DISTINCT]
# In one order, whatever the file's: greedy first.
Modes = Annotated[tuple[Literal["greedy", "sampled"], ...], SEVERAL, DISTINCT, AfterValidator(_sorted)]
Seeds = Annotated[tuple[Annotated[int, Field(ge=0, lt=2**31)], ...], SEVERAL, DISTINCT]
Algorithms = Annotated[tuple[Algorithm, ...], Field(strict=False), DISTINCT]
Pair = Annotated[tuple[Algorithm, Algorithm], Field(strict=False)]
Policies = Annotated[tuple[Policy, ...], Field(strict=False), DISTINCT]
Loggers = Annotated[tuple[Annotated[str, _named("logger", LOGGERS)], ...], Field(strict=False), DISTINCT]
Metrics = Annotated[tuple[Metric, ...], SEVERAL, DISTINCT]
Imports = Annotated[tuple[str, ...], Field(strict=False), DISTINCT]
Wheels = Annotated[tuple[Annotated[int, Field(ge=0, le=3)], ...], Field(strict=False), DISTINCT]
VehicleName = Literal["generic_sedan", "sedan", "passenger", "bus", "coach", "truck", "motorcycle"]
# All but Empty, by which agents do nothing.
ActionName = Annotated[str, _named("action", ACTION_NAMES, own=False)]


def name_of(scenarios: Iterable[str]) -> str:
    """Return the name of a task that has none of its own."""
    paths = [Path(each) for each in scenarios]
    return "-".join((path.name or path.resolve().name).replace("@", "-") for path in paths)


DISTRIBUTIONS = ("uniform", "loguniform", "randint")
"""What a search may draw from, with [low, high]; `randint` excludes high."""


def _search_space(given: Any) -> Any:
    """Raise unless a value is a list, or {choice: [...]}, or one of `DISTRIBUTIONS` with its bounds."""
    kind, values = "choice", given
    if isinstance(given, dict) and len(given) == 1:
        ((kind, values),) = given.items()
    if kind not in ("choice", *DISTRIBUTIONS) or not isinstance(values, list) or not values:
        draws = ", ".join(f"{{{draw}: [low, high]}}" for draw in DISTRIBUTIONS)
        remedy = f"give a list of values, or one of {{choice: [value, ...]}}, {draws}"
        raise UnfitError(f"{given!r} is not a search space", remedy)
    if kind != "choice":
        _check_bounds(kind, values)
    return given


def _check_bounds(kind: str, bounds: list[Any]) -> None:
    types, numbers = ((int,), "whole numbers") if kind == "randint" else ((int, float), "numbers")
    least, order = (0, "0 < low < high") if kind == "loguniform" else (-inf, "low < high")
    is_drawn = len(bounds) == 2 and all(type(bound) in types for bound in bounds)
    if not is_drawn or not least < bounds[0] < bounds[1] < inf:
        raise UnfitError(
            f"{bounds!r} are not bounds of {kind}", f"give two {numbers}, [low, high], with {order}"
        )


SearchSpace = Annotated[Any, AfterValidator(_search_space)]


def ends(given: Any) -> list[tuple[tuple[str | int, ...], Any]]:
    """Return place and value of all that a search may choose from, of a draw within bounds its two ends."""
    if isinstance(given, list):
        return [((number,), value) for number, value in enumerate(given)]
    ((kind, values),) = given.items()
    if kind == "choice":
        return [((kind, number), value) for number, value in enumerate(values)]
    low, high = values
    if kind == "randint":
        return [((kind, 0), low), ((kind, 1), high - 1)]
    return [((kind, 0), float(low)), ((kind, 1), float(high))]
