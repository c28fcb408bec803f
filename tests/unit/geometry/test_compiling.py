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
CONSTANTS = """
METRES = {metres}
"""
DERIVED = """
from .constants import METRES
FEET = 3 * METRES
"""
LENGTH_OF_ONE = """
from smarts.geometry.compiling import kernel
{statement}

@kernel
def scaled(x):
    return {constant} * x
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


def evaluate(package, code, *arguments):
    # -B: with byte code, Python would miss a change that keeps a source's size and second.
    command = [sys.executable, "-B", "-c", code, *arguments]
    run = subprocess.run(command, cwd=package.parent, capture_output=True, text=True, check=True)
    return run.stdout.strip()


@pytest.mark.slow
def test_kernel_is_recompiled_after_a_change_of_a_kernel_or_constant_that_it_uses(package):
    (package / "totals.py").write_text(TOTALS)
    results = []
    for metres, factor in ((1, 2), (1, 3), (5, 3), (1, 2)):
        (package / "lengths.py").write_text(LENGTHS.format(metres=metres, factor=factor))
        results.append(evaluate(package, "from fresh.totals import total; print(total(10))"))
    assert results == ["21", "31", "35", "21"]


WAYS_TO_IMPORT_A_CONSTANT = [
    ("from fresh.constants import METRES", "METRES", 1),
    ("from .constants import METRES as M", "M", 1),
    ("from fresh.constants import *", "METRES", 1),
    ("import fresh.constants", "fresh.constants.METRES", 1),
    ("try:\n    from fresh import constants\nfinally:\n    pass", "constants.METRES", 1),
    ("from fresh.derived import FEET", "FEET", 3),
    ("from . import derived", "derived.FEET", 3),
]


@pytest.mark.nightly
def test_kernel_is_recompiled_after_a_change_of_an_imported_constant(package):
    (package / "derived.py").write_text(DERIVED)
    code = "import importlib\nfor i in range(7):\n"
    code += "    scaled = importlib.import_module(f'fresh.way{i}').scaled\n"
    code += "    print(scaled(10), sum(scaled.stats.cache_hits.values()))"
    for number, (statement, constant, _) in enumerate(WAYS_TO_IMPORT_A_CONSTANT):
        source = LENGTH_OF_ONE.format(statement=statement, constant=constant)
        (package / f"way{number}.py").write_text(source)
    # The third run reuses the machine code of the first.
    for metres, hits in ((1, 0), (2, 0), (1, 1)):
        (package / "constants.py").write_text(CONSTANTS.format(metres=metres))
        expected = [f"{10 * unit * metres} {hits}" for _, _, unit in WAYS_TO_IMPORT_A_CONSTANT]
        assert evaluate(package, code).splitlines() == expected


@pytest.mark.nightly
def test_kernel_is_recompiled_after_a_change_of_a_named_tuple(package):
    (package / "boxes.py").write_text(BOXES)
    code = "from fresh.boxes import *; print(width_of(Box(width=2.0, length=5.0)))"
    for first, second in (("width", "length"), ("length", "width")):
        (package / "fields.py").write_text(FIELDS.format(first=first, second=second))
        assert evaluate(package, code) == "2.0"


DIGESTS = """
import sys
from pathlib import Path
from smarts.geometry.compiling import sources_digest

names = sys.argv[1].split(",")
for name in names:
    __import__(f"fresh.{name}")
for metres in (1, 2, 1):
    Path("fresh/constants.py").write_text(f"METRES = {metres}")
    sources_digest.cache_clear()
    print(*[sources_digest(f"fresh.{name}") for name in names])
"""


def test_digests_change_with_every_imported_module(package):
    """The fast counterpart of the slow tests above, which compile."""
    modules = {f"way{number}": statement for number, (statement, *_) in enumerate(WAYS_TO_IMPORT_A_CONSTANT)}
    modules |= {
        "derived": DERIVED,
        "there": "import fresh.back, fresh.constants",
        "back": "import fresh.there",
    }
    (package / "constants.py").write_text("METRES = 1")
    for name, statement in (modules | {"apart": "import math, fresh"}).items():
        (package / f"{name}.py").write_text(f"# {name}\n{statement}\n")
    lines = evaluate(package, DIGESTS, ",".join([*modules, "apart"])).splitlines()
    first, second, third = map(str.split, lines)
    assert first == third
    assert [one == other for one, other in zip(first, second, strict=True)] == [False] * len(modules) + [True]


@pytest.mark.nightly
def test_a_notice_is_logged_when_the_first_kernel_is_compiled_but_not_when_it_is_cached(package):
    (package / "lengths.py").write_text(LENGTHS.format(metres=1, factor=2))
    code = "import logging, sys; from numba import njit; from fresh.lengths import double\n"
    code += "logging.basicConfig(stream=sys.stdout, format='%(message)s')\n"
    code += "njit(lambda x: x + 1)(1); print('a user function')\n"
    code += "double(1), double(1.0); print(sum(double.stats.cache_hits.values()))"
    own, notice, hits = evaluate(package, code).splitlines()
    assert (own, notice.partition(",")[0], hits) == ("a user function", "compiling kernels", "0")
    assert evaluate(package, code).splitlines() == ["a user function", "2"]


CALLERS = """
import numpy as np
from smarts.geometry.compiling import kernel
from fresh.lengths import double

@kernel
def all_widths(narrow, wide):
    return double(narrow) + double(wide) + double(-3) + double(True)
"""


@pytest.mark.nightly
def test_kernel_is_compiled_once_for_all_integers_from_kernels_and_separately_for_python(package):
    (package / "lengths.py").write_text(LENGTHS.format(metres=1, factor=2))
    (package / "callers.py").write_text(CALLERS)
    code = "import numpy as np; from fresh.callers import all_widths, double\n"
    code += "print(all_widths(np.int8(-128), 2**40), len(double.callee.signatures), len(double.signatures))\n"
    code += "print(double(np.int8(-128)), len(double.signatures))"
    # The callee has two signatures: one for integers, one for booleans.
    expected = [f"{2 * (-128 + 2**40 - 3 + 1)} 2 0", "-256 1"]
    assert evaluate(package, code).splitlines() == expected
    # The caller's own cache entry suffices.
    assert evaluate(package, code).splitlines() == [expected[0].replace(" 2 0", " 0 0"), expected[1]]


TWO_AT_ONCE = """
import sys, time
from numba.core.caching import IndexDataCacheFile

save = IndexDataCacheFile._save_index
def late(self, overloads):
    time.sleep(2.0)
    save(self, overloads)
IndexDataCacheFile._save_index = late
from fresh.lengths import double
print(double(float(3)) if sys.argv[1] == "float" else double(complex(3, 1)))
"""


@pytest.mark.slow
def test_processes_that_compile_at_once_leave_a_valid_cache(package):
    """Both processes read the index before either has written it; each needs a file for its own types."""
    (package / "lengths.py").write_text(LENGTHS.format(metres=1, factor=2))
    program = package.parent / "two.py"
    program.write_text(TWO_AT_ONCE)
    both = [
        subprocess.Popen(
            [sys.executable, str(program), kind], cwd=package.parent, stdout=subprocess.PIPE, text=True
        )
        for kind in ("float", "complex")
    ]
    assert [each.communicate()[0].strip() for each in both] == ["6.0", "(6+2j)"]
    assert len([*package.rglob("*double*.nbc")]) == 2
