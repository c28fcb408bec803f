"""Config files, the files that they extend and the command line, as one typed model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from smarts.config.problems import ConfigError, Key, Problem, explained, shown
from smarts.config.sources import COMMAND_LINE, Source, read_files, read_override

Model = TypeVar("Model", bound=BaseModel)


class Section(BaseModel):
    """Part of a config: unknown keys are mistakes, values are checked and not converted.

    Raises:
        ConfigError: With all mistakes, where one is made in Python.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as error:
            name = type(self).__name__
            raise ConfigError(explained(error, type(self), values, lambda key: name)) from error

    # As in pydantic's RootModel: validation of files does not call this constructor.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Fault:
    """A mistake that a check of a config finds; see `read_config`."""

    key: Key
    """Key of the value, or of a section around it."""
    text: str
    remedy: str = ""


def read_config(
    file: Path,
    model: type[Model],
    overrides: Sequence[str] = (),
    check: Callable[[Model], Iterable[Fault]] = lambda found: (),
) -> Model:
    """Return the content of a YAML file as a model.

    Args:
        file: The file, or the name of one in `PACKAGED`. Its `extends` names another one, whose values hold
            where this one has none; sections are merged, everything else (lists and `{}` too) is replaced.
        model: The type of the content.
        overrides: Values that replace the file's, as in "budget.minutes=5"; the value is read as YAML.
        check: Finds mistakes in how values fit together, if each fits the model.

    Raises:
        ConfigError: With all mistakes of names, types and ranges, or all that `check` finds.
    """
    sources = [*read_files(file, str(file)), *map(read_override, overrides)]
    values = reduce(_merged, (source.values for source in sources))
    place = partial(_place, sources)
    problems = [problem for source in sources for problem in source.repeated]
    try:
        found = model.model_validate(values)
    except ValidationError as error:
        raise ConfigError([*problems, *explained(error, model, values, place)]) from error
    for fault in check(found):
        text = f"{shown(fault.key)}: {fault.text}" if fault.key else fault.text
        problems.append(Problem(place(fault.key), text, fault.remedy))
    if problems:
        raise ConfigError(problems)
    return found


def _place(sources: Sequence[Source], key: Key) -> str:
    """Return where a key, or else the nearest one around it, was given last."""
    around = (key[:length] for length in range(len(key), -1, -1))
    places = (source.place(each) for each in around for source in reversed(sources))
    return next(filter(None, places), COMMAND_LINE)


def _merged(under: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Return values laid over others; sections are merged, an empty one takes the place of what is below."""
    merged = dict(under)
    for name, value in over.items():
        is_section = value and isinstance(value, dict) and isinstance(merged.get(name), dict)
        merged[name] = _merged(merged[name], value) if is_section else value
    return merged


def fitted(values: Mapping[str, Any], model: type[Model], place: str = "", context: Any = None) -> Model:
    """Return values that do not come from a config file as a model.

    Args:
        values: By the model's keys.
        model: Their type.
        place: Where they are from.
        context: For validators that ask for one.

    Raises:
        ConfigError: With all mistakes.
    """
    try:
        return model.model_validate(dict(values), context=context)
    except ValidationError as error:
        raise ConfigError(explained(error, model, values, lambda key: place)) from error
