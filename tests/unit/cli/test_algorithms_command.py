"""`smarts-bench algorithms` as a user meets it: in a process of its own."""

import re
import subprocess
import sys
from itertools import zip_longest

from algorithms.registry import ALGORITHMS

LIST = """
import sys
from benchmark.cli import app
app(["algorithms"], standalone_mode=False)
print(*sorted({"torch", "ray", "gymnasium", "pettingzoo"} & set(sys.modules)), file=sys.stderr)
"""


def test_lists_every_algorithm_with_its_tags_and_loads_no_framework():
    result = subprocess.run([sys.executable, "-c", LIST], capture_output=True, text=True, check=True)
    assert result.stderr.strip() == ""
    table, legend = result.stdout.split("\n\n")
    header, *lines = table.splitlines()
    columns = re.split(r"  +", header)
    cells = (re.split(r"  +", line) for line in lines)  # the description may be empty
    rows = {row[0]: dict(zip_longest(columns, row, fillvalue="")) for row in cells}
    assert list(rows) == list(ALGORITHMS)
    assert rows["maddpg"] == {
        "name": "maddpg",
        "paradigm": "CTDE",
        "level": "M3",
        "communication": "no",
        "actions": "both",
        "recurrent": "no",
        "description": ALGORITHMS["maddpg"].summary,
    }
    assert rows["dqn"]["actions"] == "discrete"
    assert rows["dqn"]["paradigm"] == "fully decentralised"
    for name, entry in ALGORITHMS.items():
        assert rows[name]["communication"] == ("yes" if entry.communication else "no")
    assert legend.strip() == "CTDE: centralised training, decentralised execution"
