"""Environments that start badly, answer NaN where nobody looks, or act in Boxes of several axes."""

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete
from rigs import Rig, replayed

import algorithms
from algorithms.errors import EnvironmentFailure, SpaceError
from algorithms.joint.adapter import COMMON, JointVector
from algorithms.joint.env import MEMORY, AgentBlock, FinalStep, JointSpaces, JointStep, episode_seed
from algorithms.parts.distributions import Exploration
from tests.games.games import Cues, Game, Ragged, Target


def state(number):
    return {COMMON: {"state": np.array([0.0, number], np.float32)}}


class NaNState(Cues):
    def reset(self, **kwargs):
        return super().reset(**kwargs)[0], state(0.0)

    def step(self, action_dict):
        *result, _ = super().step(action_dict)
        return *result, state(np.nan if self.t == 3 else 0.0)


def test_nan_in_the_global_state_voids_the_step():
    rig = Rig("centralised_v", NaNState)
    rollout = rig.rollout(8)
    assert np.flatnonzero(rollout.failed[:, 0]).tolist() == [2, 5]
    rig.learner.update_joint(rollout)
    assert all(torch.isfinite(w).all() for net in rig.weights().values() for w in net.values())


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


class Numbered(Game):
    """Pays the last digits of the episode's seed at the end; NaN in that of world 11."""

    length = 2

    def reset(self, *, seed=None, options=None):
        self.seed = seed
        return super().reset(seed=seed)

    def reward(self, actions):
        last = np.nan if self.seed == episode_seed(0, 11, 0) else self.seed % 1000
        return [float(last if self.t == 1 else 0)] * 2


def test_nan_in_the_last_step_of_an_episode_does_not_rename_those_behind_it():
    rig = Rig("ppo", Numbered)
    seed = rig.sampler._seed
    assert seed == 0
    episodes = rig.sampler.episodes(np.arange(10, 19), Exploration())
    assert [episode.episode_index for episode in episodes] == [10, 12, 13, 14, 15, 16, 17, 18]
    wanted = [episode_seed(seed, episode.episode_index, 0) % 1000 for episode in episodes]
    assert [float(episode.returns[0]) for episode in episodes] == wanted


def test_nan_in_a_first_observation_makes_the_copy_anew():
    NaNStart.bad = 0
    rig = Rig("ppo", NaNStart)
    NaNStart.bad = 2
    assert np.isfinite(rig.rollout(2).views.observations[0][""]).all()
    assert rig.sampler.progress.failed_total == 2


def test_nan_in_every_first_observation_stops_the_run():
    NaNStart.bad = 0
    rig = Rig("ppo", NaNStart)
    NaNStart.bad = 10**6
    rig.sampler._max_failures = 3
    with pytest.raises(EnvironmentFailure, match=r"NaNStart: .* 4 times"):
        rig.rollout(2)


@pytest.mark.parametrize("where", ["constructor", "reset"])
def test_a_copy_that_fails_once_to_start_is_started_again(where):
    calls = {"constructor": 0, "reset": 0}

    def count(place):
        calls[place] += 1
        if place == where and calls[place] == 2:
            raise OSError("flaky")

    class Flaky(Cues):
        def __init__(self):
            count("constructor")
            super().__init__()

        def reset(self, **kwargs):
            count("reset")
            return super().reset(**kwargs)

    env = JointVector(lambda b: Flaky(), 3)
    step = env.reset(0, np.arange(3))
    assert step.alive.all()
    assert calls[where] == {"constructor": 3, "reset": 4}[where] + 1


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


def test_an_agent_with_both_flags_terminated():
    class Both(Cues):
        def step(self, action_dict):
            seen, rewards, *_ = super().step(action_dict)
            flags = {"agent_0": True, "agent_1": False, "__all__": False}
            return seen, rewards, flags, flags, {}

    env = JointVector(lambda b: Both(), 1)
    env.reset(0, np.array([0]))
    step = env.step((np.zeros((1, 2), np.int64),))
    assert step.terminated[0].tolist() == [True, False]
    assert not step.truncated.any()


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


@pytest.mark.parametrize("name", ["ppo", "mf_q"])
def test_annotations_reach_the_environment_through_wrappers(name):
    class Annotated(JointVector):
        def annotate(self, key, values):
            """Take down what policies gave."""

    class Plain(Game):
        def reward(self, actions):
            return [0.0, 0.0]

    env = Annotated(lambda b: Plain(), 1)
    assert getattr(algorithms.config(name).adapt(env), "annotate", None) == env.annotate
    bare = JointVector(lambda b: Plain(), 1)
    assert getattr(algorithms.config(name).adapt(bare), "annotate", None) is None


def test_a_memory_needs_no_other_setting():
    config = algorithms.config("vdn").training(gru=8)
    config.validate()
    assert config.gru == 8


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


def test_a_seed_is_drawn_where_none_is_given():
    drawn = []
    for _ in range(2):
        config = algorithms.config("ppo")
        config.validate()
        drawn.append(config.seed)
    assert None not in drawn
    assert drawn[0] != drawn[1]
    given = algorithms.config("ppo").debugging(seed=0)
    given.validate()
    assert given.seed == 0


def test_deterministic_policies_need_bounds():
    class Half(Target):
        def __init__(self, config=None):
            super().__init__()
            self.action_spaces = {a: Box(0.0, np.inf, (1,), np.float32) for a in self.agents}

    with pytest.raises(SpaceError, match=r"action space: .*agent_0, agent_1 has none"):
        Rig("maddpg", Half)
