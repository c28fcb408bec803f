"""Digests of users' own code, by which results tell the versions of it apart."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from benchmark.experiment.version import syntax_tree
from smarts.registry import import_own, is_own_name, place_of_module
from smarts.sstudio.encoding import digest

PROGRAM = frozenset(("algorithms", "benchmark", "smarts"))
"""The packages of this program."""
_AGENT = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[\w-]+-v\d+")
"""`module:name-v0`, an agent of the zoo."""


def own_digests(imports: Iterable[str], *parts: Any) -> dict[str, str]:
    """Return a digest of the code behind each `module:Class` and each agent in parts of a config.

    A digest covers the module, and what it imports from its own package and from `imports`, directly or
    indirectly. Comments, docstrings and layout do not change it. Imports inside strings (`importlib`) are not
    followed. Modules of this program have no digest: the commit of a run stands for them.

    Args:
        imports: Files and folders of own code.
        parts: Names, and dicts and lists that hold some.

    Returns:
        Name -> digest; without names whose module has no source file.

    Raises:
        OwnCodeError: A file or folder of `imports` does not exist.
    """
    names = code_names(parts)
    import_own(imports if names else ())
    roots = {Path(path).stem for path in imports}
    own = [name for name in names if name.partition(":")[0].partition(".")[0] not in PROGRAM - roots]
    sources = {name: _sources(name.partition(":")[0], roots) for name in own}
    return {name: digest(sorted(found.items()), size=8) for name, found in sources.items() if found}


def own_names(part: Any) -> list[str]:
    """Return each `module:Class` in a part of a config once, sorted."""
    return names_in(part, is_own_name)


def code_names(part: Any) -> list[str]:
    """Return each `module:Class`, and each agent `module:name-v0`, in a part of a config once, sorted."""
    return names_in(part, lambda name: is_own_name(name) or _AGENT.fullmatch(name) is not None)


def names_in(part: Any, wanted: Callable[[str], bool]) -> list[str]:
    """Return each text that is wanted, at any depth of dicts and lists, once, sorted."""
    if isinstance(part, dict):
        part = [*part, *part.values()]
    if isinstance(part, list | tuple):
        return sorted({name for each in part for name in names_in(each, wanted)})
    return [part] if isinstance(part, str) and wanted(part) else []


def _sources(module: str, roots: set[str]) -> dict[str, str]:
    """Return module name -> syntax tree of a module and its imports, as far as they are own code."""
    roots = {module.partition(".")[0], *roots}
    found: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        file = None if name.partition(".")[0] not in roots or name in found else _file_of(name)
        if file is None:
            continue
        text = file.read_text(encoding="utf-8", errors="replace")
        try:
            tree = ast.parse(text)
        except SyntaxError:  # of a module that is imported late, or never
            found[name] = text
            continue
        found[name] = syntax_tree(text)
        package = name if file.name == "__init__.py" else name.rpartition(".")[0]
        waiting += [*_imported(tree, package), name.rpartition(".")[0]]
    return found


def _imported(tree: ast.AST, package: str) -> Iterator[str]:
    """Yield the names of modules that a syntax tree may import."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield from (base, *(f"{base}.{alias.name}" for alias in node.names))


def _file_of(module: str) -> Path | None:
    """Return the source file of a module, which is not imported; None without one."""
    top, *inner = module.split(".")
    place = place_of_module(top) if top else None
    if place is None:
        return None
    path = place.joinpath(*inner)
    files = (path, path / "__init__.py", path.with_suffix(".py"))
    return next((file for file in files if file.suffix == ".py" and file.is_file()), None)
