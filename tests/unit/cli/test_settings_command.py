"""`smarts-bench settings` and `schema` as a user meets them: in processes of their own."""

import json
import re
import subprocess
import sys

from algorithms.settings import PPOSettings
from tests.commands import begin, finish

LIST = """
import sys
from benchmark.cli import app
app(["settings", "ppo"], standalone_mode=False)
print(*sorted({"torch", "ray", "gymnasium"} & set(sys.modules)), file=sys.stderr)
"""


def test_lists_the_settings_of_an_algorithm_and_loads_no_framework():
    result = subprocess.run([sys.executable, "-c", LIST], capture_output=True, text=True, check=True)
    assert result.stderr.strip() == ""
    header, *lines = (re.split(r"  +", line, maxsplit=3) for line in result.stdout.splitlines())
    assert header == ["setting", "default", "allowed", "meaning"]
    assert [line[0] for line in lines] == [*PPOSettings.model_fields]
    assert ["clip", "0.2", "number > 0", PPOSettings.meaning("clip")] in lines


def test_an_unknown_algorithm_is_a_mistake_of_the_user():
    code, _, err = finish(begin("settings", "pppo"))
    assert code == 2
    assert "'pppo'" in err
    assert "'ppo'" in err


def test_the_schema_is_json():
    code, out, _ = finish(begin("schema"))
    assert code == 0
    assert json.loads(out)["$defs"]["PPOSettings"]["properties"]["clip"]["exclusiveMinimum"] == 0
