"""No module draws from process-wide random state: every draw comes from `smarts.types.streams`."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FILES = sorted(file for top in ("smarts", "algorithms", "benchmark") for file in (ROOT / top).rglob("*.py"))

ALLOWED = {"Generator", "Philox", "BitGenerator", "SeedSequence"}
"""Names of `numpy.random` that construct or annotate separate generators."""

SEEDING = ("smarts/sstudio/runner.py", "_seed_global_generators")
"""The only exemption: users' scenario files may draw from global state, in a process that seeds it."""


def draws(source: str, exempt: str | None = None) -> list[str]:
    """Return the uses of process-wide random state in a file, outside the function named `exempt`."""
    tree = ast.parse(source)
    inside = {
        id(node)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef) and function.name == exempt
        for node in ast.walk(function)
    }
    found = []
    for node in ast.walk(tree):
        if id(node) in inside:
            continue
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names if alias.name in ("random", "numpy.random")]
        elif isinstance(node, ast.ImportFrom) and node.module in ("random", "numpy.random"):
            found += [alias.name for alias in node.names if alias.name not in ALLOWED]
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) in ("np.random", "numpy.random"):
            found += [node.attr] if node.attr not in ALLOWED else []
    return found


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_no_file_draws_from_globals(file):
    exempt = SEEDING[1] if str(file.relative_to(ROOT)) == SEEDING[0] else None
    assert draws(file.read_text(), exempt) == []


@pytest.mark.parametrize(
    "source",
    [
        "import random",
        "from random import choice",
        "import numpy as np\nnp.random.seed(1)",
        "import numpy as np\nnp.random.default_rng()",
        "from numpy.random import uniform",
        "def f():\n    import random",
    ],
)
def test_the_check_finds_draws(source):
    assert draws(source)
