"""How the tables of pages sort and filter, in the language of the pages: Node has to be there."""

import json
import re
import subprocess
from pathlib import Path

import pytest

import benchmark.report
from benchmark.report.leaderboard import Leaderboard, leaderboard_page

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
        ({"task": "two_way", "mode": "greedy"}, [0, 3]),
        ({"task": "two", "mode": "sampled"}, []),
    ],
)
def test_rows_fit_all_filters_that_they_have_something_for(chosen, shown):
    found = evaluated("rows.map((row) => isShown(row, chosen))", rows=ROWS, chosen=chosen)
    assert [number for number, is_shown in enumerate(found) if is_shown] == shown


def test_pages_hold_the_whole_script():
    page = leaderboard_page(Leaderboard("greedy", {}, {}, (), (), ()))
    (script,) = re.findall("<script>(.*?)</script>", page, re.DOTALL)
    assert SCRIPT in script
    # What the part that knows the page calls is there, and all of it is a program.
    assert {"sortKey", "sortedRows", "isShown"} <= set(re.findall(r"function (\w+)", script))
    subprocess.run(["node", "--check", "-"], input=script, text=True, check=True)
