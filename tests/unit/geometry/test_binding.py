import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest

from smarts.geometry.binding import Replaceable, bind
from smarts.geometry.compiling import kernel


class Columns(NamedTuple):
    number: np.ndarray
    flag: np.ndarray


@kernel
def weighted(columns, weight, table, row):
    total = 0.0
    for place in range(columns.number.shape[1]):
        if columns.flag[row, place]:
            total += weight * columns.number[row, place] + table[place]
    columns.number[row, 0] = 100.0
    return total


def columns():
    number = np.arange(12.0).reshape(3, 4)
    return Columns(number, np.array([[True, False, True, True]] * 3))


def test_bound_kernels_read_and_write_the_arrays_that_they_were_given():
    given = columns()
    table = np.array([1, 2, 3, 4], np.int32)
    bound = bind(weighted, given, 2.0, table)
    # 2 * (4 + 6 + 7) + 1 + 3 + 4
    assert bound(1) == 42.0
    assert given.number[1, 0] == 100.0
    given.flag[1] = False
    assert bound(1) == 0.0


def test_strides_and_scalars_are_kept():
    every_other = Columns(np.arange(24.0).reshape(3, 8)[:, ::2], np.ones((3, 8), np.bool_)[:, ::2])
    # 3 * (8 + 10 + 12 + 14)
    assert bind(weighted, every_other, 3, np.zeros(4, np.int32))(1) == 132.0


class Nested(NamedTuple):
    weight: float
    first: Columns
    pair: tuple[np.ndarray, int]
    second: Columns


@kernel
def difference(state, row):
    return state.weight * (later(state) - state.first.number[row, 1]) + state.pair[0][1] * state.pair[1]


@kernel
def later(state):
    return state.second.number[1, 1] if state.second.flag[1, 2] else 0.0


@pytest.mark.parametrize("is_replaceable", [False, True])
def test_named_tuples_may_hold_others(is_replaceable):
    first, second = columns(), columns()
    second.number[:] += 10.0
    state = Nested(0.5, first, (np.array([5, 6, 7], np.int32), 100), second)
    bound = bind(difference, Replaceable(state) if is_replaceable else state)
    # 0.5 * (15 - 9) + 6 * 100, as without binding
    assert bound(2) == difference(state, 2) == 603.0
    second.flag[1, 2] = False
    assert bound(2) == 595.5


def test_arguments_live_as_long_as_the_bound_kernel():
    bound = bind(weighted, columns(), 2.0, np.array([1, 2, 3, 4], np.int32))
    rubbish = [np.full((3, 4), np.nan) for _ in range(1000)]
    assert bound(1) == 42.0
    assert len(rubbish) == 1000


def test_what_is_replaceable_is_replaced_in_all_kernels_at_once():
    table = Replaceable(np.array([1, 2, 3, 4], np.int32))
    one, other = bind(weighted, columns(), 2.0, table), bind(weighted, columns(), 0.0, table)
    assert (one(1), other(1)) == (42.0, 8.0)
    table.replace(np.array([10, 20, 30, 40, 50], np.int32))
    assert table.value[4] == 50
    assert (one(2), other(2)) == (2.0 * (8 + 10 + 11) + 80.0, 80.0)


def test_other_types_are_refused():
    with pytest.raises(TypeError, match="cannot be bound to 'text'"):
        bind(weighted, columns(), "text")
    table: Replaceable[np.ndarray] = Replaceable(np.zeros(4, np.int32))
    with pytest.raises(TypeError, match="cannot be replaced by array\\(float64"):
        table.replace(np.zeros(4))


PROGRAM = """
import sys
from typing import NamedTuple
import numpy as np
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel

class Holder(NamedTuple):
    array: np.ndarray

@kernel
def first(holder, place):
    return holder.array[place]

bound = bind(first, Holder(np.arange(3, dtype=sys.argv[1])))
assert bound(1) == 1
print(len(bound.func.stats.cache_hits))
"""


def test_machine_code_is_kept_on_disk_by_type(tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)
    hits = []
    for dtype in ("int64", "int64", "float64", "int64"):
        command = [sys.executable, "-c", "import program", dtype]
        run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        hits.append(int(run.stdout))
    assert hits == [0, 1, 0, 1]
