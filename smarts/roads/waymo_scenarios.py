"""Scenarios of the Waymo Open Motion Dataset, which are Protocol Buffers in TFRecord files.

Sources: Ettinger et al., "Large Scale Interactive Motion Forecasting for Autonomous Driving: The Waymo Open
Motion Dataset", ICCV 2021, and its scenario.proto and map.proto; the encoding of Protocol Buffers
(https://protobuf.dev/programming-guides/encoding) and of TFRecord files.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

Message = Mapping[str, list[Any]]
"""The values of each known field, most of which have one or none."""
_VARINT = re.compile(rb"[\x80-\xff]{0,9}[\x00-\x7f]")


def _int(data: bytes) -> list[int]:
    """Return numbers of 7 bits a byte, the lowest first."""
    return [sum((byte & 127) << 7 * k for k, byte in enumerate(each)) for each in _VARINT.findall(data)]


_float, _double = partial(np.frombuffer, dtype="<f4"), partial(np.frombuffer, dtype="<f8")
_ID = {5: ("scenario_id", lambda data: [data.decode()])}
_POINT = {1: ("x", _double), 2: ("y", _double)}
_BOUNDARY = {3: ("feature", _int)}
_NEIGHBOUR = {k: (name, _int) for k, name in enumerate(("lane", "start", "end", "its_start", "its_end"), 1)}
_LANE = {1: ("mph", _double), 2: ("type", _int), 8: ("polyline", _POINT), 10: ("exit_lanes", _int)}
_LANE |= {11: ("left", _NEIGHBOUR), 13: ("left_boundaries", _BOUNDARY), 14: ("right_boundaries", _BOUNDARY)}
_LINE = {2: ("polyline", _POINT)}
_FEATURE = {1: ("id", _int), 3: ("lane", _LANE), 4: ("line", _LINE), 5: ("line", _LINE)}
_STATE = {2: ("x", _double), 3: ("y", _double), 5: ("length", _float), 6: ("width", _float)}
_STATE |= {8: ("heading", _float), 9: ("vx", _float), 10: ("vy", _float), 11: ("valid", _int)}
_TRACK = {1: ("id", _int), 2: ("type", _int), 3: ("states", _STATE)}
_LIGHTS = {1: ("lanes", {1: ("lane", _int), 2: ("state", _int)})}
_SCENARIO = {1: ("t", _double), 2: ("tracks", _TRACK), 7: ("lights", _LIGHTS), 8: ("features", _FEATURE)}
_SCENARIO |= _ID
"""Messages: number of a field -> its name, and its message or what decodes it."""


def read_scenario(path: Path) -> Message:
    """Return a scenario of a file: FILE#ID, or FILE if it has only one.

    Raises:
        ValueError: It has no such scenario, or is cut or broken.
    """
    name, _, wanted = path.name.partition("#")
    found, record = [], b""
    for record in _records(path.with_name(name)):
        found.append(first(_decoded(record, _ID), "scenario_id"))
        if found[-1] == wanted:
            break
    if found[-1:] == [wanted] or (not wanted and len(found) == 1):
        return _decoded(record, _SCENARIO)
    raise ValueError(f"name one of its {len(found)} scenarios, as {name}#ID: {', '.join(found[:9])}")


def first(message: Message, field: str) -> Any:
    """Return the value of a field, 0 if it is missing."""
    return message[field][0] if message[field] else 0


def _records(path: Path) -> Iterator[bytes]:
    """Yield the records of a TFRecord file: length in 8 bytes, checksum in 4, data, checksum in 4."""
    left = path.stat().st_size
    with path.open("rb") as file:
        while left:
            size = int.from_bytes(file.read(12)[:8], "little")
            left -= size + 16
            if left < 0:
                raise ValueError("it ends in the middle of a record")
            yield file.read(size + 4)[:-4]


def _decoded(data: bytes, message: Mapping[int, tuple[str, Any]]) -> Message:
    """Return the known fields of an encoded message."""
    found: dict[str, list[Any]] = {name: [] for name, _ in message.values()}
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        size, end = _varint(data, at) if key & 7 in (0, 2) else ({1: 8, 5: 4}.get(key & 7, len(data)), at)
        begin, at = (end, end + size) if key & 7 else (at, end)
        name, kind = message.get(key >> 3, ("", None))
        if at > len(data):
            raise ValueError("a message is broken")
        if kind is not None:
            part = data[begin:at]
            found[name].extend([_decoded(part, kind)] if isinstance(kind, dict) else kind(part))
    return found


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """Return a number and where it ends."""
    if found := _VARINT.match(data, at):
        return _int(found[0])[0], found.end()
    raise ValueError("a message is broken")
