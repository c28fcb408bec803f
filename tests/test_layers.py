"""The import structure: a file imports only from its own package or from lower layers."""

import ast
import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def layers() -> dict[str, int]:
    """Return package -> layer, from the table in CONTRIBUTING.md; lower layers may be imported."""
    found = {}
    for line in (ROOT / "CONTRIBUTING.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) > 2 and cells[1].isdecimal():
            for path in re.findall("`(.+?)`", cells[2]):
                found[path.removesuffix(".py").strip("/").replace("/", ".")] = int(cells[1])
    return found


LAYER = layers()
TOPS = ("smarts", "benchmark")
"""Packages that hold only packages."""
ALIASES = "smarts.core"
"""Re-exports under the original SMARTS' names, which no other package may import."""

THIRD_PARTY = {
    "libsumo": "smarts/providers/sumo_library.py",
    "sumolib": "smarts/roads/",
    "pybullet": "smarts/dynamics/",
    "casadi": "smarts/planners/",
    "ray": ("algorithms/", "benchmark/", "smarts/env/", "smarts/agents/"),
    "torch": ("algorithms/", "benchmark/", "smarts/zoo/"),
    "matplotlib": ("smarts/envision/", "benchmark/"),
    "typer": "benchmark/",
    "msgpack": ("smarts_agent_kit/", "smarts/stream/"),
    "starlette": "smarts/envision/",
    "uvicorn": "smarts/envision/",
    "av": "smarts/envision/",
    "websockets": ("smarts/envision/", "smarts/sim/outlet.py"),
}

FILES = sorted(
    file
    for top in ("smarts_agent_kit", "smarts", "algorithms", "benchmark")
    for file in (ROOT / top).rglob("*.py")
)


def package_of(module: str) -> str:
    """Return the package of a module that has a layer: `smarts.roads.atlas` -> `smarts.roads`."""
    parts = module.removesuffix(".__init__").split(".")
    return ".".join(parts[:2]) if parts[0] in TOPS else parts[0]


def imports_of(file: Path) -> set[str]:
    """Return every module that a file imports anywhere, with relative imports resolved.

    `from package import name` also yields `package.name`, since `name` may be a submodule.
    """
    module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
    package = module.removesuffix(".__init__") if file.name == "__init__.py" else module.rpartition(".")[0]
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            source = ".".join([*base, *([node.module] if node.module else [])])
            found.update({source} | {f"{source}.{alias.name}" for alias in node.names})
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
            if name == "import_module" and node.args and isinstance(node.args[0], ast.Constant):
                found.add(str(node.args[0].value))
    return found


def violations(file: Path, imports: set[str]) -> list[str]:
    """Return the forbidden imports of a file, with reasons."""
    module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
    here = package_of(module)
    place = str(file.relative_to(ROOT))
    found = []
    for imported in sorted(imports):
        there = package_of(imported)
        top = imported.split(".")[0]
        if top in THIRD_PARTY and not place.startswith(THIRD_PARTY[top]):
            found.append(f"{imported}: only {THIRD_PARTY[top]} may import it")
        if there in (here, *TOPS) or there not in LAYER | {ALIASES: 0}:
            continue
        if here in TOPS and here not in LAYER:
            found.append(f"{imported}: {here} itself holds nothing")
        elif there == ALIASES:
            found.append(f"{imported}: aliases are for scenario files only")
        elif here != ALIASES and LAYER[there] >= LAYER[here]:
            found.append(f"{imported}: layer {LAYER[there]} from layer {LAYER[here]}")
        elif here == "algorithms":
            found.append(f"{imported}: algorithms import nothing of smarts")
    return found


def test_files_import_only_lower_layers():
    assert {file: wrong for file in FILES if (wrong := violations(file, imports_of(file)))} == {}


def test_the_kit_needs_numpy_and_msgpack_only():
    files = (ROOT / "smarts_agent_kit").glob("*.py")
    tops = {name.partition(".")[0] for file in files for name in imports_of(file)}
    assert tops - sys.stdlib_module_names <= {"numpy", "msgpack", "smarts_agent_kit"}


def test_every_package_has_a_layer():
    packages = {package_of(".".join(file.relative_to(ROOT).with_suffix("").parts)) for file in FILES}
    assert packages == {*LAYER, *TOPS, ALIASES}


def cycles(imports: Mapping[str, set[str]]) -> list[list[str]]:
    """Return the groups of modules that import each other, directly or not."""
    reached = {module: set(found) & imports.keys() for module, found in imports.items()}
    for middle in imports:
        for module in imports:
            if middle in reached[module]:
                reached[module] |= reached[middle]
    rings = {frozenset(m for m in imports if m in reached[n] and n in reached[m]) for n in imports}
    return sorted(sorted(ring) for ring in rings if ring)


def modules_of(files: Iterable[Path]) -> dict[str, set[str]]:
    """Return module -> its imports, without `__init__` files, which only re-export."""
    return {
        ".".join(file.relative_to(ROOT).with_suffix("").parts): imports_of(file)
        for file in files
        if file.name != "__init__.py"
    }


def test_no_modules_import_each_other():
    assert cycles(modules_of(FILES)) == []
