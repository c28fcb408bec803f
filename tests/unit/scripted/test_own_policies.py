"""Own scripted policies: what they raise and return is checked, and named with file and line."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete

from benchmark.scripted import SCRIPTED_POLICIES
from benchmark.scripted.play import ScriptedDrivers
from smarts.errors import OwnCodeError
from smarts.registry import import_own
from tests.raising import raises

POLICY = """
import numpy as np
import sys

class Mine:
    def begin(self, episode, agent):
        pass

    def act(self, observation, mask):
        return {returned}

class Short(Mine):
    def begin(self, episode):
        pass
"""


@pytest.fixture(autouse=True)
def known(monkeypatch):
    """Forget own policies at the end of a test."""
    monkeypatch.setattr(SCRIPTED_POLICIES, "_own", {})


def drivers_of(file, space, name="Mine"):
    import_own([file])
    block = SimpleNamespace(agents=("agent-0",), action=space)
    spaces = SimpleNamespace(blocks=(block,))
    env: Any = SimpleNamespace(agents=("agent-0",), num_envs=1, spaces=spaces, episodes=(None,))
    return ScriptedDrivers(f"{file.stem}:{name}", env)


def act(tmp_path, returned, space):
    file = tmp_path / f"{tmp_path.name}.py"
    file.write_text(POLICY.format(returned=returned))
    drivers = drivers_of(file, space)
    now: Any = SimpleNamespace(observations=({"": np.zeros((1, 1, 3))},), masks=(None,))
    return file, lambda: drivers.act(now, np.ones((1, 1), np.bool_))


LANES, PEDALS = Discrete(4), Box(-1.0, 1.0, (3,), np.float32)


@pytest.mark.parametrize(
    ("returned", "space", "line"),
    [("None", LANES, 9), ("4", LANES, 9), ("1 / 0", LANES, 10), ("[0.0, 0.0]", PEDALS, 9)],
)
def test_what_is_no_action_is_one_error_with_policy_file_and_line(tmp_path, returned, space, line):
    file, decide = act(tmp_path, returned, space)
    with raises(OwnCodeError, f"{file}:{line}", values=[f"'{file.stem}:Mine'"]):
        decide()


@pytest.mark.parametrize(
    ("returned", "space", "chosen"),
    [("np.int8(3)", LANES, 3), ("np.array(2)", LANES, 2), ("(1, 0, -2)", PEDALS, [1.0, 0.0, -2.0])],
)
def test_actions_are_taken_as_they_are(tmp_path, returned, space, chosen):
    _, decide = act(tmp_path, returned, space)
    np.testing.assert_array_equal(decide()[0][0, 0], chosen)
