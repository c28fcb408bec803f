"""YAML texts of a config: the file, the files that it extends, and the overrides of the command line."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from smarts.config.problems import ConfigError, Key, Problem, shown
from smarts.errors import nearest_names

EXTENDS = "extends"
"""Key of a file's top level: a file, relative to this one or else one of `PACKAGED`, whose values hold where
this one has none."""
NOT_INHERITED = ("description",)
"""Keys that describe a single file; files that extend it do not inherit them."""
PACKAGED = Path(__file__).resolve().parents[2] / "configs"
"""The folder of the files that come with the package."""
COMMAND_LINE = "command line"


class Loader(yaml.SafeLoader):
    """Reads 1e-3 as a number, and 12:30, 010 and 2026-01-01 as texts; YAML 1.1 does neither."""


def _number(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int | float:
    number = float(node.value.replace("_", ""))
    return int(number) if number.is_integer() else number


_INT, _FLOAT, _POWER, _TIME = (
    f"tag:yaml.org,2002:{name}" for name in ("int", "float", "float#exponent", "timestamp")
)
_PATTERNS = {
    _INT: r"[-+]?(0|[1-9][\d_]*|0x[\da-fA-F_]+|0b[01_]+)$",
    _FLOAT: r"[-+]?(\d[\d_]*\.[\d_]*|\.\d[\d_]*|\.(inf|Inf|INF))$|\.(nan|NaN|NAN)$",
    _POWER: r"[-+]?(\d[\d_]*(\.\d*)?|\.\d+)[eE][-+]?\d{1,3}$",
}
Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in {*_PATTERNS, _TIME}]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
for _tag, _pattern in _PATTERNS.items():
    Loader.add_implicit_resolver(_tag, re.compile(_pattern), [*"-+.0123456789"])
Loader.add_constructor(_POWER, _number)


class Source:
    """One YAML text: its values, and the place of each.

    Args:
        text: The text.
        name: Name of the file, or what places in an override are called.
        prefix: Key of the text's value, () for a file.

    Raises:
        yaml.YAMLError: It is not YAML.
    """

    def __init__(self, text: str | bytes, name: str, prefix: Key = ()) -> None:
        self._name, self._prefix = name, prefix
        loader = Loader(text)
        self._node = loader.get_single_node()
        # Before the nodes are constructed: then merge keys (<<) put into them what they merge.
        self.repeated = [*self._repeated(self._node, prefix)]
        """Each key that a section has twice, of which YAML takes the last."""
        self.values: Any = None if prefix else {}
        if self._node is not None:
            self.values = loader.construct_document(self._node)
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

    def _repeated(self, node: yaml.Node | None, key: Key) -> Iterator[Problem]:
        if isinstance(node, yaml.SequenceNode):
            for number, child in enumerate(node.value):
                yield from self._repeated(child, (*key, number))
        elif isinstance(node, yaml.MappingNode):
            names = [name.value for name, _ in node.value]
            for number, (name, child) in enumerate(node.value):
                inner = (*key, name.value)
                if name.value in names[:number]:
                    yield Problem(self._at(name), f"{shown(inner)} is there twice", "remove one")
                yield from self._repeated(child, inner)

    def _at(self, node: yaml.Node) -> str:
        return self._name if self._prefix else f"{self._name}:{node.start_mark.line + 1}"


def _child(node: yaml.Node | None, part: str | int) -> tuple[yaml.Node | None, yaml.Node | None]:
    """Return the nodes of a key and its value, of a list both of its member; None and None without one."""
    if isinstance(node, yaml.MappingNode):
        return {name.value: (name, child) for name, child in node.value}.get(str(part), (None, None))
    if isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
        return node.value[part], node.value[part]
    return None, None


def read_files(file: Path, by: str, extended_by: tuple[Path, ...] = ()) -> list[Source]:
    """Return a file and those that it extends, the farthest first.

    Args:
        file: The file, or the name of one in `PACKAGED`.
        by: Where it is named.
        extended_by: Files that extend this one.

    Raises:
        ConfigError: A file cannot be read, or is not keys with values in YAML.
    """
    file = _located(file, extended_by[-1].parent if extended_by else Path())
    if file.resolve() in [other.resolve() for other in extended_by]:
        raise _error(by, f"{EXTENDS}: {file} extends itself")
    source = _read(file, by, extended_by)
    base = source.values.pop(EXTENDS, None)
    if base is None:
        return [source]
    at = source.place((EXTENDS,)) or ""
    if not isinstance(base, str):
        raise _error(at, f"{EXTENDS} is {base!r}", "name a file")
    below = read_files(Path(base), at, (*extended_by, file))
    for each in below:
        for name in NOT_INHERITED:
            each.values.pop(name, None)
    return [*below, source]


def _read(file: Path, by: str, extended_by: tuple[Path, ...]) -> Source:
    try:
        source = Source(file.read_bytes(), str(file))
    except OSError as error:
        known = [str(other) for other in file.parent.glob("*.yaml") if other not in extended_by]
        known += [other.name for other in PACKAGED.glob("*.yaml")]
        remedy = nearest_names(str(file), known) if isinstance(error, FileNotFoundError) else ""
        raise _error(by, f"cannot read {file}: {error.strerror}", remedy) from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        raise _error(f"{file}{line}", f"not YAML: {getattr(error, 'problem', None) or error}") from error
    if not isinstance(source.values, dict):
        kind = type(source.values).__name__
        raise _error(f"{file}:1", f"the file holds a {kind}, not keys with values")
    return source


def _located(file: Path, folder: Path) -> Path:
    """Return the path of a file relative to a folder, or of one in `PACKAGED` if it does not exist there."""
    beside, packaged = folder / file, PACKAGED / (file.name if file.suffix else f"{file.name}.yaml")
    is_name = file.parent in (Path(), Path(PACKAGED.name))
    return packaged if is_name and not beside.exists() and packaged.is_file() else beside


def read_override(text: str) -> Source:
    """Return a value of the command line, such as "budget.minutes=5".

    Raises:
        ConfigError: The text is no such value.
    """
    name, sign, value = text.partition("=")
    parts = tuple(name.strip().split("."))
    if not sign or not all(parts):
        raise _error(COMMAND_LINE, f"{text!r} is not KEY=VALUE", "as in budget.minutes=5")
    try:
        return Source(value, f"{COMMAND_LINE}, {text}", parts)
    except yaml.YAMLError as error:
        raise _error(COMMAND_LINE, f"the value of {text!r} is not YAML") from error


def _error(place: str, text: str, remedy: str = "") -> ConfigError:
    return ConfigError([Problem(place, text, remedy)])
