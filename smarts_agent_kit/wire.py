"""Messages between the simulator and agents, and their bytes.

A message is a frame: its length, the length of its head, the head, then the bytes of its arrays. The head is
msgpack of plain values, and of a list of name, dtype and shape of each array; arrays are little-endian and
C-contiguous. Whatever else arrives is a `WireError`: nothing is executed or allocated.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import msgpack
import numpy as np
from numpy.typing import NDArray

VERSION = 1
"""Of the protocol; both sides need the same."""
LARGEST = 8 * 2**20
"""The most bytes of a frame."""
LARGEST_HEAD = 2**18
"""The most bytes of a head: msgpack may unfold to a hundred times its size."""
MOST_ARRAYS = 256
MOST_AXES = 8
DEEPEST = 16
"""Levels of lists and dicts inside each other."""
DTYPES = {
    name: np.dtype(name).newbyteorder("<")
    for name in (
        "bool",
        *("int8", "int16", "int32", "int64"),
        *("uint8", "uint16", "uint32", "uint64"),
        *("float32", "float64"),
    )
}
"""The types of arrays that are sent."""
_NAMES = {each: name for name, dtype in DTYPES.items() for each in (dtype, dtype.newbyteorder(">"))}
"""Name by type, as `dtype.name` takes a microsecond."""
_NATIVE = {dtype: dtype.newbyteorder("=") for dtype in DTYPES.values()}
KINDS = ("hello", "proof", "make", "about", "act", "acted", "failed", "refused")
"""The kinds of messages."""

LENGTHS = struct.Struct("<II")
"""Bytes behind the first four, bytes of the head."""
_PLAIN = (str, int, float, bool, type(None))


class WireError(Exception):
    """Bytes that are no message, or a message that cannot be sent."""


@dataclass
class Message:
    """A message."""

    kind: str
    """One of `KINDS`."""
    values: Mapping[str, Any] = field(default_factory=dict)
    """Plain values by name: texts, numbers, lists and dicts of them."""
    arrays: Mapping[str, NDArray] = field(default_factory=dict)


def encode(message: Message) -> bytes:
    """Return a message's bytes.

    Raises:
        WireError: A value is not plain, an array is of a type that is not sent, or the message is too large.
    """
    listed, parts = [], []
    for name, array in message.arrays.items():
        dtype = _NAMES.get(array.dtype)
        if dtype is None:
            raise WireError(f"the array {name!r} is of type {array.dtype}, not of {', '.join(DTYPES)}")
        listed.append((name, dtype, array.shape))
        parts.append(array.astype(DTYPES[dtype], "C", copy=False).tobytes())
    try:
        head: Any = msgpack.packb([message.kind, message.values, msgpack.packb(listed)])
    except (TypeError, ValueError, OverflowError, RecursionError) as error:
        raise WireError(f"a value cannot be sent: {error}") from error
    size = 4 + len(head) + sum(map(len, parts))
    if len(head) > LARGEST_HEAD or size > LARGEST:
        raise WireError(f"the message has {size} bytes, {len(head)} of them values: more than is sent")
    return b"".join((LENGTHS.pack(size, len(head)), head, *parts))


def is_sent(dtype: np.dtype) -> bool:
    """Return whether arrays of a type are sent."""
    return dtype in _NAMES


def frame_size(start: bytes | bytearray, largest: int = LARGEST) -> int:
    """Return the number of bytes of a frame, from its first four.

    Raises:
        WireError: It is too large, or too small for a frame.
    """
    size = int.from_bytes(start[:4], "little")
    if not 4 <= size <= largest:
        raise WireError(f"a message of {size} bytes: not from 4 to {largest}")
    return 4 + size


def decode(frame: bytes) -> Message:
    """Return the message of a whole frame; its arrays are writable copies.

    Raises:
        WireError: It is no message.
    """
    if len(frame) < LENGTHS.size or len(frame) > 4 + LARGEST:
        raise WireError(f"a message of {len(frame)} bytes")
    size, head_size = LENGTHS.unpack_from(frame)
    if size != len(frame) - 4 or head_size > min(LARGEST_HEAD, size - 4):
        raise WireError("the lengths of a message do not agree")
    body = LENGTHS.size + head_size
    head = _unpacked(frame[LENGTHS.size : body])
    if not (isinstance(head, list) and len(head) == 3 and head[0] in KINDS):
        raise WireError("the head of a message is not [kind, values, arrays]")
    kind, values, layout = head
    if not isinstance(values, dict) or not _is_plain(values) or not isinstance(layout, bytes):
        raise WireError("the values of a message are no dict of plain values")
    places, end = _places(layout)
    if body + end != len(frame):
        raise WireError("the bytes of a message are not those of its arrays")
    return Message(kind, values, {each.name: _array(frame, body, each) for each in places})


class _Place(NamedTuple):
    """Where an array is in a message."""

    name: str
    dtype: np.dtype
    shape: tuple[int, ...]
    size: int
    begin: int


@lru_cache(maxsize=64)
def _places(layout: bytes) -> tuple[tuple[_Place, ...], int]:
    """Return where a message's arrays are behind its head, and where they end.

    They are the same from message to message, as long as the number of agents is.
    """
    listed = _unpacked(layout)
    if not isinstance(listed, list) or len(listed) > MOST_ARRAYS:
        raise WireError("the arrays of a message are no short list")
    places, end = {}, 0
    for each in listed:
        name, dtype, shape = _listed(each)
        count = math.prod(shape)
        if name in places or count > LARGEST or math.prod(max(size, 1) for size in shape) > LARGEST:
            raise WireError(f"the array {name[:100]!r} is too large, or is there twice")
        places[name] = _Place(name, dtype, shape, count, end)
        end += count * dtype.itemsize
    return (*places.values(),), end


def _array(frame: bytes, body: int, place: _Place) -> NDArray:
    """Return a new array, with its numbers where the processor wants them."""
    dtype, begin = place.dtype, body + place.begin
    if dtype.kind == "b":
        return (np.frombuffer(frame, np.uint8, place.size, begin) != 0).reshape(place.shape)
    return np.frombuffer(frame, dtype, place.size, begin).reshape(place.shape).astype(_NATIVE[dtype])


def _unpacked(data: bytes) -> Any:
    """Return what some bytes are in msgpack.

    Raises:
        WireError: They are none.
    """
    try:
        return msgpack.unpackb(data, ext_hook=_refuse, strict_map_key=True)
    except Exception as error:  # of several types, some of them msgpack's own
        raise WireError(f"the head of a message is no msgpack: {error}") from error


def _listed(each: Any) -> tuple[str, np.dtype, tuple[int, ...]]:
    """Return name, dtype and shape of an array in a head."""
    is_listed = isinstance(each, list) and len(each) == 3 and isinstance(each[0], str)
    if not is_listed or not isinstance(each[1], str) or each[1] not in DTYPES:
        raise WireError("an array of a message is not [name, dtype, shape]")
    shape = each[2]
    if not isinstance(shape, list) or len(shape) > MOST_AXES or not all(map(_is_size, shape)):
        raise WireError("the shape of an array is no list of sizes")
    return each[0], DTYPES[each[1]], tuple(shape)


def _is_size(size: Any) -> bool:
    return isinstance(size, int) and not isinstance(size, bool) and 0 <= size <= LARGEST


def _is_plain(value: Any, depth: int = 0) -> bool:
    """Return whether a value consists of texts, numbers, lists and dicts, in at most `DEEPEST` levels."""
    if isinstance(value, dict):
        if not all(isinstance(key, str) for key in value):
            return False
        value = [*value.values()]
    if isinstance(value, list):
        return depth < DEEPEST and all(_is_plain(each, depth + 1) for each in value)
    return isinstance(value, _PLAIN)


def _refuse(code: int, data: bytes) -> Any:
    raise WireError(f"a value of the further type {code}")
