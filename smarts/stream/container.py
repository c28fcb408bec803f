"""Sequences of messages as bytes. `smarts.stream` describes the format.

A message is a msgpack map with the key `type`. A compact episode is `MAGIC`, then messages, each behind its
length; a live stream is the same messages, one in each WebSocket frame.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import msgpack

from smarts.errors import RecordError

VERSION = 1
"""Version of the format of messages."""
MAGIC = b"SMARTSEP"
"""The first bytes of a compact episode."""
MOST_BYTES = 8 << 20
"""Largest size of a message."""

_LENGTH = struct.Struct("<I")

Message = Mapping[str, Any]


def pack(message: Message) -> bytes:
    """Return the bytes of one message.

    Raises:
        RecordError: It is larger than `MOST_BYTES`.
    """
    packed: bytes = msgpack.packb(message)  # pyright: ignore[reportAssignmentType] -- it is never None
    if len(packed) > MOST_BYTES:
        raise RecordError(
            f"a message '{message['type']}' of {len(packed)} bytes",
            place="the stream",
            remedy=f"send it in parts of at most {MOST_BYTES} bytes",
        )
    return packed


def unpack(packed: bytes) -> dict[str, Any]:
    """Return the message in some bytes.

    Raises:
        RecordError: The bytes are no message.
    """
    if len(packed) > MOST_BYTES:
        raise _damaged(f"it has {len(packed)} bytes")
    try:
        message = msgpack.unpackb(packed)
    except (ValueError, TypeError, RecursionError, msgpack.exceptions.UnpackException) as error:
        raise _damaged(f"no msgpack: {error}") from error
    if not isinstance(message, dict) or not isinstance(message.get("type"), str):
        raise _damaged("it has no type")
    return message


def _damaged(problem: str) -> RecordError:
    return RecordError(f"no message: {problem}", place="the stream", remedy="use one version on both sides")


def framed(messages: Iterable[Message]) -> Iterator[bytes]:
    """Yield a compact episode, message by message."""
    yield MAGIC
    for message in messages:
        packed = pack(message)
        yield _LENGTH.pack(len(packed)) + packed
