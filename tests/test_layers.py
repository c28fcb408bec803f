"""The import structure: a file imports its own package or a lower layer, never sideways or up."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

LAYERS = [
    {"smarts", "smarts.errors", "smarts.registry", "smarts.config", "smarts.geometry"},
    {"smarts.types"},
    {"smarts.roads"},
    {"smarts.sstudio", "smarts.agents"},
    {"smarts.sensors", "smarts.dynamics", "smarts.bubbles"},
    {"smarts.controllers", "smarts.planners"},
    {"smarts.providers"},
    {"smarts.sim"},
    {"smarts.zoo", "smarts.env", "smarts.envision"},
    {"algorithms"},
    {"benchmark"},
]
LAYER = {package: number for number, packages in enumerate(LAYERS) for package in packages}
ALIASES = "smarts.core"
"""Re-exports of lower layers under the original's names: nothing of ours may depend on them."""

THIRD_PARTY = {
    "libsumo": "smarts/providers/sumo_library.py",
    "sumolib": "smarts/roads/",
    "pybullet": "smarts/dynamics/",
    "casadi": "smarts/planners/",
    "ray": ("algorithms/", "benchmark/", "smarts/env/", "smarts/agents/"),
    "torch": ("algorithms/", "benchmark/", "smarts/zoo/"),
    "matplotlib": ("smarts/envision/", "benchmark/"),
    "typer": "benchmark/",
}

FILES = sorted(file for top in ("smarts", "algorithms", "benchmark") for file in (ROOT / top).rglob("*.py"))


def package_of(module: str) -> str:
    """Return the unit that layers are assigned to: `smarts.roads.atlas` -> `smarts.roads`."""
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] == "smarts" else parts[0]


def imports_of(file: Path) -> set[str]:
    """Return every module a file imports, wherever in the file, relative imports resolved.

    `from package import name` counts as `package.name` too, since `name` may be a submodule.
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
    """Return what a file imports although it must not."""
    module = ".".join(file.relative_to(ROOT).with_suffix("").parts)
    here = package_of(module.removesuffix(".__init__"))
    place = str(file.relative_to(ROOT))
    found = []
    for imported in sorted(imports):
        there = package_of(imported)
        top = imported.split(".")[0]
        if top in THIRD_PARTY and not place.startswith(THIRD_PARTY[top]):
            found.append(f"{imported}: only {THIRD_PARTY[top]} may import it")
        if there == here or there not in LAYER | {ALIASES: 0}:
            continue
        if there == ALIASES:
            found.append(f"{imported}: aliases are for scenario files only")
        elif here != ALIASES and LAYER[there] >= LAYER[here]:
            found.append(f"{imported}: layer {LAYER[there]} from layer {LAYER[here]}")
        elif here == "algorithms":
            found.append(f"{imported}: algorithms import nothing of smarts")
    return found


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_imports_only_lower_layers(file):
    assert violations(file, imports_of(file)) == []


def test_every_package_has_a_layer():
    packages = {package_of(".".join(file.relative_to(ROOT).with_suffix("").parts)) for file in FILES}
    assert packages - {"smarts.__init__"} - set(LAYER) == {ALIASES}


@pytest.mark.parametrize(
    ("place", "source"),
    [
        ("smarts/roads/a.py", "from smarts.sstudio import types"),
        ("smarts/roads/a.py", "def f():\n    import smarts.sim.roster"),
        ("smarts/roads/a.py", "from ..sim import roster"),
        ("smarts/roads/a.py", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import smarts.sim"),
        ("smarts/sensors/a.py", "import smarts.bubbles"),
        ("smarts/sstudio/a.py", "from smarts.core.colors import Colors"),
        ("smarts/providers/a.py", "import libsumo"),
        ("algorithms/a.py", "from smarts.errors import SmartsError"),
        ("smarts/sim/a.py", "import importlib\nimportlib.import_module('benchmark.cli')"),
    ],
)
def test_the_check_itself_finds(tmp_path, monkeypatch, place, source):
    monkeypatch.setattr(f"{__name__}.ROOT", tmp_path)
    file = tmp_path / place
    file.parent.mkdir(parents=True)
    file.write_text(source)
    assert violations(file, imports_of(file))
