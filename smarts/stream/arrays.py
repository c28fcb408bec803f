"""Arrays inside messages: `{"t": type, "d": bytes}`, little-endian.

With `z` the bytes are compressed by zlib, and `n` is their number before. With `e` 1 they are *runs*: first
differences within each run, which begins with its first value; zigzag, so that small numbers of either sign
have small codes; and shuffled: all first bytes, then all second bytes, and so on.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Longs

_WORTH_COMPRESSING = 128
"""Bytes of an array; smaller ones are sent as they are."""
_KINDS = "u1", "i1", "i2", "u2", "i4", "u4", "f4", "f8"
_TYPES = {kind: np.dtype(f"<{kind}") for kind in _KINDS}

Packed = dict[str, Any]


def packed_array(values: NDArray, *, compress: bool = True) -> Packed:
    """Return an array as it is inside a message; booleans become u1, 64-bit integers i4."""
    sent = {"b": "u1", "i": f"i{min(values.itemsize, 4)}"}
    kind = sent.get(values.dtype.kind, values.dtype.str.lstrip("<>|="))
    return {"t": kind, **_data(np.ascontiguousarray(values, _TYPES[kind]).tobytes(), compress)}


def packed_runs(values: NDArray, first: Bools, *, turn: int = 0, compress: bool = True) -> Packed:
    """Return whole numbers that change little within runs.

    Args:
        values: Values of at most 32 bits, shape (N,).
        first: Which of them begin a run, shape (N,).
        turn: Units of a whole turn, for angles. Readers get angles without jumps.
        compress: Whether to spend time on making it small.
    """
    change = np.diff(values.astype(np.int64), prepend=0)
    if turn:
        change = (change + turn // 2) % turn - turn // 2
    change = np.where(first, values, change).astype(np.int32)
    codes = ((change << 1) ^ (change >> 31)).astype("<u4")
    return {"t": "i4", "e": 1, **_data(codes.view(np.uint8).reshape(-1, 4).T.tobytes(), compress)}


def unpacked_array(packed: Packed) -> NDArray:
    """Return the array that `packed_array` packed."""
    return np.frombuffer(_bytes(packed), _TYPES[packed["t"]])


def unpacked_runs(packed: Packed, start: Longs) -> NDArray[np.int32]:
    """Return the values of an array, which may be of runs.

    Args:
        packed: The array.
        start: Where each run begins, increasing from 0; shape (R,).
    """
    if packed.get("e") != 1:
        return unpacked_array(packed).astype(np.int32)
    planes = np.frombuffer(_bytes(packed), np.uint8).reshape(4, -1)
    codes = np.ascontiguousarray(planes.T).view("<u4").ravel().astype(np.int64)
    if not len(codes):
        return np.zeros(0, np.int32)
    total = np.cumsum((codes >> 1) ^ -(codes & 1))
    before = np.where(start > 0, total[start - 1], 0)
    # Sums wrap as they do in 32 bits, so that a reader in another language finds the same.
    return (total - np.repeat(before, np.diff(start, append=len(codes)))).astype(np.int32)


def _data(data: bytes, compress: bool) -> Packed:
    if compress and len(data) >= _WORTH_COMPRESSING:
        small = zlib.compress(data, 6)
        if len(small) < len(data):
            return {"d": small, "z": True, "n": len(data)}
    return {"d": data}


def _bytes(packed: Packed) -> bytes:
    """Return the bytes of an array, decompressed."""
    return zlib.decompress(packed["d"]) if packed.get("z") else packed["d"]
