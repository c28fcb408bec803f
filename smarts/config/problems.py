"""Mistakes in configs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from smarts.errors import SmartsError, nearest_names, shortened

MOST_PROBLEMS = 25
"""How many mistakes of a file are shown."""
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
        lines = [shortened(str(problem), 500) for problem in self.problems[:MOST_PROBLEMS]]
        if len(self.problems) > MOST_PROBLEMS:
            lines.append(f"and {len(self.problems) - MOST_PROBLEMS} more")
        return "\n  ".join(lines)


def in_order(problems: Sequence[Problem]) -> list[Problem]:
    """Sort mistakes by their lines, file by file."""
    files = list(dict.fromkeys(problem.place.rpartition(":")[0] for problem in problems))

    def position(problem: Problem) -> tuple[int, int]:
        file, _, line = problem.place.rpartition(":")
        return files.index(file), int(line) if line.isdecimal() else 0

    return sorted(problems, key=position)


def explained(
    error: ValidationError, model: type[BaseModel], values: Any, place: Callable[[Key], str]
) -> list[Problem]:
    """Return the mistakes that a model finds.

    Args:
        error: Of the model.
        model: The model.
        values: Its input.
        place: Returns the place of a key, or of the section around it.
    """
    return _joined([_problem(dict(each), model, values, place) for each in _primary(error)])


def _problem(
    error: dict[str, Any], model: type[BaseModel], values: Any, place_of: Callable[[Key], str]
) -> Problem:
    """Return a validation error in words."""
    key = tuple(_without_kinds(tuple(error["loc"]), values))
    place, kind = place_of(key), error["type"]
    if kind == "extra_forbidden":
        section = _section(model, key[:-1])
        known = list(section.model_fields) if section else []
        return Problem(place, f"there is no key {shown(key)}", nearest_names(str(key[-1]), known))
    if kind == "missing":
        return Problem(place, f"{shown(key)} is missing", _meaning(model, key))
    if kind in ("value_error", "assertion_error"):
        cause = error.get("ctx", {}).get("error")
        is_ours = isinstance(cause, UnfitError)
        problem = cause.problem if is_ours else str(error["msg"]).removeprefix("Value error, ")
        text = f"{shown(key)}: {problem}" if key else problem
        return Problem(place, text, cause.remedy if is_ours else "")
    return Problem(
        place, f"{shown(key)} is {shortened(repr(error.get('input')), LONGEST_VALUE)}", _should(error)
    )


def _should(error: Mapping[str, Any]) -> str:
    """Return what a value of a wrong type or range should be."""
    kind, value = error["type"], error.get("input")
    if kind in ("tuple_type", "list_type"):
        is_single = isinstance(value, str | int | float)
        return f"{SHOULD}a list" + (f": [{shortened(str(value), LONGEST_VALUE)}]" if is_single else "")
    if kind in ("model_type", "dict_type"):
        return f"{SHOULD}keys with values: {{key: value}}"
    if kind == "too_short":
        least = error["ctx"]["min_length"]
        return f"{SHOULD}at least {least} {'entry' if least == 1 else 'entries'}"
    message = str(error["msg"])
    return message[:1].lower() + message[1:]


def _primary(error: ValidationError) -> list[Any]:
    """Leave out "too short" of lists whose members have mistakes."""
    found = error.errors(include_url=False)
    places = [each["loc"] for each in found]

    def has_others_inside(place: tuple) -> bool:
        return any(len(other) > len(place) and other[: len(place)] == place for other in places)

    return [each for each in found if each["type"] != "too_short" or not has_others_inside(each["loc"])]


def _joined(problems: Sequence[Problem]) -> list[Problem]:
    """Join the problems of each value: pydantic reports one for each type that it does not fit."""
    remedies: dict[tuple[str, str], list[str]] = {}
    for problem in problems:
        remedies.setdefault((problem.place, problem.text), []).append(problem.remedy)
    return [
        Problem(place, text, " or ".join([said[0], *(each.removeprefix(SHOULD) for each in said[1:])]))
        for (place, text), said in ((at, list(dict.fromkeys(each))) for at, each in remedies.items())
    ]


def _without_kinds(key: Key, content: Any) -> Iterator[str | int]:
    """Leave out parts of a key that name a type, not a place in the file."""
    for part in key:
        if isinstance(content, list) and isinstance(part, int) and part < len(content):
            content = content[part]
            yield part
        elif isinstance(content, dict):
            if part in content:
                content = content[part]
                yield part
            elif part == key[-1]:
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


def _meaning(model: type[BaseModel], key: Key) -> str:
    section = _section(model, key[:-1])
    info = section.model_fields.get(str(key[-1])) if section else None
    return f"it says: {info.description}" if info and info.description else "add it"


def shown(key: Key) -> str:
    """Return a key as written in code: tasks[0].name."""
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text or "the file"
