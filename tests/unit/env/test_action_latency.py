"""`Options.action_latency`: actions are carried out later, by whole steps, whatever the decision interval."""

import numpy as np
import pytest

from smarts.env import VectorHiWayEnv
from smarts.errors import SmartsError
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.types.actions import LaneAction
from tests.raising import raises

KEEP, SLOW = int(LaneAction.keep_lane), int(LaneAction.slow_down)


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
        options = Options(action_latency=each, record=folder)
        given = {"traffic": ["no_social_vehicles"], "decision_interval": interval, "simulation": options}
        env = VectorHiWayEnv(2, ["loop"], 2, **given)
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


@pytest.mark.parametrize("latency", [0.05, -0.1])
def test_a_latency_that_is_none_is_refused(latency):
    with raises(SmartsError, values=[f"action_latency is {latency}"]):
        Options(action_latency=latency)
