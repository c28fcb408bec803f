"""Shares code and constants between copies of a library.

Copies of a library are different files, so the operating system keeps the code of each in separate memory,
and simulations that take turns evict each other's code from the processor's caches: with eight copies of
libsumo, this costs a fifth of the time (measured at commit 144a0e77). The copies' code is identical byte by
byte: it is position-independent, and the loader writes only to data. So the code pages of every copy are
mapped from one file, and caches, which use physical addresses, hold them once. Constants are shared
likewise. A copy keeps only its data; the rest of its file is freed.
"""

from __future__ import annotations

import ctypes
import mmap
import os
from pathlib import Path
from typing import NamedTuple

_MAP_FIXED = 0x10
_FAILED = ctypes.c_void_p(-1).value
_KEEP_SIZE, _PUNCH_HOLE = 1, 2
_PROTECTIONS = {"r": mmap.PROT_READ, "w": mmap.PROT_WRITE, "x": mmap.PROT_EXEC}


class Mapping(NamedTuple):
    """A range of this process' memory that is mapped from a file."""

    begin: int
    end: int
    offset: int
    """Position in the file [bytes]."""
    access: str
    """Permissions as in /proc/self/maps: `r-xp`."""


def share_code(copy: int, original: Path) -> None:
    """Map the code and constants of a loaded library from another file with the same content.

    If the system does not allow it, the library keeps its own pages, which is slower and takes more memory.

    Args:
        copy: Descriptor of the library's file, which nothing else uses.
        original: The file to share.
    """
    with open(original, "rb") as file, mmap.mmap(file.fileno(), 0, prot=mmap.PROT_READ) as whole:
        mapped = mappings_of(copy)
        if not mapped:
            return
        own = [part for part in mapped if not _replaced(part, file.fileno(), whole)]
        kept = [(part.offset, part.offset + part.end - part.begin) for part in own]
        _free_all_but(copy, sorted(kept), len(whole))


def mappings_of(file: int) -> list[Mapping]:
    """Return the mappings of an open file in this process."""
    found, status = [], os.fstat(file)
    for line in Path("/proc/self/maps").read_text().splitlines():
        span, access, offset, device, number, *_ = line.split(maxsplit=5)
        # Files of other file systems may have the same inode number.
        if int(number) == status.st_ino and _device_of(device) == status.st_dev:
            begin, end = span.split("-")
            found.append(Mapping(int(begin, 16), int(end, 16), int(offset, 16), access))
    return found


def _device_of(numbers: str) -> int:
    major, minor = numbers.split(":")
    return os.makedev(int(major, 16), int(minor, 16))


def _replaced(part: Mapping, original: int, whole: mmap.mmap) -> bool:
    """Replace a mapping by the same part of the original, unless it was written to; return whether it was."""
    if "r" not in part.access:
        # A gap that the linker leaves between segments; it is unused.
        return True
    library = ctypes.CDLL(None)
    library.memcmp.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_size_t]
    library.mmap.restype = ctypes.c_void_p
    library.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
    size = part.end - part.begin
    if "x" not in part.access:
        content = whole[part.offset : part.offset + size]
        if library.memcmp(part.begin, content, len(content)) != 0:
            return False
    protection = sum(bit for sign, bit in _PROTECTIONS.items() if sign in part.access)
    flags = mmap.MAP_PRIVATE | _MAP_FIXED
    # One call replaces the pages atomically, so other threads may execute them meanwhile.
    return library.mmap(part.begin, size, protection, flags, original, part.offset) != _FAILED


def _free_all_but(file: int, kept: list[tuple[int, int]], size: int) -> None:
    """Free the storage of a file except for the ranges `kept`, if the file system supports it."""
    library = ctypes.CDLL(None)
    library.fallocate.argtypes = [ctypes.c_int, ctypes.c_int, ctypes.c_long, ctypes.c_long]
    begin = 0
    for first, last in [*kept, (size, size)]:
        if first > begin:
            library.fallocate(file, _PUNCH_HOLE | _KEEP_SIZE, begin, first - begin)
        begin = max(begin, last)
