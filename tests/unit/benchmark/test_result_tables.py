"""The tables of version 1 in README and docs are those of the committed results."""

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def tables():
    spec = importlib.util.spec_from_file_location("tables", ROOT / "results" / "tables.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tables_are_those_of_the_results_and_a_changed_figure_is_found(tables):
    values = tables.read_values()
    for name, named in tables.FILES.items():
        text = (ROOT / name).read_text(encoding="utf-8")
        assert tables.with_tables(text, named, values, name) == text, f"{name}: python results/tables.py"
        row = next(line for line in text.splitlines() if line.startswith("| MADDPG | "))
        changed = text.replace(row, row.replace("/ 1.00", "/ 0.99", 1))
        assert changed != text
        assert tables.with_tables(changed, named, values, name) == text
