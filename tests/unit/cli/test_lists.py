"""`smarts-bench algorithms`, `settings` and `schema`: what experiment files may say."""

import re
import subprocess
import sys

from algorithms.registry import ALGORITHMS
from algorithms.settings import PPOSettings

LIST = """
import sys
from benchmark.cli import app
app(["algorithms"], standalone_mode=False)
app(["settings", "ppo"], standalone_mode=False)
print(*sorted({"torch", "ray", "gymnasium", "pettingzoo"} & set(sys.modules)), file=sys.stderr)
"""


def test_algorithms_and_settings_are_listed_without_a_framework():
    result = subprocess.run([sys.executable, "-c", LIST], capture_output=True, text=True, check=True)
    assert result.stderr.strip() == ""
    table, legend = result.stdout.split("\n\n")
    header, *lines = (re.split(r"  +", line) for line in table.splitlines())
    assert header == ["name", "paradigm", "level", "communication", "actions", "recurrent", "description"]
    rows = {name: tags for name, *tags in lines}
    assert [*rows] == [*ALGORITHMS]
    assert rows["maddpg"] == ["CTDE", "M3", "no", "both", "no", ALGORITHMS["maddpg"].summary]
    meaning, *settings = legend.splitlines()
    assert meaning == "CTDE: centralised training, decentralised execution"
    header, *lines = (re.split(r"  +", line, maxsplit=3) for line in settings)
    assert header == ["setting", "default", "allowed", "meaning"]
    assert [line[0] for line in lines] == [*PPOSettings.model_fields]
    assert ["clip", "0.2", "number > 0", PPOSettings.meaning("clip")] in lines
