"""Every environment API raises the same error for the same mistake.

An invalid action has no effect on the step, and environments cannot be copied.
"""

import copy

import numpy as np
import pytest

from smarts.agents import ActionSpaceType, AgentInterface
from smarts.env import HiWayEnv, RLlibHiWayEnv, SingleHiWayEnv, VectorHiWayEnv, hiway_parallel_env
from smarts.errors import ActionError, SmartsError
from tests.raising import raises

NAN = float("nan")
LANE, PEDALS = ActionSpaceType.Lane, ActionSpaceType.Continuous
APIS = ("hiway", "parallel", "rllib", "single", "vector")
GOOD = {LANE: 1, PEDALS: (1.0, 0.0, 0.0)}
CASES = [*((api, LANE) for api in APIS), ("parallel", PEDALS), ("vector", PEDALS)]
NEVER = [None, "fast", {}, [], True]
BAD = {
    LANE: [*NEVER, 4, -1, 0.5, NAN, [0, 1], np.array([0, 1])],
    PEDALS: [*NEVER, 0.5, [1, 2], [NAN] * 3, ["1", "2", "3"]],
}
REMEDIES = {LANE: "give 0 to 3: keep_lane, slow_down, ", PEDALS: r"give an element of Box\(\[ 0. "}
FIRST, SECOND = "agent-0", "agent-1"


def make(api, kind):
    """Return an environment with two agents (one for "single") of an action type."""
    agents = {name: AgentInterface(action=kind) for name in (FIRST, SECOND)}
    makers = {
        "hiway": lambda: HiWayEnv(["loop"], agents),
        "parallel": lambda: hiway_parallel_env(["loop"], agents, observation="raw"),
        "rllib": lambda: RLlibHiWayEnv({"scenarios": ["loop"], "agents": agents, "observation": "raw"}),
        "single": lambda: SingleHiWayEnv(["loop"], agents[FIRST], observation="raw"),
        "vector": lambda: VectorHiWayEnv(1, ["loop"], agents, observation="raw"),
    }
    return makers[api]()


@pytest.fixture(scope="module", params=CASES)
def made_env(request):
    env = make(*request.param)
    env.reset(seed=1)
    yield *request.param, env
    env.close()


def runner_of(env):
    return env._runner if hasattr(env, "_runner") else env._env.runner


def step(api, kind, env, action):
    """Step with a valid action of the last agent and `action` of the first one."""
    if api == "single":
        return env.step(action)
    if api == "vector":
        block = np.empty((1, 2), object)
        block[0, 0], block[0, 1] = action, GOOD[kind]
        return env.step([block if kind == LANE else block.tolist()])
    return env.step({SECOND: GOOD[kind], FIRST: action})


@pytest.mark.filterwarnings("error")
def test_invalid_actions_raise_the_same_error(made_env):
    api, kind, env = made_env
    runner = runner_of(env)
    for bad in BAD[kind]:
        with pytest.raises(ActionError) as caught:
            step(api, kind, env, bad)
        # Arrays of different lengths do not form a batch, so the whole batch is rejected.
        is_whole = api == "vector" and caught.value.place == f"actions of {FIRST}, {SECOND}"
        assert is_whole or caught.value.place == f"action of {FIRST!r}", bad
        assert caught.value.remedy
        if not is_whole:
            with pytest.raises(ActionError, match=REMEDIES[kind]):
                raise caught.value
        if api != "vector":
            assert str(bad)[:20] in caught.value.problem or repr(bad)[:20] in caught.value.problem
        assert len(str(caught.value)) < 500
        assert not runner.actions.fresh.any()
        assert runner.world.step[0] == 0


# Without "single", whose `step` takes one action.
@pytest.mark.parametrize("made_env", [case for case in CASES if case[0] != "single"], indirect=True)
@pytest.mark.parametrize("nothing", [None, "keep_lane"])
def test_invalid_action_containers_raise_the_same_error(made_env, nothing):
    api, _, env = made_env
    with pytest.raises(ActionError) as caught:
        env.step(nothing)
    assert caught.value.place.startswith("actions")
    assert repr(nothing) in caught.value.problem or api == "vector"
    assert caught.value.remedy.startswith("give a")
    assert runner_of(env).world.step[0] == 0


def test_environments_cannot_be_copied(made_env):
    with raises(SmartsError, type(made_env[2]).__name__, values=["hand over what makes it"]):
        copy.deepcopy(made_env[2])
