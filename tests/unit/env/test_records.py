"""What environments record: the reward of every decision, and the values that policies annotate."""

import time

import numpy as np
import pytest

from smarts.agents import ActionSpaceType, AgentInterface, AgentSpec
from smarts.env import HiWayEnv, RLlibHiWayEnv, SingleHiWayEnv, VectorHiWayEnv
from smarts.errors import ActionError
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from tests.raising import raises

SHORT = AgentInterface(action=ActionSpaceType.Lane, max_episode_steps=17)


def written(folder, count):
    """Return the episodes of a folder by (world, episode) when there are so many; they come from a thread."""
    deadline = time.monotonic() + 60.0
    while True:
        found = [RecordedEpisode(str(path)) for path in episodes_in(str(folder))]
        if len(found) >= count:
            return {(episode.facts["world"], episode.facts["episode"]): episode for episode in found}
        assert time.monotonic() < deadline, f"{len(found)} of {count} episodes were written"
        time.sleep(0.02)


def extras(episode, name):
    """Return what is said under a name: (step, agent) -> numbers."""
    table = episode.table("extras")
    rows = zip(
        table["step"].tolist(), table["agent_id"].tolist(), table["name"], table["values"], strict=True
    )
    return {(step, agent_id): np.array(values) for step, agent_id, what, values in rows if what == name}


def test_a_finished_episode_is_written_without_a_reset(closing, tmp_path):
    specs = {"a": AgentSpec(interface=SHORT), "b": AgentSpec(interface=SHORT)}
    options = Options(record=str(tmp_path))
    env = closing(HiWayEnv(["two_way"], specs, decision_interval=5, simulation=options))
    env.reset(seed=1)
    returned, decisions, is_over = {}, 0, False
    while not is_over:
        env.annotate("mean_std", {"a": [[decisions, 0.5]], "b": [[-decisions, 0.25]]})
        _, rewards, terminated, *_ = env.step({"a": 0, "b": 0})
        returned |= {(5 * decisions, "ab".index(name)): reward for name, reward in rewards.items()}
        decisions, is_over = decisions + 1, terminated["__all__"]
    assert decisions == 4
    (episode,) = written(tmp_path, 1).values()
    assert episode.facts["is_complete"]
    rewards = extras(episode, "reward")
    assert rewards.keys() == returned.keys()
    np.testing.assert_allclose([rewards[key].item() for key in returned], [*returned.values()], rtol=1e-6)
    assert sum(returned.values()) > 1.0
    said = extras(episode, "mean_std")
    assert {key: numbers.tolist() for key, numbers in said.items()} == {
        (5 * k, agent_id): [k, 0.5] if agent_id == 0 else [-k, 0.25]
        for k in range(4)
        for agent_id in range(2)
    }
    table = episode.table("decisions")
    decided = zip(table["step"].tolist(), table["agent_id"].tolist(), strict=True)
    assert set(decided) == returned.keys()


def test_every_episode_of_a_vector_has_its_own_rewards(closing, tmp_path):
    agents = {"a": SHORT, "b": SHORT.replace(max_episode_steps=12)}
    options = Options(record=str(tmp_path))
    env = closing(VectorHiWayEnv(2, ["two_way", "intersection"], agents, simulation=options))
    now = env.reset(3)
    returned, decision, ended = {}, np.zeros(2, int), []
    while len(ended) < 4:
        playing = [(start.world, start.episode) for start in env.episodes]
        said = [np.full((2, 1, 2), 10.0 * place) + decision[:, None, None] for place in range(2)]
        env.annotate("probabilities", [said[0], None])
        env.annotate("value", said)
        alive = now.alive.copy()
        now = env.step([np.zeros((2, 1), int), np.zeros((2, 1), int)])
        for row, agent_id in np.argwhere(alive).tolist():
            returned.setdefault(playing[row], {})[5 * int(decision[row]), agent_id] = now.rewards[
                row, agent_id
            ]
        decision += 1
        ended += [playing[row] for row in np.flatnonzero(now.reset)]
        decision[now.reset] = 0
    episodes = written(tmp_path, 4)
    for key in ended:
        rewards, values = extras(episodes[key], "reward"), extras(episodes[key], "value")
        assert rewards.keys() == returned[key].keys() == values.keys()
        assert {agent_id for _, agent_id in rewards} == {0, 1}
        np.testing.assert_array_equal(
            [rewards[at].item() for at in rewards], [returned[key][at] for at in rewards]
        )
        assert all(
            values[step, agent_id].tolist() == [10 * agent_id + step / 5] * 2 for step, agent_id in values
        )
        assert extras(episodes[key], "probabilities").keys() == {at for at in values if at[1] == 0}


def test_environments_by_name_record_rewards_and_annotations(closing, tmp_path):
    config = {"scenarios": ["two_way"], "agents": {"agent-0": SHORT}, "simulation": Options(record=tmp_path)}
    env = closing(RLlibHiWayEnv(config))
    env.reset(seed=1)
    env.annotate("value", {"agent-0": 7})
    total, truncated = 0.0, {}
    for _ in range(4):
        _, rewards, _, truncated, _ = env.step({"agent-0": 0})
        total += rewards["agent-0"]
    assert truncated["agent-0"] or truncated["__all__"]
    (episode,) = written(tmp_path, 1).values()
    assert sum(map(np.sum, extras(episode, "reward").values())) == pytest.approx(total)
    assert extras(episode, "value")[0, 0].tolist() == [7]
    with raises(ActionError, values=["agent0", "agent-0"]):
        env.annotate("value", {"agent0": 7})


def test_the_single_agent_says_it_without_its_name(closing, tmp_path):
    env = closing(SingleHiWayEnv(["two_way"], SHORT, simulation=Options(record=tmp_path)))
    env.reset(seed=1)
    for number in range(4):
        env.annotate("value", [number, 1])
        env.step(0)
    (episode,) = written(tmp_path, 1).values()
    assert [values.tolist() for values in extras(episode, "value").values()] == [[k, 1] for k in range(4)]
