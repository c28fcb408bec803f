import subprocess
import sys

import pytest

from smarts.errors import UnknownNameError
from smarts.registry import Registry, load_module, place_of
from tests.raising import raises

PLACES = {"fraction": "fractions:Fraction", "decimal": "decimal:Decimal"}


def test_a_part_by_its_name():
    from fractions import Fraction

    registry = Registry("number", PLACES)
    assert registry["fraction"] is Fraction
    assert list(registry) == ["fraction", "decimal"]
    assert "fraction" in registry
    assert "complex" not in registry


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
