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
DERIVED = """
from .constants import METRES
FEET = 3 * METRES
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
