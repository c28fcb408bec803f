"""Messages between the simulator and agents, and their bytes.

A message is a frame: its length, the length of its head, its number, the head, then the bytes of its arrays.
The head is msgpack of plain values, and of a list of name, dtype and shape of each array; arrays are
little-endian and C-contiguous. Head and arrays are filled up with zeros to multiples of `ALIGNED` bytes, so
that arrays are used where they have arrived. Whatever else arrives is a `WireError`: nothing is executed or
allocated.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

import msgpack
import numpy as np
from numpy.typing import NDArray

VERSION = 2
"""Version of the protocol; both sides need the same."""
LARGEST = 8 * 2**20
"""The most bytes of a frame."""
LARGEST_HEAD = 2**18
"""The most bytes of a head: msgpack may unfold to a hundred times its size."""
LARGEST_KEPT = 2**12
"""The most bytes of a head that is kept for the next message like it."""
MOST_KEPT = 64
"""Heads."""
MOST_ARRAYS = 256
MOST_AXES = 8
DEEPEST = 16
"""Levels of lists and dicts inside each other."""
ALIGNED = 8
"""Bytes."""
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
KINDS = ("hello", "proof", "make", "about", "act", "acted", "failed", "refused")
"""The kinds of messages."""

LENGTHS = struct.Struct("<IIQ")
"""Bytes behind the first four, bytes of the head, number of the message."""
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
    number: int = 0
    """Number of the request; its answer has the same."""


def encode(message: Message) -> bytes:
    """Return a message's bytes.

    Raises:
        WireError: A value is not plain, an array is of a type or shape that is not sent, or the message is
            too large.
    """
    arrays = message.arrays
    layout = tuple([(name, array.dtype, array.shape) for name, array in arrays.items()])
    dtypes, pads, listed = _listed(layout)
    head = _head(message.kind, message.values, listed) if message.values else _bare_head(message.kind, listed)
    parts: list[bytes] = [head, bytes(-len(head) % ALIGNED)]
    for array, dtype, pad in zip(arrays.values(), dtypes, pads, strict=True):
        parts += ((array if dtype is None else array.astype(dtype)).tobytes(), pad)
    size = LENGTHS.size - 4 + sum(map(len, parts))
    if len(head) > LARGEST_HEAD or size > LARGEST:
        raise WireError(f"the message has {size} bytes, {len(head)} of them values: more than is sent")
    return b"".join((LENGTHS.pack(size, len(head), message.number), *parts))


@lru_cache(maxsize=MOST_KEPT)
def _listed(layout: tuple) -> tuple[list[np.dtype | None], list[bytes], bytes]:
    """Return what arrays are converted to, the zeros behind each, and the list of the arrays in a head.

    Raises:
        WireError: One is of a type that is not sent.
    """
    dtypes, pads, listed = [], [], []
    for name, dtype, shape in layout:
        if dtype not in _NAMES:
            raise WireError(f"the array {name!r} is of type {dtype}, not of {', '.join(DTYPES)}")
        sent = DTYPES[_NAMES[dtype]]
        dtypes.append(None if dtype == sent else sent)
        pads.append(bytes(-math.prod(shape) * dtype.itemsize % ALIGNED))
        listed.append((name, _NAMES[dtype], shape))
    packed: Any = msgpack.packb(listed)
    return dtypes, pads, packed


def _head(kind: str, values: Mapping[str, Any], listed: bytes) -> bytes:
    if not _is_plain(values):
        raise WireError("a value is not plain: give texts, numbers, and lists and dicts of them")
    try:
        head: Any = msgpack.packb([kind, values, listed])
    except OverflowError as error:
        raise WireError(f"a value cannot be sent: {error}") from error
    return head


@lru_cache(maxsize=MOST_KEPT)
def _bare_head(kind: str, listed: bytes) -> bytes:
    return _head(kind, {}, listed)


def is_sent(dtype: np.dtype) -> bool:
    """Return whether arrays of a type are sent."""
    return dtype in _NAMES


def frame_size(start: bytes | bytearray | memoryview, largest: int = LARGEST) -> int:
    """Return the number of bytes of a frame, from its first four.

    Raises:
        WireError: It is too large, or too small for a frame.
    """
    size = int.from_bytes(start[:4], "little")
    if not LENGTHS.size - 4 <= size <= largest:
        raise WireError(f"a message of {size} bytes: not from {LENGTHS.size - 4} to {largest}")
    return 4 + size


def decode(frame: bytes | bytearray) -> Message:
    """Return the message of a whole frame; its arrays are writable, and lie in it if it is a bytearray.

    Raises:
        WireError: It is no message.
    """
    try:
        return _decoded(frame)
    except Exception as error:  # what strangers send raises many types, some of them msgpack's own
        raise WireError(f"no message: {error}") from error


def _decoded(frame: bytes | bytearray) -> Message:
    size, head_size, number = LENGTHS.unpack_from(frame)
    if size != len(frame) - 4 or size > LARGEST or head_size > LARGEST_HEAD:
        raise WireError("its lengths do not agree, or are too large")
    head = bytes(frame[LENGTHS.size : LENGTHS.size + head_size])
    kind, values, places, end = _kept(head) if head_size <= LARGEST_KEPT else _parsed(head)
    body = LENGTHS.size + head_size + -head_size % ALIGNED
    if body + end != len(frame):
        raise WireError("its bytes are not those of its arrays")
    if isinstance(frame, bytes):
        frame = bytearray(frame)
    arrays = {each.name: _array(frame, body + each.begin, each) for each in places}
    return Message(kind, deepcopy(values) if values else {}, arrays, number)  # the head may be kept


class _Place(NamedTuple):
    """The place of an array behind the head of a message."""

    name: str
    dtype: np.dtype
    shape: tuple[int, ...]
    begin: int
    end: int


class _Head(NamedTuple):
    """What a head says."""

    kind: str
    values: Mapping[str, Any]
    places: tuple[_Place, ...]
    end: int
    """End of the arrays, counted from the end of the head."""


def _parsed(head: bytes) -> _Head:
    """Return what a head says.

    Raises:
        Exception: The bytes are no head.
    """
    kind, values, layout = msgpack.unpackb(head, strict_map_key=True)
    if kind not in KINDS or not isinstance(values, dict) or not _is_plain(values):
        raise WireError("its head is not [kind, values, arrays]")
    return _Head(kind, values, *_places(layout))


_kept = lru_cache(maxsize=MOST_KEPT)(_parsed)
"""Heads are the same from message to message, as long as the number of agents is."""


def _places(layout: bytes) -> tuple[tuple[_Place, ...], int]:
    """Return where a message's arrays are behind its head, and where they end.

    Raises:
        Exception: The list of the arrays is invalid.
    """
    places, begin = {}, 0
    for name, dtype, shape in msgpack.unpackb(layout):
        is_short = len(places) < MOST_ARRAYS and len(shape) <= MOST_AXES
        if not isinstance(name, str) or name in places or not is_short or not all(map(_is_size, shape)):
            raise WireError("an array is not [name, dtype, shape], or there are too many")
        end = begin + math.prod(shape) * DTYPES[dtype].itemsize
        places[name] = _Place(name, DTYPES[dtype], tuple(shape), begin, end)
        begin = end + -end % ALIGNED
    return (*places.values(),), begin


def _array(frame: bytearray, begin: int, place: _Place) -> NDArray:
    """Return an array in the frame."""
    array: NDArray = np.ndarray(place.shape, place.dtype, frame, begin)
    if place.dtype.kind == "b":
        end = begin + place.end - place.begin
        if frame[begin:end].strip(b"\0\1"):  # a byte is neither
            np.minimum(array.view(np.uint8), 1, out=array.view(np.uint8))
    return array


def _is_size(size: Any) -> bool:
    return isinstance(size, int) and not isinstance(size, bool) and 0 <= size <= LARGEST


def _is_plain(value: Any, depth: int = 0) -> bool:
    """Return whether a value consists of texts, numbers, lists and dicts, in at most `DEEPEST` levels."""
    if isinstance(value, dict):
        if not all(isinstance(key, str) for key in value):
            return False
        value = [*value.values()]
    if isinstance(value, list | tuple):
        return depth < DEEPEST and all(_is_plain(each, depth + 1) for each in value)
    return isinstance(value, _PLAIN)
