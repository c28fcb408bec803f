"""What `python perf/same_episodes.py` reads out of values, and how it names a difference."""

import math
from dataclasses import make_dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from perf import same_episodes
from perf.same_episodes import compare_leaves, first_difference, leaves


class Point(NamedTuple):
    x: float
    name: str = "a"
    missing: float | None = None


class Light(IntEnum):
    STOP = 1


def read(value):
    return [*leaves("it", value)]


def test_bytes_of_a_float_an_array_and_an_enum_are_their_own():
    one = bytes.fromhex("000000000000f03f")
    assert read(1.0) == [("it", "<f8 ()", one)]
    assert read(np.ones((1, 2))) == [("it", "<f8 (1, 2)", 2 * one)]
    assert read(Light.STOP) == read(1) == [("it", "text", b"1")]


def test_a_record_reads_like_a_dict_of_its_fields_without_those_that_are_none():
    other = make_dataclass("Other", ["name", "x"])("a", 2.0)
    assert read(Point(2.0)) == read(other) == read({"x": 2.0, "name": "a"})


def test_records_in_a_list_read_by_columns_whatever_their_class():
    other = make_dataclass("Other", ["name", "x"])
    assert read([Point(1.0), Point(2.0)]) == read([other("a", 1.0), other("a", 2.0)])
    assert read([Point(1.0), Point(2.0)]) != read([Point(2.0), Point(1.0)])
    assert read(None) == [] != read([])


def test_the_last_bit_the_sign_of_zero_and_the_type_of_an_array_are_seen():
    assert read(1.0) != read(math.nextafter(1.0, 2.0))
    assert read([0.0]) != read([-0.0])
    assert read(np.zeros(2, np.float32)) != read(np.zeros(2))
    assert read(math.nan) == read(math.nan)


def test_names_read_as_their_new_ones(monkeypatch):
    old = {"world": 1, "sensor/world": ["world"]}
    monkeypatch.setitem(same_episodes.RENAMES, "world", "env")
    assert read(old) == read({"env": 1, "sensor/env": ["env"]})


def test_a_difference_names_the_item_and_both_values():
    (one,), (other,) = read([1.0, 2.0])[1:], read([1.0, -2.0])[1:]
    assert compare_leaves(one[1:], other[1:]) == (
        "<f8 (2,), 1 of 2 differ, [1] 2.0 [4000000000000000] -> -2.0 [c000000000000000]"
    )


def test_the_first_block_that_differs_is_found_and_its_groups():
    base = {"blocks": {"2": {"rewards": "a", "infos": "b"}, "10": {"rewards": "c"}}}
    assert first_difference(base, base) is None
    new = {"blocks": {"2": {"rewards": "a", "infos": "x"}}}
    assert first_difference(base, new) == (2, ["infos"])
    assert first_difference(base, {"blocks": {"2": base["blocks"]["2"]}}) == (10, ["rewards"])
