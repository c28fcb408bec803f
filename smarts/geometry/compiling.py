"""Compiled kernels, and a cache on disk that knows everything they were compiled from."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from numba import njit


def kernel(function: Callable) -> Any:
    """Compile a function with numba when it is first called, and keep the machine code on disk.

    Numba's own cache looks at the time stamp of the function's file only, and so goes on with old code after
    a change to another file: to a kernel that is called, a constant, or the fields of a named tuple. Here the
    entry's name holds a digest of the function's module and of all modules of this project that it uses.
    """
    function.__qualname__ += f"_{_digest(function.__module__)}"
    return njit(cache=True, error_model="numpy")(function)


@cache
def _digest(module_name: str) -> str:
    """Return a digest of a module's source and of those of its project's modules that it has names from.

    It is asked for by the module's first kernel, when all imports at the module's top have run.
    """
    module = sys.modules[module_name]
    used = {_origin(value) for value in vars(module).values()} - {module_name}
    content = hashlib.blake2b(Path(str(module.__file__)).read_bytes(), digest_size=6)
    for name in sorted(used):
        if name.partition(".")[0] == module_name.partition(".")[0]:
            content.update(_digest(name).encode())
    return content.hexdigest()


def _origin(value: object) -> str:
    return value.__name__ if isinstance(value, ModuleType) else str(getattr(value, "__module__", ""))
