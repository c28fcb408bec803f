"""How the tables of pages sort and filter, in the language of the pages: Node has to be there."""

import json
import re
import subprocess
from pathlib import Path

import pytest

import benchmark.report
from benchmark.report.leaderboard import Leaderboard
from benchmark.report.leaderboard_page import leaderboard_page

SCRIPT = (Path(benchmark.report.__file__).with_name("templates") / "rows.js").read_text(encoding="utf-8")


def evaluated(expression, **given):
    """Return a value of the script, with constants of these names."""
    constants = "".join(f"const {name} = {json.dumps(value)};\n" for name, value in given.items())
    program = f"{SCRIPT}\n{constants}console.log(JSON.stringify({expression}));"
    out = subprocess.run(["node", "--eval", program], capture_output=True, text=True, check=True).stdout
    return json.loads(out)


def in_order(texts, *, rising=True):
    """Return the texts of cells in the order of their rows."""
    return evaluated(
        "sortedRows(texts.map(sortKey), rising).map((row) => texts[row])", texts=texts, rising=rising
    )


def test_numbers_are_sorted_by_value_both_ways():
    figures = ["0.5", "10", "-2", "9", "1e-3", "0"]
    assert in_order(figures) == ["-2", "0", "1e-3", "0.5", "9", "10"]
    assert in_order(figures, rising=False) == ["10", "9", "0.5", "1e-3", "0", "-2"]


def test_what_is_not_known_goes_last_both_ways():
    figures = ["", "0.2", "", "0", "0.1"]
    assert in_order(figures) == ["0", "0.1", "0.2", "", ""]
    assert in_order(figures, rising=False) == ["0.2", "0.1", "0", "", ""]


@pytest.mark.parametrize("rising", [True, False])
def test_ties_keep_their_order(rising):
    keys = [1, 0, 1, None, 0, 1, None, "a", "a"]
    found = evaluated("sortedRows(keys, rising)", keys=keys, rising=rising)
    assert found == ([1, 4, 0, 2, 5, 7, 8, 3, 6] if rising else [7, 8, 0, 2, 5, 1, 4, 3, 6])


def test_texts_are_sorted_as_people_do_with_numbers_in_them_by_value():
    assert in_order(["seed 10", "Seed 9", "maddpg", "PPO", "dqn"]) == [
        "dqn",
        "maddpg",
        "PPO",
        "Seed 9",
        "seed 10",
    ]
    assert in_order(["0:10:00", "0:09:59", "1:00:00"], rising=False) == ["1:00:00", "0:10:00", "0:09:59"]


def test_a_column_of_numbers_and_texts_has_one_order():
    mixed = ["b", "10", "a", "9", "", "-1"]
    assert in_order(mixed) == ["-1", "9", "10", "a", "b", ""]
    assert in_order(mixed, rising=False) == ["b", "a", "10", "9", "-1", ""]


ROWS = [
    {"task": "two_way", "traffic": "none", "mode": "greedy"},
    {"task": "two_way", "traffic": "random", "mode": "sampled"},
    {"task": "double_merge", "traffic": "none", "mode": "greedy"},
    {"mode": "greedy"},
]


@pytest.mark.parametrize(
    ("chosen", "shown"),
    [
        ({}, [0, 1, 2, 3]),
        ({"task": "", "traffic": "", "mode": ""}, [0, 1, 2, 3]),
        ({"task": "two_way", "mode": ""}, [0, 1, 3]),
        ({"task": "two_way", "mode": "greedy"}, [0, 3]),
        ({"task": "two", "mode": "sampled"}, []),
        ({"traffic": "none", "task": "double_merge"}, [2, 3]),
    ],
    ids=["no filters", "all", "a scenario", "two filters", "a part of a name", "a column that a row lacks"],
)
def test_rows_fit_all_filters_that_they_have_something_for(chosen, shown):
    found = evaluated("rows.map((row) => isShown(row, chosen))", rows=ROWS, chosen=chosen)
    assert [number for number, is_shown in enumerate(found) if is_shown] == shown


def test_pages_hold_the_whole_script():
    page = leaderboard_page(Leaderboard("greedy", {}, (), (), ()))
    (script,) = re.findall("<script>(.*?)</script>", page, re.DOTALL)
    assert SCRIPT in script
    # What the part that knows the page calls is there, and all of it is a program.
    assert {"sortKey", "sortedRows", "isShown"} <= set(re.findall(r"function (\w+)", script))
    subprocess.run(["node", "--check", "-"], input=script, text=True, check=True)
