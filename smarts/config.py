"""YAML files to typed models: every mistake at once, each with its file, line and remedy."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, get_args

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from smarts.errors import SmartsError, nearest_names, shortened

EXTENDS = "extends"
"""Key of a file's top level: a file, relative to this one, whose values hold where this one has none."""
MOST_PROBLEMS = 25
"""How many mistakes of a file are shown."""
COMMAND_LINE = "command line"
LONGEST_VALUE = 80

Key = tuple[str | int, ...]
Model = TypeVar("Model", bound=BaseModel)


class Section(BaseModel):
    """Part of a config: unknown keys are mistakes, values are checked and not converted."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)


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
        return f"{self.place}: {self.text}" + (f"; {self.remedy}" if self.remedy else "")


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


@dataclass(frozen=True)
class Fault:
    """What a check of a config's values finds; see `read_config`."""

    key: Key
    """Of the value, or of what is around it."""
    text: str
    remedy: str = ""


Check = Callable[[Mapping[str, Any]], Iterable[Fault]]


class _Loader(yaml.SafeLoader):
    """Reads 1e-3 as a number, as everybody writes it: YAML 1.1 wants 1.0e-3."""


def _number(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int | float:
    number = float(node.value.replace("_", ""))
    return int(number) if number.is_integer() else number


_NUMBER = "tag:yaml.org,2002:float#exponent"
_Loader.add_implicit_resolver(
    _NUMBER, re.compile(r"[-+]?\d[\d_]*(\.\d*)?[eE][-+]?\d{1,3}$"), [*"-+0123456789"]
)
_Loader.add_constructor(_NUMBER, _number)


@dataclass
class _Content:
    """What files and the command line say, and where each key was said."""

    values: dict[str, Any] = field(default_factory=dict)
    places: dict[Key, str] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    is_whole: bool = True
    """Whether all values are known, so that more can be said than `problems`."""

    def place(self, key: Key) -> str:
        """Return where a key is, or else where the nearest thing around it is."""
        while key and key not in self.places:
            key = key[:-1]
        return self.places.get(key, COMMAND_LINE)


def read_config(
    file: Path, model: type[Model], overrides: Sequence[str] = (), check: Check = lambda values: ()
) -> Model:
    """Return the content of a YAML file as a model.

    Args:
        file: The file. Its `extends` names another one, whose values hold where this one has none; sections
            are merged, everything else (lists too) is replaced.
        model: What the content must be.
        overrides: Values that go before the file's, as in "budget.minutes=5"; the value is read as YAML.
        check: Finds what the model does not, in values which need not fit the model.

    Raises:
        ConfigError: With all mistakes: of syntax, names, types, ranges.
    """
    content = _read(file, ())
    for text in overrides:
        _override(content, text)
    if not content.is_whole:
        raise ConfigError(content.problems)
    problems = list(content.problems)
    found = None
    try:
        found = model.model_validate(content.values)
    except ValidationError as error:
        problems += _joined([_problem(dict(each), content, model) for each in _primary(error)])
    for fault in check(content.values):
        text = f"{_shown(fault.key)}: {fault.text}" if fault.key else fault.text
        problems.append(Problem(content.place(fault.key), text, fault.remedy))
    if found is None or problems:
        raise ConfigError(problems)
    return found


def _read(file: Path, extended_by: tuple[Path, ...]) -> _Content:
    """Read a file and those it extends."""
    by = f"{extended_by[-1]}" if extended_by else str(file)
    if file.resolve() in [other.resolve() for other in extended_by]:
        return _Content(problems=[Problem(by, f"{EXTENDS}: {file} extends itself")], is_whole=False)
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        known = [str(other) for other in file.parent.glob("*.yaml")] if file.parent.is_dir() else []
        remedy = "" if isinstance(error, UnicodeDecodeError) else nearest_names(str(file), known)
        problems = [Problem(by, f"cannot read {file}: {reason}", remedy)]
        return _Content(problems=problems, is_whole=False)
    own = _Content(places={(): f"{file}:1"})
    try:
        node = yaml.compose(text, Loader=_Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        reason = getattr(error, "problem", None) or str(error)
        return _Content(problems=[Problem(f"{file}{line}", f"not YAML: {reason}")], is_whole=False)
    walk = _Walk(own, lambda each: f"{file}:{each.start_mark.line + 1}")
    values = walk.value(node, ()) if node is not None else {}
    if not isinstance(values, dict):
        own.problems.append(
            Problem(f"{file}:1", f"the file holds a {type(values).__name__}, not keys with values")
        )
        own.is_whole = False
        return own
    base = values.pop(EXTENDS, None)
    own.values = values
    if base is None:
        return own
    if not isinstance(base, str):
        own.problems.append(Problem(own.place((EXTENDS,)), f"{EXTENDS} is {base!r}", "name a file"))
        return own
    return _merged(_read(file.parent / base, (*extended_by, file)), own)


class _Walk:
    """Makes values of the nodes of a YAML text, and notes where each is.

    Args:
        content: Takes places and problems in.
        place: Where a node is, in words.
    """

    def __init__(self, content: _Content, place: Callable[[yaml.Node], str]) -> None:
        self._content, self._place = content, place
        self._around: list[yaml.Node] = []

    def value(self, node: yaml.Node, key: Key) -> Any:
        """Return the value of a node, the one of `key`."""
        self._content.places.setdefault(key, self._place(node))
        if node in self._around:
            self._complain(node, f"{_shown(key)} contains itself", "write it out")
            return None
        self._around.append(node)
        try:
            if isinstance(node, yaml.SequenceNode):
                return [self.value(child, (*key, index)) for index, child in enumerate(node.value)]
            if isinstance(node, yaml.MappingNode):
                return self._section(node, key)
            return self._single(node)
        finally:
            self._around.pop()

    def _section(self, node: yaml.MappingNode, key: Key) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for name_node, child in node.value:
            if name_node.tag == "tag:yaml.org,2002:merge":
                self._complain(name_node, "merge keys (<<) are not known here", f"use {EXTENDS}")
                continue
            name = self._single(name_node)
            if not isinstance(name, str):
                self._complain(name_node, f"the key {name!r} is not a text", "put it in quotes")
                continue
            inside = (*key, name)
            if name in values:
                self._complain(name_node, f"{_shown(inside)} is there twice", "remove one")
                _forget(self._content.places, inside)
            self._content.places[inside] = self._place(name_node)
            values[name] = self.value(child, inside)
        return values

    def _single(self, node: yaml.Node) -> Any:
        try:
            return _Loader("").construct_object(node)
        except (yaml.YAMLError, ValueError):
            # Such as a date that does not exist, or a tag of somebody else's.
            shown = shortened(str(node.value), LONGEST_VALUE)
            self._complain(node, f"{shown} is no {node.tag.rpartition(':')[2]}", "put it in quotes")
            return shown

    def _complain(self, node: yaml.Node, text: str, remedy: str) -> None:
        self._content.problems.append(Problem(self._place(node), text, remedy))


def _merged(base: _Content, own: _Content) -> _Content:
    """Return a file's content over that of the file it extends."""
    merged = _Content(dict(base.values), dict(base.places), [*base.problems, *own.problems])
    merged.is_whole = base.is_whole and own.is_whole
    _lay_over(merged, own.values, own.places)
    merged.places[()] = own.places[()]
    return merged


def _lay_over(below: _Content, values: dict[str, Any], places: dict[Key, str]) -> None:
    """Let values go before those of a content; sections are merged."""
    below.values = _laid_over(below.values, values, (), below.places, places)


def _laid_over(
    under: dict[str, Any], values: dict[str, Any], at: Key, places: dict[Key, str], own: dict[Key, str]
) -> dict[str, Any]:
    """Return a section with values laid over it, whose places go into `places`."""
    merged = dict(under)
    for name, value in values.items():
        key = (*at, name)
        below = merged.get(name)
        if isinstance(value, dict) and isinstance(below, dict):
            places[key] = own.get(key, COMMAND_LINE)
            merged[name] = _laid_over(below, value, key, places, own)
            continue
        merged[name] = value
        _forget(places, key)
        places.update({other: place for other, place in own.items() if other[: len(key)] == key})
    return merged


def _forget(places: dict[Key, str], key: Key) -> None:
    """Leave out where a value was and what is in it."""
    for other in [other for other in places if other[: len(key)] == key]:
        del places[other]


def _override(content: _Content, text: str) -> None:
    name, sign, value = text.partition("=")
    parts = name.strip().split(".")
    if not sign or not all(parts):
        content.problems.append(Problem(COMMAND_LINE, f"{text!r} is not KEY=VALUE", "as in budget.minutes=5"))
        return
    if parts == [EXTENDS]:
        remedy = "give the command the file that is to be extended"
        content.problems.append(Problem(COMMAND_LINE, f"{EXTENDS} can only be said in a file", remedy))
        return
    try:
        node = yaml.compose(value, Loader=_Loader)
    except yaml.YAMLError:
        content.problems.append(Problem(COMMAND_LINE, f"the value of {text!r} is not YAML"))
        return
    place = f"{COMMAND_LINE}, {text}"
    said = _Content()
    given = _Walk(said, lambda each: place).value(node, tuple(parts)) if node is not None else None
    content.problems += said.problems
    nested: Any = given
    for part in reversed(parts):
        nested = {part: nested}
    places: dict[Key, str] = {tuple(parts[: count + 1]): place for count in range(len(parts))}
    _lay_over(content, nested, places)


def _problem(error: dict[str, Any], content: _Content, model: type[BaseModel]) -> Problem:
    """Return a validation error in words."""
    key = tuple(part for part in error["loc"])
    key = tuple(_without_kinds(key, content.values))
    place, kind, message = content.place(key), error["type"], str(error["msg"])
    if kind == "extra_forbidden":
        section = _section(model, key[:-1])
        known = list(section.model_fields) if section else []
        return Problem(place, f"there is no key {_shown(key)}", nearest_names(str(key[-1]), known))
    if kind == "missing":
        return Problem(place, f"{_shown(key)} is missing", _meaning(model, key))
    if kind in ("value_error", "assertion_error"):
        cause = error.get("ctx", {}).get("error")
        if isinstance(cause, UnfitError):
            return Problem(place, f"{_shown(key)}: {cause.problem}" if key else cause.problem, cause.remedy)
        message = message.removeprefix("Value error, ")
        return Problem(place, f"{_shown(key)}: {message}" if key else message)
    given = shortened(repr(error.get("input")), LONGEST_VALUE)
    return Problem(place, f"{_shown(key)} is {given}", message[:1].lower() + message[1:])


def _primary(error: ValidationError) -> list[Any]:
    """Leave out that a list is too short where that is only because of mistakes in its members."""
    found = error.errors(include_url=False)
    places = [each["loc"] for each in found]

    def has_others_inside(place: tuple) -> bool:
        return any(len(other) > len(place) and other[: len(place)] == place for other in places)

    return [each for each in found if each["type"] != "too_short" or not has_others_inside(each["loc"])]


def _joined(problems: Sequence[Problem]) -> list[Problem]:
    """Join what is said of one value: one that fits none of several kinds is reported once for each."""
    remedies: dict[tuple[str, str], list[str]] = {}
    for problem in problems:
        remedies.setdefault((problem.place, problem.text), []).append(problem.remedy)
    return [
        Problem(place, text, " or ".join(dict.fromkeys(said))) for (place, text), said in remedies.items()
    ]


def _without_kinds(key: Key, content: Any) -> Iterator[str | int]:
    """Leave out of a key what names a kind of value rather than a place in the file."""
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
        info = current.model_fields.get(str(part))
        current = _model_in(info.annotation) if info else None
    return current


def _model_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next((found for each in get_args(annotation) if (found := _model_in(each))), None)


def _meaning(model: type[BaseModel], key: Key) -> str:
    section = _section(model, key[:-1])
    info = section.model_fields.get(str(key[-1])) if section else None
    return f"it says: {info.description}" if info and info.description else "add it"


def _shown(key: Key) -> str:
    text = ""
    for part in key:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text or "the file"
