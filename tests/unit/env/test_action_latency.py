"""`Options.action_latency`: actions are carried out later, by whole steps, whatever the decision interval."""

from pathlib import Path

import numpy as np
import pytest

from smarts.env import VectorHiWayEnv
from smarts.env.actions import Own
from smarts.errors import ScenarioError, SmartsError
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.types.actions import LaneAction
from smarts.types.agent_states import AgentStatus
from tests.raising import raises

LEFT_TURN = Path(__file__).parents[3] / "examples" / "left_turn_bubble"
KEEP, SLOW = int(LaneAction.keep_lane), int(LaneAction.slow_down)
SECONDS = {"seed": 3, "traffic": ["no_social_vehicles"]}


def vector(latency, *, interval=5, agents=1, num_envs=1, scenario="loop", **options):
    simulation = Options(action_latency=latency, **options)
    given = {**SECONDS, "decision_interval": interval, "simulation": simulation}
    return VectorHiWayEnv(num_envs, [scenario], agents, **given)


def speeds(env, actions):
    """Return the agent's speed after each decision [m/s]."""
    env.reset()
    found = []
    for action in actions:
        env.step([np.full((env.num_envs, len(env.agents)), action)])
        world = env._runner.world
        found.append(float(world.vehicles.speed[0, world.agents.slot[0, 0]]))
    env.close()
    return found


def carried_out(folder):
    """Return agent, step of the decision and action of all actions that vehicles carried out, by world."""
    found = {}
    for path in episodes_in(folder):
        table = RecordedEpisode(path).table("decisions")
        rows = np.column_stack([table["agent_id"], table["step"], table["value_0"]]).astype(int)
        found[int(RecordedEpisode(path).facts["world"])] = rows.tolist()
    return found


@pytest.mark.parametrize(("interval", "latency"), [(5, 0.3), (2, 0.5)])
def test_actions_are_carried_out_so_many_steps_later(tmp_path, interval, latency):
    actions = np.random.default_rng(0).integers(0, 2, (60 // interval, 2, 2))
    steps, found = round(latency * 10), {}
    for each in (0.0, latency):
        folder = tmp_path / str(each)
        env = vector(each, interval=interval, agents=2, num_envs=2, record=folder)
        env.reset()
        for chosen in actions:
            env.step([chosen])
        env.close()
        found[each] = carried_out(folder)
    assert {*found[0.0]} == {0, 1}
    for world, rows in found[0.0].items():
        last = max(step for _, step, _ in rows) + interval
        arrived = [row for row in rows if row[1] + steps < last]
        assert sorted(found[latency][world]) == sorted(arrived)
        assert arrived


def test_records_say_what_was_allowed_when_the_agents_decided(tmp_path):
    env = vector(0.7, scenario="double_merge", agents=4, record=tmp_path)
    env.reset()
    for actions in np.random.default_rng(0).integers(0, 4, (40, 4)):
        env.step([actions[None]])
    env.close()
    (path,) = episodes_in(tmp_path)[:1]
    states, table = (RecordedEpisode(path).table(name) for name in ("agent_states", "decisions"))
    masks = dict(zip(places(states), states["action_mask"].tolist(), strict=True))
    assert [masks[place] for place in places(table)] == table["action_mask"].tolist()
    assert {step % 5 for step, _ in places(table)} == {0}
    assert len({*table["action_mask"].tolist()}) > 1
    is_change = np.isin(table["value_0"].astype(int), [2, 3])
    may_change = table["action_mask"] >> table["value_0"].astype(int) & 1
    assert not table["is_effective"][is_change & (may_change == 0)].any()


def places(table):
    return [*zip(table["step"].tolist(), table["agent_id"].tolist(), strict=True)]


def test_a_vehicle_brakes_as_much_later():
    actions = [KEEP] * 30 + [SLOW] * 12  # on a straight road, on which it still gets faster then
    found = {each: speeds(vector(each, interval=1, scenario="two_way"), actions) for each in (0.0, 0.5)}
    fastest = {each: int(np.argmax(way)) for each, way in found.items()}
    assert fastest[0.0] in (29, 30)
    assert {each: number - fastest[0.0] for each, number in fastest.items()} == {0.0: 0, 0.5: 5}
    for way in found.values():
        assert (np.diff(way[max(fastest.values()) + 1 :]) < 0).all()


def test_actions_of_an_episode_that_is_over_do_not_reach_the_next(tmp_path):
    env = vector(1.0, num_envs=2, record=tmp_path)
    env.reset()
    for _ in range(3):
        env.step([np.full((2, 1), SLOW)])
    env.reset(worlds=np.array([7, 8]))
    for _ in range(4):
        env.step([np.full((2, 1), KEEP)])
    env.close()
    found = carried_out(tmp_path)
    assert found[7] == [[0, 0, KEEP], [0, 5, KEEP]]


class Noted:
    """An encoding of actions that notes whose arrive."""

    def __init__(self):
        self.arrived = []

    def encode(self, given, chosen, actions):
        self.arrived.append(chosen.tolist())


def test_own_actions_of_agents_that_have_ended_meanwhile_are_dropped():
    env = vector(0.1, agents=3)
    env.reset()
    runner, noted = env._runner, Noted()
    own = Own(noted, np.zeros((1, 2)), np.ones((1, 2), bool), np.array([1, 2]))
    runner.encoder.write([], [own])
    runner.world.step[:] += 1
    runner.world.agents.state[0, 2] = AgentStatus.DONE
    runner.encoder.release(np.ones(1, bool))
    assert noted.arrived == [[[True, False]]]
    env.close()


@pytest.mark.parametrize("latency", [0.05, -0.1])
def test_a_latency_that_is_none_is_refused(latency):
    with raises(SmartsError, "Options.action_latency", values=[f"{latency}"]):
        Options(action_latency=latency)


def test_agents_in_bubbles_have_no_latency():
    given = {"learn_in_bubbles": True, "episode_time": 20.0, "simulation": Options(action_latency=0.3)}
    with raises(ScenarioError, "Options.action_latency", values=["0.3"]):
        VectorHiWayEnv(1, [LEFT_TURN], 2, **given)
