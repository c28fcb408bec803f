"""Whether compiled kernels are kept on disk, for these sources, this numba and this processor."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from smarts.errors import SmartsError


class KernelCache(NamedTuple):
    """Of the kernels that are loaded."""

    folders: tuple[Path, ...]
    """In which machine code is kept; they can be written to."""
    kernels: int
    compiled: int
    """Kernels whose machine code is there for these sources, this numba and this processor."""


def kernel_cache(package: str) -> KernelCache:
    """Return what is kept of the kernels of a package, as far as its modules are loaded.

    Raises:
        SmartsError: A folder cannot be written to, so that everything is compiled each time.
    """
    found = {id(each): each for each in _kernels(package)}.values()
    folders = tuple(sorted({Path(each.stats.cache_path) for each in found}))
    for folder in folders:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            raise SmartsError(
                f"cannot be written: {error.strerror or error}",
                place=str(folder),
                remedy="make it writable, or name another folder: NUMBA_CACHE_DIR=...",
            ) from error
    return KernelCache(folders, len(found), sum(map(_is_compiled, found)))


def _kernels(package: str) -> list[Any]:
    from smarts.geometry.linking import Kernel

    modules = [
        module for name, module in sys.modules.items() if name == package or name.startswith(f"{package}.")
    ]
    values = [value for module in modules for value in vars(module).values()]
    return [
        value
        for value in values
        if isinstance(value, Kernel) and f"{value.py_func.__module__}.".startswith(f"{package}.")
    ]


def _is_compiled(kernel: Any) -> bool:
    """Return whether numba would find code of the kernel, of any types of arguments.

    That is machine code for calls from Python, or LLVM code for calls from other kernels.

    Numba has no public way to ask: this is how `Dispatcher.compile` begins. An index of another version of
    numba or of the source counts as empty.
    """
    target = kernel.targetctx.codegen().magic_tuple()
    return any(
        key[1] == target for each in (kernel, kernel.callee) for key in each._cache._cache_file._load_index()
    )
