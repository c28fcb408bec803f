"""YAML texts of a config: the file, the files that it extends, and the overrides of the command line."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from smarts.config.problems import LONGEST_VALUE, Key, Problem, shown
from smarts.errors import nearest_names, shortened

EXTENDS = "extends"
"""Key of a file's top level: a file, relative to this one or else one of `PACKAGED`, whose values hold where
this one has none."""
NOT_INHERITED = ("description",)
"""Keys that describe a single file; files that extend it do not inherit them."""
WHOLE = 2**63
"""Whole numbers are smaller, so that they fit 64 bits."""
PACKAGED = Path(__file__).resolve().parents[2] / "configs"
"""The folder of the files that come with the package."""
COMMAND_LINE = "command line"

Complain = Callable[[Problem], Any]


class Loader(yaml.SafeLoader):
    """Reads 1e-3 as a number, and 12:30 and 010 as texts; YAML 1.1 does neither."""


def _number(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int | float:
    number = float(node.value.replace("_", ""))
    return int(number) if number.is_integer() and abs(number) < WHOLE else number


_INT, _FLOAT, _POWER = (f"tag:yaml.org,2002:{name}" for name in ("int", "float", "float#exponent"))
_PATTERNS = {
    _INT: r"[-+]?(0|[1-9][\d_]*|0x[\da-fA-F_]+|0b[01_]+)$",
    _FLOAT: r"[-+]?(\d[\d_]*\.[\d_]*|\.\d[\d_]*|\.(inf|Inf|INF))$|\.(nan|NaN|NAN)$",
    _POWER: r"[-+]?(\d[\d_]*(\.\d*)?|\.\d+)[eE][-+]?\d{1,3}$",
}
Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in _PATTERNS]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
for _tag, _pattern in _PATTERNS.items():
    Loader.add_implicit_resolver(_tag, re.compile(_pattern), [*"-+.0123456789"])
Loader.add_constructor(_POWER, _number)


class Source:
    """One YAML text: its values, and the place of each.

    Args:
        text: The text.
        name: Of the file, or what places in an override are called.
        complain: Called with each mistake.
        prefix: Key of the text's value, () for a file.

    Raises:
        yaml.YAMLError: It is not YAML.
    """

    def __init__(self, text: str, name: str, complain: Complain, prefix: Key = ()) -> None:
        self._name, self._prefix, self._complain = name, prefix, complain
        self._node = yaml.compose(text, Loader=Loader)
        self.values: Any = None if prefix else {}
        if self._node is not None:
            self.values = self._value(self._node, prefix, ())
        for part in reversed(prefix):
            self.values = {part: self.values}

    def place(self, key: Key) -> str | None:
        """Return where a key is; None if the text does not have it."""
        length = len(self._prefix)
        if key[:length] != self._prefix[: len(key)] or (self._prefix and not key):
            return None
        if len(key) <= length:
            return self._name if self._prefix else f"{self._name}:1"
        found = node = self._node
        for part in key[length:]:
            found, node = _child(node, part)
        return None if found is None else self._at(found)

    def _at(self, node: yaml.Node) -> str:
        return self._name if self._prefix else f"{self._name}:{node.start_mark.line + 1}"

    def _value(self, node: yaml.Node, key: Key, around: tuple[yaml.Node, ...]) -> Any:
        if node in around:
            self._complain(Problem(self._at(node), f"{shown(key)} contains itself", "write it out"))
            return None
        inside = (*around, node)
        if isinstance(node, yaml.SequenceNode):
            return [self._value(child, (*key, index), inside) for index, child in enumerate(node.value)]
        if isinstance(node, yaml.MappingNode):
            return self._section(node, key, inside)
        return self._single(node)

    def _section(self, node: yaml.MappingNode, key: Key, inside: tuple[yaml.Node, ...]) -> dict[str, Any]:
        values: dict[str, Any] = {}
        for name_node, child in node.value:
            at = self._at(name_node)
            if name_node.tag == "tag:yaml.org,2002:merge":
                self._complain(Problem(at, "merge keys (<<) are not supported", f"use {EXTENDS}"))
                continue
            name = self._single(name_node)
            if not isinstance(name, str):
                self._complain(Problem(at, f"the key {name!r} is not a text", "put it in quotes"))
                continue
            if name in values:
                self._complain(Problem(at, f"{shown((*key, name))} is there twice", "remove one"))
            values[name] = self._value(child, (*key, name), inside)
        return values

    def _single(self, node: yaml.Node) -> Any:
        try:
            value = Loader("").construct_object(node)
        except (yaml.YAMLError, ValueError):
            # Such as a date that does not exist, or an unknown tag.
            text = shortened(str(node.value), LONGEST_VALUE)
            kind = node.tag.rpartition(":")[2]
            self._complain(Problem(self._at(node), f"{text} is no {kind}", "put it in quotes"))
            return text
        if isinstance(value, int) and abs(value) >= WHOLE:
            text = shortened(str(node.value), LONGEST_VALUE)
            remedy = "give a smaller one, or one with an exponent: 1e30"
            self._complain(Problem(self._at(node), f"{text} is too large for a whole number", remedy))
            return 0
        return value


def _child(node: yaml.Node | None, part: str | int) -> tuple[yaml.Node | None, yaml.Node | None]:
    """Return the nodes of a key and its value, of a list both of its member; None and None without one."""
    if isinstance(node, yaml.MappingNode):
        return {name.value: (name, child) for name, child in node.value}.get(str(part), (None, None))
    if isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
        return node.value[part], node.value[part]
    return None, None


def read_files(
    file: Path, by: str, complain: Complain, extended_by: tuple[Path, ...] = ()
) -> list[Source] | None:
    """Return a file and those that it extends, the farthest first; None if one cannot be read.

    Args:
        file: The file, or the name of one in `PACKAGED`.
        by: Where it is named.
        complain: Called with each mistake.
        extended_by: Files that extend this one.
    """
    file = _located(file, extended_by[-1].parent if extended_by else Path())
    source = _read(file, by, complain, extended_by)
    if source is None:
        return None
    base = source.values.pop(EXTENDS, None)
    if base is None:
        return [source]
    at = source.place((EXTENDS,)) or ""
    if not isinstance(base, str):
        complain(Problem(at, f"{EXTENDS} is {base!r}", "name a file"))
        return [source]
    below = read_files(Path(base), at, complain, (*extended_by, file))
    for each in below or ():
        for name in NOT_INHERITED:
            each.values.pop(name, None)
    return None if below is None else [*below, source]


def _read(file: Path, by: str, complain: Complain, extended_by: tuple[Path, ...]) -> Source | None:
    if file.resolve() in [other.resolve() for other in extended_by]:
        return complain(Problem(by, f"{EXTENDS}: {file} extends itself"))
    try:
        source = Source(file.read_text(encoding="utf-8"), str(file), complain)
    except (OSError, UnicodeDecodeError) as error:
        return complain(_unreadable(file, by, error, extended_by))
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        return complain(Problem(f"{file}{line}", f"not YAML: {getattr(error, 'problem', None) or error}"))
    if isinstance(source.values, dict):
        return source
    kind = type(source.values).__name__
    return complain(Problem(f"{file}:1", f"the file holds a {kind}, not keys with values"))


def _located(file: Path, folder: Path) -> Path:
    """Return the path of a file relative to a folder, or of one in `PACKAGED` if it does not exist there."""
    beside, packaged = folder / file, PACKAGED / file.name
    is_name = file.parent in (Path(), Path(PACKAGED.name))
    return packaged if is_name and not beside.exists() and packaged.is_file() else beside


def _unreadable(
    file: Path, by: str, error: OSError | UnicodeDecodeError, extended_by: tuple[Path, ...]
) -> Problem:
    reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
    known = [str(other) for other in file.parent.glob("*.yaml") if other not in extended_by]
    known += [other.name for other in PACKAGED.glob("*.yaml")]
    remedy = nearest_names(str(file), known) if isinstance(error, FileNotFoundError) else ""
    return Problem(by, f"cannot read {file}: {reason}", remedy)


def read_override(text: str, complain: Complain) -> Source | None:
    """Return a value of the command line, such as "budget.minutes=5"; None if it is none."""
    name, sign, value = text.partition("=")
    parts = tuple(name.strip().split("."))
    if not sign or not all(parts):
        return complain(Problem(COMMAND_LINE, f"{text!r} is not KEY=VALUE", "as in budget.minutes=5"))
    if parts == (EXTENDS,):
        remedy = "give the command the file that is to be extended"
        return complain(Problem(COMMAND_LINE, f"{EXTENDS} can only be said in a file", remedy))
    try:
        return Source(value, f"{COMMAND_LINE}, {text}", complain, parts)
    except yaml.YAMLError:
        return complain(Problem(COMMAND_LINE, f"the value of {text!r} is not YAML"))
