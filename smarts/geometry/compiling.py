"""Compiled kernels, and a cache on disk that knows everything they were compiled from."""

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
    """Compile a function with numba when it is first called, and keep the machine code on disk.

    Numba's own cache looks at the function's file only, and so reuses stale code after a change to
    another: to a kernel that is called, a constant, or the fields of a named tuple. Here the entry's name
    holds a digest of the function's module and of all modules of this project that it imports, itself or by
    way of others.
    """
    _tell_of_compiling()
    _kernels.add(function.__code__)
    function.__qualname__ += f"_{sources_digest(function.__module__)}"
    return function if vars(config)["DISABLE_JIT"] else Kernel(function)


_kernels: set[CodeType] = set()
"""Of what was handed to `kernel`; users may compile functions of their own."""


class _Notice(Listener):
    """Says once why nothing happens for a while: machine code that is in the cache is not compiled."""

    def __init__(self) -> None:
        self._is_said = False

    def on_start(self, event: Event) -> None:
        if not self._is_said and event.data and event.data["dispatcher"].py_func.__code__ in _kernels:
            self._is_said = True
            logging.getLogger("smarts").warning(
                "compiling kernels, once after an installation or a change: half a minute for an environment"
                " (`smarts-bench compile` compiles all of them at once)"
            )

    def on_end(self, event: Event) -> None:
        pass


class Compilations(Listener):
    """Counts what numba compiles, but for what is in the cache, as `with Compilations() as compiled: ...`."""

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> Self:
        register("numba:compile", self)
        return self

    def __exit__(self, *error: object) -> None:
        unregister("numba:compile", self)

    def on_start(self, event: Event) -> None:
        """Count one."""
        self.count += 1

    def on_end(self, event: Event) -> None:
        """Do nothing."""


@cache
def _tell_of_compiling() -> None:
    register("numba:compile", _Notice())


@cache
def sources_digest(module_name: str) -> str:
    """Return a digest of the sources of a module and of all that it imports from this project.

    The imports are read in the sources, since a number does not say where it was imported from. Their files
    are found without loading them, so that the digest does not depend on what is loaded already.
    """
    own = Path(str(sys.modules[module_name].__file__))
    projects = {module_name.partition(".")[0], __name__.partition(".")[0]}
    # A program's main file goes by another name than its file.
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
    """Return the names of all modules that a file imports, and others: `from a import b` may mean a.b."""
    package = module_name if file.name == "__init__.py" else module_name.rpartition(".")[0]
    names: set[str] = set()
    ahead: list[ast.AST] = [ast.parse(file.read_bytes())]
    while ahead:
        node = ahead.pop()
        # Statements within statements; walking all expressions as well would take twice the time.
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
    """Return the source of a module of a package that is loaded, None if there is no such module."""
    top, *parts = module_name.split(".")
    for folder in getattr(sys.modules.get(top), "__path__", ()):
        place = Path(folder, *parts)
        for file in (place / "__init__.py", place.with_suffix(".py") if parts else place):
            if file.is_file():
                return file
    return None
