import os
import subprocess
import sys
from collections import namedtuple
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


def test_bound_kernels_read_and_write_their_arrays():
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
def test_nested_named_tuples(is_replaceable):
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
    later_arrays = [np.full((3, 4), np.nan) for _ in range(1000)]
    assert bound(1) == 42.0
    assert len(later_arrays) == 1000


def test_a_replaceable_is_replaced_in_all_kernels_at_once():
    table = Replaceable(np.array([1, 2, 3, 4], np.int32))
    one, other = bind(weighted, columns(), 2.0, table), bind(weighted, columns(), 0.0, table)
    assert (one(1), other(1)) == (42.0, 8.0)
    table.replace(np.array([10, 20, 30, 40, 50], np.int32))
    assert table.value[4] == 50
    assert (one(2), other(2)) == (2.0 * (8 + 10 + 11) + 80.0, 80.0)


def output(folder, code, *arguments):
    """Return the output of a program that caches machine code in `folder`."""
    command = [sys.executable, "-c", code, *arguments]
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "code")}
    run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=True)
    return run.stdout


@kernel
def width_of(box):
    return box.width


@pytest.mark.parametrize("wrap", [lambda box: box, Replaceable])
def test_named_tuples_of_the_same_name_may_have_different_fields(wrap):
    widths = []
    for fields in (("width", "length"), ("length", "width")):
        box_type = namedtuple("Box", fields)
        widths.append(bind(width_of, wrap(box_type(width=2.0, length=5.0)))())
    assert widths == [2.0, 2.0]


THIRD = """
from smarts.geometry.compiling import kernel

@kernel
def third_of(box):
    return box.array[2]
"""
BOUND_THIRD = """
import sys
from typing import NamedTuple
import numpy as np
from {binding} import bind
from thirds import third_of

Box = NamedTuple("Box", [(name, np.ndarray) for name in sys.argv[1:]])
# Not contiguous, so that strides matter.
print(bind(third_of, Box(array=np.arange(10, 18)[::2], other=np.arange(8)[::2]))())
"""


def test_cached_machine_code_is_not_reused_after_a_change_of_fields(tmp_path):
    (tmp_path / "thirds.py").write_text(THIRD)
    program = BOUND_THIRD.format(binding="smarts.geometry.binding")
    assert int(output(tmp_path, program, "array", "other")) == 14
    assert int(output(tmp_path, program, "other", "array")) == 14
