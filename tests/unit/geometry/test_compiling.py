import subprocess
import sys

import pytest

LENGTHS = """
from smarts.geometry.compiling import kernel
METRES = {metres}

@kernel
def double(x):
    return {factor} * x
"""
TOTALS = """
from smarts.geometry.compiling import kernel
from fresh.lengths import double, METRES

@kernel
def total(x):
    return double(x) + METRES
"""
FIELDS = """
from typing import NamedTuple
class Box(NamedTuple):
    {first}: float
    {second}: float
"""
BOXES = """
from smarts.geometry.compiling import kernel
from fresh.fields import Box

@kernel
def width_of(box: Box):
    return box.width
"""


@pytest.fixture
def package(tmp_path):
    folder = tmp_path / "fresh"
    folder.mkdir()
    (folder / "__init__.py").touch()
    return folder


def evaluate(package, code):
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, cwd=package.parent, capture_output=True, text=True, check=True)
    return run.stdout.strip()


def test_a_kernel_follows_changes_of_the_kernels_and_constants_that_it_uses(package):
    (package / "totals.py").write_text(TOTALS)
    results = []
    for metres, factor in ((1, 2), (1, 3), (5, 3), (1, 2)):
        (package / "lengths.py").write_text(LENGTHS.format(metres=metres, factor=factor))
        results.append(evaluate(package, "from fresh.totals import total; print(total(10))"))
    assert results == ["21", "31", "35", "21"]


def test_a_kernel_follows_changes_of_named_tuples(package):
    (package / "boxes.py").write_text(BOXES)
    code = "from fresh.boxes import *; print(width_of(Box(width=2.0, length=5.0)))"
    for first, second in (("width", "length"), ("length", "width")):
        (package / "fields.py").write_text(FIELDS.format(first=first, second=second))
        assert evaluate(package, code) == "2.0"


def test_unchanged_kernels_come_from_the_cache(package):
    (package / "lengths.py").write_text(LENGTHS.format(metres=1, factor=2))
    code = "from fresh.lengths import double; double(1); print(sum(double.stats.cache_hits.values()))"
    assert [evaluate(package, code) for _ in range(2)] == ["0", "1"]
