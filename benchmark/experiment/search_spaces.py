"""What a search may choose from: a list of values, or a draw."""

from __future__ import annotations

from math import inf
from typing import Annotated, Any

from pydantic import AfterValidator

from smarts.config import UnfitError

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
