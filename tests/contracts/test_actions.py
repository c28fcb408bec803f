"""Every action type through `HiWayEnv`: valid actions, invalid actions, and clipping."""

import math
import shutil
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from smarts.agents import ActionSpaceType, AgentInterface, AgentSpec, DoneCriteria
from smarts.controllers import action_space
from smarts.env import HiWayEnv
from smarts.errors import ActionError
from tests.raising import raises

KINDS = tuple(ActionSpaceType)
WITH_NUMBERS = [kind for kind in KINDS if kind != ActionSpaceType.Empty]
"""Without the type whose action is nothing, which cannot be wrong or out of range."""
POINTS = np.arange(1.0, 11.0)
SCENARIO = textwrap.dedent(
    f"""
    from pathlib import Path

    from smarts.sstudio import gen_scenario
    from smarts.sstudio import types as t

    missions = [
        t.Mission(t.Route(begin=("east_half", lane, 30 * place), end=("west_half", lane, 200)))
        for place in range(1, {1 + math.ceil(len(KINDS) / 3)})
        for lane in range(3)
    ]
    gen_scenario(t.Scenario(ego_missions=missions), output_dir=Path(__file__).parent)
    """
)
"""A scenario on the loop's map with a mission for each action type."""


def path(kind, state):
    """Return the columns of a straight path of ten points, 1 m apart."""
    x, y, heading = *state.position[:2], float(state.heading)
    columns = [
        x + POINTS * np.cos(heading),
        y + POINTS * np.sin(heading),
        0 * POINTS + heading,
        0 * POINTS + 5,
    ]
    return [0.1 * POINTS, *columns] if kind == ActionSpaceType.TrajectoryWithTime else columns


def good(kind, state):
    """Return an action that drives forwards; for new types, the first value at its bound and 0 otherwise."""
    x, y, heading = *state.position[:2], float(state.heading)
    ahead = (x + 2.0 * np.cos(heading), y + 2.0 * np.sin(heading), heading, 0.4)
    actions = {
        ActionSpaceType.Continuous: (0.6, 0.0, 0.0),
        ActionSpaceType.Lane: "keep_lane",
        ActionSpaceType.ActuatorDynamic: np.array([0.6, 0.0, 0.0]),
        ActionSpaceType.LaneWithContinuousSpeed: (5.0, 0),
        ActionSpaceType.TargetPose: ahead,
        ActionSpaceType.MultiTargetPose: {state.id: ahead},
        ActionSpaceType.Direct: 5.0,
        ActionSpaceType.Empty: None,
        ActionSpaceType.RelativeTargetPose: (0.5 * np.cos(heading), 0.5 * np.sin(heading), 0.0),
    }
    if kind in actions or is_path(kind):
        return actions[kind] if kind in actions else path(kind, state)
    space: Any = action_space(kind)
    return np.clip([space.high[0], *[0.0] * (shape(kind)[0] - 1)], space.low, space.high)


def shape(kind) -> tuple[int, ...]:
    return action_space(kind).shape or ()


def is_path(kind):
    return len(shape(kind)) == 2


def name(kind):
    return f"the {kind.name}"


@pytest.fixture(scope="module")
def env(tmp_path_factory):
    """Return an environment with an agent of each type and without done criteria."""
    folder = tmp_path_factory.mktemp("scenario")
    for source in Path("scenarios/loop").glob("map.*.xml"):
        shutil.copy(source, folder)
    (folder / "scenario.py").write_text(SCENARIO)
    criteria = DoneCriteria(collision=False, off_road=False, off_route=False)
    specs = {
        name(kind): AgentSpec(
            interface=AgentInterface(action=kind, done_criteria=criteria, max_episode_steps=100_000)
        )
        for kind in KINDS
    }
    made = HiWayEnv([folder], specs, seed=2)
    yield made
    made.close()


@pytest.fixture
def seen(env):
    return env.reset(seed=2)[0]


def test_every_type_drives(env, seen):
    start = {kind: seen[name(kind)].ego_vehicle_state for kind in KINDS}
    now = seen
    for _ in range(10):
        actions = {name(kind): good(kind, now[name(kind)].ego_vehicle_state) for kind in KINDS}
        del actions[name(ActionSpaceType.Empty)]
        now, *_ = env.step(actions)
    for kind in KINDS:
        state = now[name(kind)].ego_vehicle_state
        dx, dy = np.subtract(state.position[:2], start[kind].position[:2])
        ahead = dx * np.cos(start[kind].heading) + dy * np.sin(start[kind].heading)
        assert ahead > 1.0, kind


@pytest.mark.parametrize(
    "kind", [kind for kind in WITH_NUMBERS if kind != ActionSpaceType.Lane and not is_path(kind)]
)
def test_out_of_range_values_are_clipped(env, seen, kind):
    space: Any = action_space(kind)
    ends = []
    for high in (np.float64(1e30), space.high.astype(np.float64)):
        env.reset(seed=2)
        now, *_ = env.step({name(kind): np.broadcast_to(high, space.shape)})
        ends.append(now[name(kind)].ego_vehicle_state)
    assert ends[0].position == ends[1].position
    assert ends[0].speed == ends[1].speed


def test_unknown_agents_raise(env, seen):
    with raises(ActionError, values=["the Lane"]):
        env.step({"the Lame": 0})
