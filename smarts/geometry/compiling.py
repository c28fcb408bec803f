"""Numba kernels with a disk cache keyed by all source files that a kernel depends on."""

from __future__ import annotations

import ast
import hashlib
import logging
import sys
from collections.abc import Callable
from functools import cache
from importlib.util import resolve_name
from pathlib import Path
from types import CodeType
from typing import Any, Self

from numba import config
from numba.core.event import Event, Listener, register, unregister

from smarts.geometry.linking import Kernel


def kernel(function: Callable) -> Any:
    """Compile a function with numba at its first call, and cache the machine code on disk.

    Numba's own cache checks only the function's file, and so reuses stale code after a change in another
    module: a kernel that is called, a constant, the fields of a named tuple. Here the name of a cache entry
    holds a digest of the function's module and of all project modules that it imports, directly or not.
    """
    _log_compiling()
    _kernels.add(function.__code__)
    function.__qualname__ += f"_{sources_digest(function.__module__)}"
    return function if vars(config)["DISABLE_JIT"] else Kernel(function)


_kernels: set[CodeType] = set()
"""Code of all kernels: the notice ignores functions that users compile with numba."""


class _CompileNotice(Listener):
    """Logs once that kernels are being compiled; kernels from the cache cause no message."""

    def __init__(self) -> None:
        self._is_logged = False

    def on_start(self, event: Event) -> None:
        if not self._is_logged and event.data and event.data["dispatcher"].py_func.__code__ in _kernels:
            self._is_logged = True
            logging.getLogger("smarts").warning(
                "compiling kernels, once after an installation or a change: half a minute for an environment"
                " (`smarts-bench compile` compiles all of them at once)"
            )

    def on_end(self, event: Event) -> None:
        pass


class Compilations(Listener):
    """Counts functions that numba compiles, without cache hits: `with Compilations() as compiled: ...`."""

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> Self:
        register("numba:compile", self)
        return self

    def __exit__(self, *error: object) -> None:
        unregister("numba:compile", self)

    def on_start(self, event: Event) -> None:
        """Count a compilation."""
        self.count += 1

    def on_end(self, event: Event) -> None:
        """Do nothing."""


@cache
def _log_compiling() -> None:
    register("numba:compile", _CompileNotice())


@cache
def sources_digest(module_name: str) -> str:
    """Return a digest of the sources of a module and of all project modules that it imports, directly or not.

    Imports are read from the sources, since a constant does not record its module. Files are found without
    importing them, so the digest does not depend on the modules loaded so far.
    """
    own = Path(str(sys.modules[module_name].__file__))
    projects = {module_name.partition(".")[0], __name__.partition(".")[0]}
    # The main program's module name, `__main__`, is not that of its file.
    found, ahead = {own}, [(own, module_name)]
    while ahead:
        for name in _imports(*ahead.pop()):
            file = _file(name) if name.partition(".")[0] in projects else None
            if file is not None and file not in found:
                found.add(file)
                ahead.append((file, name))
    content = hashlib.blake2b(digest_size=6)
    for source in sorted(hashlib.blake2b(file.read_bytes()).digest() for file in found):
        content.update(source)
    return content.hexdigest()


@cache
def _imports(file: Path, module_name: str) -> frozenset[str]:
    """Return the names of modules that a file may import: `from a import b` yields `a` and `a.b`."""
    package = module_name if file.name == "__init__.py" else module_name.rpartition(".")[0]
    names: set[str] = set()
    ahead: list[ast.AST] = [ast.parse(file.read_bytes())]
    while ahead:
        node = ahead.pop()
        # Visit only statements: also walking expressions would take twice as long.
        for block in ("body", "orelse", "handlers", "finalbody"):
            ahead += getattr(node, block, ())
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = resolve_name("." * node.level + (node.module or ""), package)
            names.add(origin)
            names.update(f"{origin}.{alias.name}" for alias in node.names)
    return frozenset(names)


@cache
def _file(module_name: str) -> Path | None:
    """Return the source file of a module whose top-level package is loaded, or None if there is none."""
    top, *parts = module_name.split(".")
    for folder in getattr(sys.modules.get(top), "__path__", ()):
        place = Path(folder, *parts)
        for file in (place / "__init__.py", place.with_suffix(".py") if parts else place):
            if file.is_file():
                return file
    return None
