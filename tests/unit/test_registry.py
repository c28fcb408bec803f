import subprocess
import sys
from typing import Any

import pytest

from benchmark.running.importing import named_own_code
from smarts.errors import OwnCodeError, UnknownNameError
from smarts.registry import Registry, guarded, import_own, load_module, load_own, place_of
from tests.raising import raises

PLACES = {"fraction": "fractions:Fraction", "decimal": "decimal:Decimal"}


def test_an_unknown_name_is_told_its_nearest():
    with raises(UnknownNameError, values=["fractoin", "'fraction'"]):
        Registry("number", PLACES)["fractoin"]


def test_listing_imports_nothing():
    program = (
        "import sys; from smarts.registry import Registry; "
        "print(list(Registry('part', {'a': 'wave:Wave_read'})), 'wave' in sys.modules)"
    )
    printed = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert printed.stdout.strip() == "['a'] False"


def test_errors_of_this_package_are_not_placed_in_own_code():
    load_module("smarts.zoo", "agent")
    with pytest.raises(UnknownNameError) as raised:
        Registry("number", PLACES)["fractoin"]
    assert "smarts/registry.py" not in place_of(raised.value)


CALLED = """
import sys

def leaves(step):
    sys.exit(0)

def needs_none():
    return 1

class Needs:
    def __init__(self, a): ...

def around(step):
    leaves(step)
"""


@pytest.fixture
def called(tmp_path):
    """A file of own code."""
    file = tmp_path / f"{tmp_path.name}.py"
    file.write_text(CALLED)
    import_own([file])
    return file


def test_an_exit_in_own_code_is_an_error_and_an_exit_of_ray_ends_the_process(called):
    leaves, around = (load_own(f"{called.stem}:{name}") for name in ("leaves", "around"))
    with raises(OwnCodeError, f"{called}:5", values=["the reward 'x'", "SystemExit: 0"]):
        guarded(around, "the reward 'x'")(None)
    with raises(OwnCodeError, f"{called}:5", values=["SystemExit: 0"]), named_own_code("the run's own code"):
        leaves(None)

    def ends():
        error: Any = SystemExit(1)
        error.ray_terminate_msg = "SIGTERM"  # as Ray's handler of signals marks it
        raise error

    with pytest.raises(SystemExit):
        guarded(ends, "the reward 'x'")()


@pytest.mark.parametrize(
    ("name", "values", "line"), [("needs_none", (1,), 7), ("Needs", (), 10)], ids=["function", "class"]
)
def test_own_code_that_cannot_be_called_is_named_where_it_is_defined(called, name, values, line):
    with raises(OwnCodeError, f"{called}:{line}", values=["TypeError"]):
        guarded(load_own(f"{called.stem}:{name}"), "the reward 'x'")(*values)
