"""Environments that start badly, answer NaN where nobody looks, or act in Boxes of several axes."""

import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete
from rigs import Rig, replayed

from algorithms.errors import EnvironmentFailure, SpaceError
from algorithms.joint.adapter import JointVector
from algorithms.joint.env import MEMORY, AgentBlock, FinalStep, JointSpaces, JointStep
from algorithms.parts.distributions import Exploration
from tests.games.games import Cues, Ragged, Target


class NaNStart(Cues):
    """The first `bad` resets of all copies give NaN."""

    bad = 0

    def reset(self, **kwargs):
        seen, infos = super().reset(**kwargs)
        NaNStart.bad -= 1
        if NaNStart.bad >= 0:
            seen["agent_0"][0] = np.nan
        return seen, infos


class Unsound:
    """One agent, episodes of two steps, each paid with the number of its world; some worlds are skipped."""

    num_envs = 2
    spaces = JointSpaces((AgentBlock(("agent",), {"": Box(0.0, 1.0, (1,), np.float32)}, Discrete(2)),))
    fails, never_begins = 12, (13, 14)

    def reset(self, seed, worlds, *, stride=0):
        self.worlds, self.stride, self.t = np.array(worlds), stride, np.zeros(2, int)
        return self._stand()

    def step(self, actions):
        self.t += 1
        rewards = self.worlds.astype(np.float32)[:, None]
        failed = {b: RuntimeError("failed on purpose") for b in np.flatnonzero(self.worlds == self.fails)}
        over = (self.t == 2) | (self.worlds == self.fails)
        reset = over & (self.worlds != self.fails)
        self.t[over] = 0
        self.worlds[over] += self.stride
        while np.isin(self.worlds, self.never_begins).any():
            self.worlds[np.isin(self.worlds, self.never_begins)] += self.stride
        return self._stand(rewards, reset, failed)

    def recreate(self, failures):
        raise RuntimeError("nothing here is NaN") from next(iter(failures.values()))

    def close(self):
        pass

    def _stand(self, rewards=None, reset=None, failed=None):
        rewards = np.zeros((2, 1), np.float32) if rewards is None else rewards
        reset = np.zeros(2, bool) if reset is None else reset
        seen, ends = {"": np.zeros((2, 1, 1), np.float32)}, reset[:, None]
        rows = np.flatnonzero(reset)
        final = FinalStep(rows, ({"": seen[""][rows]},), (None,)) if len(rows) else None
        return JointStep(
            (seen,), rewards, ends, ~ends & False, ends | True, reset, final, failed=failed or {}
        )


def test_worlds_that_an_environment_skips_are_missing_and_the_others_keep_their_names():
    episodes = Rig("ppo", Unsound()).sampler.episodes(np.arange(10, 19), Exploration())
    assert [episode.episode_index for episode in episodes] == [10, 11, 15, 16, 17, 18]
    assert [float(episode.returns[0]) for episode in episodes] == [20, 22, 30, 32, 34, 36]


def test_nan_in_a_first_observation_makes_the_copy_anew():
    NaNStart.bad = 0
    rig = Rig("ppo", NaNStart)
    NaNStart.bad = 2
    assert np.isfinite(rig.rollout(2).views.observations[0][""]).all()
    assert rig.sampler.progress.failed_total == 2


def test_an_environment_that_fails_in_every_episode_is_named_by_its_class():
    class Crashing(Cues):
        def step(self, action_dict):
            raise RuntimeError("crash")

    rig = Rig("ppo", Crashing)
    rig.sampler._max_failures = 2
    with pytest.raises(EnvironmentFailure, match=r"environment \d, a Crashing: 3 failures.*crash"):
        rig.rollout(4)


def test_a_constructor_that_always_raises_is_named():
    def make(b):
        raise OSError("no display")

    with pytest.raises(EnvironmentFailure, match=r"environment 0 .* 3 times.*no display"):
        JointVector(make, 2, max_failures=3)


@pytest.mark.parametrize(("name", "shape"), [("ppo", ()), ("maddpg", (2, 2))])
def test_actions_reach_the_environment_in_the_shape_of_their_box(name, shape):
    low = np.arange(np.prod(shape, dtype=int), dtype=np.float32).reshape(shape)

    class Shaped(Target):
        def __init__(self, config=None):
            super().__init__()
            self.action_spaces = dict.fromkeys(self.agents, Box(low, low + 1))

        def step(self, action_dict):
            assert all(self.action_spaces[a].contains(np.asarray(x)) for a, x in action_dict.items())
            self.t += 1
            return self.observe(), dict.fromkeys(self.agents, 0.0), {}, {"__all__": self.t == 5}, {}

    rig = Rig(name, Shaped, **({} if name == "ppo" else {"learning_starts": 1, "capacity": 100}))
    rollout = rig.rollout(8)
    assert not rollout.failed.any()
    rig.learner.update_joint(rollout)


def test_late_arrivals_are_valued_with_an_empty_memory():
    rig = Rig("vdn", Ragged, gru=4, sequence_length=8, learning_starts=1, capacity=400, sharing="all")
    batch = replayed(rig, steps=64, count=128, epsilon=1.0)
    ((group, own),) = list(batch.groups())
    arrived = own.next.alive & ~own.bootstrap
    assert arrived.sum() > 10
    for view in rig.learner.following(rig.learner.net(group.id), own):
        assert not view.observations[MEMORY][arrived].any()
        assert view.observations[MEMORY][own.next.alive & own.bootstrap].any()


def test_final_rows_hold_no_memory_of_arrivals():
    rig = Rig("ppo", Ragged, gru=4, sequence_length=8)
    rollout = rig.rollout(128)
    (t, b), final = rollout.final_at.T, rollout.final
    arrived = final.alive & ~rollout.masks().bootstrap[t, b]
    assert arrived.any()
    assert not final.observations[0][MEMORY][arrived].any()
    assert final.observations[0][MEMORY][final.alive & ~arrived].any(-1).all()


def test_deterministic_policies_need_bounds():
    class Half(Target):
        def __init__(self, config=None):
            super().__init__()
            self.action_spaces = {a: Box(0.0, np.inf, (1,), np.float32) for a in self.agents}

    with pytest.raises(SpaceError, match=r"action space: .*agent_0, agent_1 has none"):
        Rig("maddpg", Half)
