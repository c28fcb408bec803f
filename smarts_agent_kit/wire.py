"""Messages between the simulator and agents, and their bytes.

A message is msgpack of its kind, its number, its plain values, and the name, type, shape and little-endian
bytes of each array. Whatever else arrives is a `WireError`: nothing is executed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

VERSION = 3
"""Version of the protocol; both sides need the same."""
LARGEST = 8 * 2**20
"""The most bytes of a message."""
DTYPES = {
    each: np.dtype(each)
    for each in ("|b1", "|i1", "|u1", "<i2", "<u2", "<i4", "<u4", "<i8", "<u8", "<f4", "<f8")
}
"""The types of arrays that are sent, by name."""
_NAMES = {dtype: name for name, dtype in DTYPES.items()}
KINDS = ("hello", "proof", "make", "about", "act", "acted", "failed", "refused")
"""The kinds of messages."""


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
        WireError: A value is not plain, an array is of a type that is not sent, or the message is too large.
    """
    arrays = [_packed(name, array) for name, array in message.arrays.items()]
    try:
        packed: Any = msgpack.packb([message.kind, message.number, message.values, arrays])
    except (TypeError, ValueError, OverflowError) as error:
        raise WireError(f"a value cannot be sent: {error}") from error
    if len(packed) > LARGEST:
        raise WireError(f"the message has {len(packed)} bytes: more than is sent")
    return packed


def _packed(name: str, array: NDArray) -> tuple[str, str, tuple[int, ...], bytes]:
    if not is_sent(array.dtype):
        raise WireError(f"the array {name!r} is of type {array.dtype}, not of {', '.join(DTYPES)}")
    return name, _NAMES[array.dtype], array.shape, array.tobytes()


def is_sent(dtype: np.dtype) -> bool:
    """Return whether arrays of a type are sent."""
    return dtype in _NAMES


def decode(packed: bytes | bytearray) -> Message:
    """Return the message of bytes.

    Raises:
        WireError: They are no message.
    """
    try:
        return message_of(msgpack.unpackb(packed))
    except Exception as error:  # what strangers send raises many types, some of them msgpack's own
        raise WireError(f"no message: {error}") from error


def message_of(unpacked: Any) -> Message:
    """Return the message of what msgpack has unpacked.

    Raises:
        WireError: It is none.
    """
    try:
        kind, number, values, arrays = unpacked
        message = Message(kind, values, {name: _array(*rest) for name, *rest in arrays}, number)
    except (TypeError, ValueError, KeyError) as error:
        raise WireError(f"no message: {error}") from error
    if kind not in KINDS or not isinstance(values, dict):
        raise WireError("its beginning is not [kind, number, values]")
    return message


def _array(dtype: str, shape: Sequence[int], data: bytes) -> NDArray:
    """Return an array of the receiver's own."""
    return np.frombuffer(bytearray(data), DTYPES[dtype]).reshape(shape)
