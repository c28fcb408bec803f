"""YAML files, what they extend and what the command line changes, as one typed model."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError

from smarts.config.loader import Loader
from smarts.config.problems import LONGEST_VALUE, ConfigError, Key, Problem, explained, in_order, shown
from smarts.errors import nearest_names, shortened

EXTENDS = "extends"
"""Key of a file's top level: a file, relative to this one or else one of `PACKAGED`, whose values hold where
this one has none."""
PACKAGED = Path(__file__).resolve().parents[2] / "configs"
"""The folder of the files that come with the package."""
COMMAND_LINE = "command line"

Model = TypeVar("Model", bound=BaseModel)


class Section(BaseModel):
    """Part of a config: unknown keys are mistakes, values are checked and not converted."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, use_attribute_docstrings=True)


@dataclass(frozen=True)
class Fault:
    """What a check of a config's values finds; see `read_config`."""

    key: Key
    """Of the value, or of what is around it."""
    text: str
    remedy: str = ""


Check = Callable[[Mapping[str, Any]], Iterable[Fault]]


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
        file: The file, or the name of one in `PACKAGED`. Its `extends` names another one, whose values hold
            where this one has none; sections are merged, everything else (lists too) is replaced.
        model: What the content must be.
        overrides: Values that go before the file's, as in "budget.minutes=5"; the value is read as YAML.
        check: Finds what the model does not, in values which need not fit the model.

    Raises:
        ConfigError: With all mistakes: of syntax, names, types, ranges.
    """
    content = _read(_located(file), (), str(file))
    for text in overrides:
        _override(content, text)
    if not content.is_whole:
        raise ConfigError(content.problems)
    problems = list(content.problems)
    found = None
    try:
        found = model.model_validate(content.values)
    except ValidationError as error:
        problems += explained(error, model, content.values, content.place)
    for fault in check(content.values):
        if fault.key and any(problem.text.startswith(f"{shown(fault.key)} is ") for problem in problems):
            continue  # its type is wrong already
        text = f"{shown(fault.key)}: {fault.text}" if fault.key else fault.text
        problems.append(Problem(content.place(fault.key), text, fault.remedy))
    if found is None or problems:
        raise ConfigError(in_order(problems))
    return found


def fitted(values: Mapping[str, Any], model: type[Model], place: str = "") -> Model:
    """Return values that do not come from a config file as a model.

    Args:
        values: By the model's keys.
        model: What they must be.
        place: Where they are from.

    Raises:
        ConfigError: With all mistakes.
    """
    try:
        return model.model_validate(dict(values))
    except ValidationError as error:
        raise ConfigError(explained(error, model, values, lambda key: place)) from error


def _located(file: Path, folder: Path = Path()) -> Path:
    """Return the path of a file named relative to a folder; a name that is not there may be of `PACKAGED`."""
    beside = folder / file
    packaged = PACKAGED / file.name
    is_name = file.parent in (Path(), Path(PACKAGED.name))
    return packaged if is_name and not beside.exists() and packaged.is_file() else beside


def _read(file: Path, extended_by: tuple[Path, ...], by: str) -> _Content:
    """Read a file and those it extends; `by` is where it was named."""
    if file.resolve() in [other.resolve() for other in extended_by]:
        return _Content(problems=[Problem(by, f"{EXTENDS}: {file} extends itself")], is_whole=False)
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        known = [str(other) for other in file.parent.glob("*.yaml") if other not in extended_by]
        known += [other.name for other in PACKAGED.glob("*.yaml")]
        remedy = nearest_names(str(file), known) if isinstance(error, FileNotFoundError) else ""
        problems = [Problem(by, f"cannot read {file}: {reason}", remedy)]
        return _Content(problems=problems, is_whole=False)
    own = _Content(places={(): f"{file}:1"})
    try:
        node = yaml.compose(text, Loader=Loader)
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
    return _merged(_read(_located(Path(base), file.parent), (*extended_by, file), own.place((EXTENDS,))), own)


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
            self._complain(node, f"{shown(key)} contains itself", "write it out")
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
                self._complain(name_node, f"{shown(inside)} is there twice", "remove one")
                _forget(self._content.places, inside)
            self._content.places[inside] = self._place(name_node)
            values[name] = self.value(child, inside)
        return values

    def _single(self, node: yaml.Node) -> Any:
        try:
            return Loader("").construct_object(node)
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
        node = yaml.compose(value, Loader=Loader)
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
