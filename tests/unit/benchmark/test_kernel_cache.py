"""Whether kernels count as compiled, with real kernels in a package of their own."""

import os
import subprocess
import sys

import pytest

KERNELS = """
from smarts.geometry.compiling import kernel

@kernel
def twice(x):
    return {factor} * x

@kernel
def thrice(x):
    return 3 * x
"""
TELL = """
import sys
import fresh.kernels
from benchmark.running.kernel_cache import kernel_cache
from smarts.errors import SmartsError
for call in sys.argv[1:]:
    getattr(fresh.kernels, call)(1)
try:
    found = kernel_cache("fresh")
    print(found.compiled, found.kernels, *found.folders)
except SmartsError as error:
    print(error)
"""


@pytest.fixture
def package(tmp_path):
    folder = tmp_path / "fresh"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "kernels.py").write_text(KERNELS.format(factor=2))
    return folder


def told(package, *calls, **environment):
    """Return what the cache is said to hold in a new process that has called some kernels."""
    run = subprocess.run(
        [sys.executable, "-c", TELL, *calls],
        cwd=package.parent,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.strip()


@pytest.mark.slow
def test_kernels_are_compiled_once_they_were_called_and_not_for_other_sources(package):
    folder = package / "__pycache__"
    assert told(package) == f"0 2 {folder}"
    assert told(package, "twice") == f"1 2 {folder}"
    assert told(package) == f"1 2 {folder}"
    # Machine code of another processor is of no use here.
    assert told(package, NUMBA_CPU_NAME="generic") == f"0 2 {folder}"
    (package / "kernels.py").write_text(KERNELS.format(factor=4))
    assert told(package) == f"0 2 {folder}"
