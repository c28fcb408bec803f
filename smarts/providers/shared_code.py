"""One machine code for all copies of a library.

Copies of a library are files of their own, so the kernel keeps the code of each in memory of its own, and
simulations that take turns push each other's code out of the processor's caches: with eight copies of
libsumo that costs a fifth of the time (`perf/traffic.py`). Their code is the same, byte by byte, for it is
position-independent and the loader writes only into data. So every copy's code pages are mapped from one
file instead, and caches, which go by physical address, hold them once. The data of the copies stay apart.
"""

from __future__ import annotations

import ctypes
import mmap
import os
from pathlib import Path

_MAP_FIXED = 0x10
_FAILED = ctypes.c_void_p(-1).value
_CODE = "r-xp"


def share_code(copy: Path, original: Path) -> None:
    """Let a loaded library run the code of a file with the same content.

    Where the system does not let it, the library goes on with its own, which is only slower.

    Args:
        copy: The library's file.
        original: The other file.
    """
    call = ctypes.CDLL(None).mmap
    call.restype = ctypes.c_void_p
    call.argtypes = [ctypes.c_void_p, ctypes.c_size_t, *[ctypes.c_int] * 3, ctypes.c_long]
    file = os.open(original, os.O_RDONLY)
    try:
        for begin, end, offset in code_of(copy):
            protection, flags = mmap.PROT_READ | mmap.PROT_EXEC, mmap.MAP_PRIVATE | _MAP_FIXED
            # One call puts the new pages in the place of the old ones, so it does not matter who runs there.
            if call(begin, end - begin, protection, flags, file, offset) == _FAILED:
                return
    finally:
        os.close(file)


def code_of(library: Path) -> list[tuple[int, int, int]]:
    """Return where the code of a file is in this process: begin, end, and offset in the file."""
    found = []
    for line in Path("/proc/self/maps").read_text().splitlines():
        span, access, offset, _, _, *path = line.split(maxsplit=5)
        if access == _CODE and path == [str(library)]:
            begin, end = span.split("-")
            found.append((int(begin, 16), int(end, 16), int(offset, 16)))
    return found
