"""What environments record: the reward of every decision, and the values that policies annotate."""

import time

import numpy as np

from smarts.agents import ActionSpaceType, AgentInterface
from smarts.env import VectorHiWayEnv
from smarts.sim.assembly import Options
from smarts.sim.episode_files import RecordedEpisode, episodes_in

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
