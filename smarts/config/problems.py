"""Mistakes in configs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from smarts import errors
from smarts.errors import SmartsError, nearest_names

LONGEST_VALUE = 80
SHOULD = "input should be "
"""First words of pydantic's messages about a value."""

Key = tuple[str | int, ...]


class UnfitError(ValueError):
    """A value that cannot be used, raised by the checks of a model.

    Args:
        problem: What is wrong, with the value.
        remedy: What to do about it.
    """

    def __init__(self, problem: str, remedy: str = "") -> None:
        self.problem, self.remedy = problem, remedy
        super().__init__(problem)


@dataclass(frozen=True)
class Problem:
    """One mistake in a config."""

    place: str
    """File and line."""
    text: str
    remedy: str = ""

    def __str__(self) -> str:
        place = f"{self.place}: " if self.place else ""
        return f"{place}{self.text}" + (f"; {self.remedy}" if self.remedy else "")


class ConfigError(SmartsError):
    """A config file cannot be used; `problems` are all of its mistakes, and the message names each."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        count = len(self.problems)
        super().__init__(f"{count} mistakes" if count != 1 else "a mistake", place="config")

    def __reduce__(self):  # type: ignore[override] - made from its problems alone
        return ConfigError, (self.problems,)

    def __str__(self) -> str:
        return "\n  ".join(map(str, self.problems))


def explained(
    error: ValidationError, model: type[BaseModel], values: Any, place: Callable[[Key], str]
) -> list[Problem]:
    """Return the mistakes that a model finds.

    Args:
        error: What the model raised.
        model: The model.
        values: Its input.
        place: Returns the place of a key, or of the section around it.
    """
    remedies: dict[tuple[str, str], list[str]] = {}
    for each in _primary(error):
        problem = _problem(dict(each), model, values, place)
        remedies.setdefault((problem.place, problem.text), []).append(problem.remedy)
    # Pydantic reports a value once for each type that it does not fit.
    return [
        Problem(place, text, " or ".join([said[0], *(each.removeprefix(SHOULD) for each in said[1:])]))
        for (place, text), said in ((at, [*dict.fromkeys(each)]) for at, each in remedies.items())
    ]


def _problem(
    error: dict[str, Any], model: type[BaseModel], values: Any, place_of: Callable[[Key], str]
) -> Problem:
    """Return a validation error in words."""
    key = _key(error, values)
    place, kind = place_of(key), error["type"]
    if kind == "extra_forbidden":
        section = _section(model, key[:-1])
        known = list(section.model_fields) if section else []
        return Problem(place, f"there is no key {shown(key)}", nearest_names(str(key[-1]), known))
    if kind == "missing":
        return Problem(place, f"{shown(key)} is missing", "add it")
    if kind == "value_error":
        cause = error["ctx"]["error"]
        problem, remedy = (cause.problem, cause.remedy) if isinstance(cause, UnfitError) else (str(cause), "")
        return Problem(place, f"{shown(key)}: {problem}" if key else problem, remedy)
    return Problem(place, f"{shown(key)} is {errors.shown(error['input'], LONGEST_VALUE)}", _should(error))


def _should(error: Mapping[str, Any]) -> str:
    """Return what a value of a wrong type or range should be."""
    kind, value = error["type"], error["input"]
    if kind in ("tuple_type", "list_type"):
        return f"{SHOULD}a list" + (f": [{value}]" if isinstance(value, str | int | float) else "")
    if kind in ("model_type", "dict_type"):
        return f"{SHOULD}keys with values: {{key: value}}"
    message = str(error["msg"]).replace("Tuple", "List")
    return message[:1].lower() + message[1:]


def _primary(error: ValidationError) -> list[Any]:
    """Leave out "too short" of lists whose members have mistakes."""
    found = error.errors(include_url=False)
    around = {each["loc"][:length] for each in found for length in range(len(each["loc"]))}
    return [each for each in found if each["type"] != "too_short" or each["loc"] not in around]


def _key(error: Mapping[str, Any], content: Any) -> Key:
    """Return the key in a file of an error, without the parts of its location that name a type."""
    return tuple(_without_kinds(error["loc"], content, is_missing=error["type"] == "missing"))


def _without_kinds(key: Key, content: Any, *, is_missing: bool) -> Iterator[str | int]:
    for part in key:
        if isinstance(content, list) and isinstance(part, int) and part < len(content):
            content = content[part]
            yield part
        elif isinstance(content, dict):
            if part in content:
                content = content[part]
                yield part
            elif is_missing and part == key[-1]:
                yield part


def _section(model: type[BaseModel], key: Key) -> type[BaseModel] | None:
    """Return the model of the section at a key."""
    current: type[BaseModel] | None = model
    for part in key:
        if isinstance(part, int) or current is None:
            continue
        # A part that is no field is a key of a dict of sections.
        if info := current.model_fields.get(str(part)):
            current = _model_in(info.annotation)
    return current


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for each in get_args(annotation) if (found := _model_in(each))), None)


def shown(key: Key) -> str:
    """Return a key as written in code: tasks[0].name."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text or "the file"
