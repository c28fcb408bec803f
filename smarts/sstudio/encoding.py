"""Scenario objects as plain data, which identifies them and is stored by a built scenario.

The same value always gives the same text, on every machine and in every process: fields in their declared
order and left out where they hold their default, sequences of any kind as lists, numbers by value (1 and
1.0 are one number), mappings from objects as sorted pairs.
"""

from __future__ import annotations

import dataclasses
import enum
import hashlib
import json
import math
from collections.abc import Callable, Mapping, Set
from pathlib import PurePath
from typing import Any

from smarts.errors import ScenarioError, shown

Json = Any
"""Values of JSON: None, bool, int, float, str, and lists and string-keyed dicts of these."""

TYPE = "$type"
PAIRS = "$pairs"
MEMBERS = "$set"
ENUM = "$enum"
CALLABLE = "$callable"
NUMBER = "$number"


def encode(value: Any, where: str = "") -> Json:
    """Return `value` as JSON data.

    Args:
        value: Scenario objects, enums, named functions and classes, and plain data made of them.
        where: What `value` is, for the error ("ego_missions[2]").

    Raises:
        ScenarioError: A part of `value` cannot be written down, such as a lambda or an open file.
    """
    if value is None or (isinstance(value, bool | str) and not isinstance(value, enum.Enum)):
        return value
    for kind, encoder in _ENCODERS:
        if isinstance(value, kind):
            return encoder(value, where)
    listed = getattr(value, "tolist", None)
    if listed is not None:
        return encode(listed(), where)  # NumPy's scalars and arrays, without importing NumPy
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _encode_dataclass(value, where)
    if callable(value):
        return _encode_callable(value, where)
    raise ScenarioError(
        f"a {type(value).__name__} cannot be part of a scenario: {shown(value, 100)}",
        place=where,
        remedy="use numbers, strings, lists, dicts, types of smarts.sstudio.types, importable functions",
    )


def canonical(value: Any) -> str:
    """Return the text that identifies `value`: its encoding with sorted keys and no spaces."""
    return json.dumps(encode(value), sort_keys=True, separators=(",", ":"))


def digest(value: Any, size: int = 16) -> str:
    """Return a hexadecimal fingerprint of `size` bytes of a value's content."""
    return text_digest(canonical(value), size)


def text_digest(text: str, size: int = 16) -> str:
    """Return the fingerprint of a value whose content is `text`; see `canonical`."""
    return hashlib.blake2b(text.encode(), digest_size=size).hexdigest()


def _encode_number(value: float, where: str) -> Json:
    if not math.isfinite(value):
        return {NUMBER: repr(float(value))}
    return int(value) if value == int(value) else float(value)


def _encode_enum(value: enum.Enum, where: str) -> Json:
    name = value.value if isinstance(value, enum.Flag) else value.name
    return {ENUM: type(value).__name__, "value": name}


def _encode_mapping(value: Mapping, where: str) -> Json:
    arguments = getattr(value, "constructor_arguments", None)
    if arguments is not None:
        # Our own mappings, such as LaneChangingModel, are stored by their constructor's arguments.
        return {TYPE: type(value).__name__, **_encode_items(arguments, where)}
    if all(isinstance(key, str) and not key.startswith("$") for key in value):
        return _encode_items(value, where)
    pairs = [
        [encode(key, f"{where} key {index}"), encode(item, f"{where}[{_label(key)}]")]
        for index, (key, item) in enumerate(value.items())
    ]
    return {PAIRS: sorted(pairs, key=_sort_key)}


def _encode_items(value: Mapping[str, Any], where: str) -> dict[str, Json]:
    return {key: encode(item, f"{where}[{key!r}]" if where else key) for key, item in value.items()}


def _encode_dataclass(value: Any, where: str) -> Json:
    encoded: dict[str, Json] = {TYPE: type(value).__name__}
    for field in dataclasses.fields(value):
        if not field.init:
            continue
        held = getattr(value, field.name)
        if held is field.default:
            continue
        item = encode(held, f"{where}.{field.name}" if where else field.name)
        if field.default is dataclasses.MISSING or item != encode(field.default):
            encoded[field.name] = item
    return encoded


def _encode_callable(value: Callable, where: str) -> Json:
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", "<")
    if module is None or "<" in name:
        raise ScenarioError(
            f"{value!r} has no importable name",
            place=where,
            remedy="define it with def at the top level of a module",
        )
    return {CALLABLE: f"{module}:{name}"}


def _label(key: Any) -> str:
    return repr(getattr(key, "name", key))


def _sort_key(item: Json) -> str:
    return json.dumps(item, sort_keys=True)


_ENCODERS: tuple[tuple[Any, Callable[[Any, str], Json]], ...] = (
    (enum.Enum, _encode_enum),
    (int | float, _encode_number),
    (PurePath, lambda value, where: value.as_posix()),
    (Mapping, _encode_mapping),
    (list | tuple | range, lambda value, where: [encode(x, f"{where}[{n}]") for n, x in enumerate(value)]),
    (Set, lambda value, where: {MEMBERS: sorted((encode(item, where) for item in value), key=_sort_key)}),
)
