"""Masks and advantages on ragged games, against a log kept agent by agent and sums written out."""

import numpy as np
import pytest
import torch

from algorithms.joint.adapter import JointVector
from algorithms.joint.masks import derive_masks
from algorithms.joint.replay import JointReplay
from algorithms.joint.rollout import JointRollout
from algorithms.joint.sampler import Sampler
from algorithms.joint.spec import JointSpec
from algorithms.parts.advantages import generalised_advantages
from tests.games.games import Constant, Ragged

GAMMA, LAMBDA = 0.9, 0.8


class Uniform:
    """Stands for policies: uniformly random actions."""

    has_log_prob = False

    def act(self, view, exploration, generator):
        from algorithms.parts.distributions import SampledActions

        actions = torch.randint(3, view.alive.shape, generator=generator)
        return [SampledActions(actions, None, torch.zeros(1))]


def value_of(observation):
    """Return a value that depends on everything an observation says; zeros have value 0."""
    life, step, time = np.moveaxis(np.asarray(observation, np.float64), -1, 0)
    return np.sin(life) + 0.1 * step + 0.01 * time


class Logged(Ragged):
    """A ragged game that keeps every life: rows of (observation, reward, next, end)."""

    log: list[list[tuple]] = []  # noqa: RUF012 - one log for all environments, emptied by the test

    def reset(self, *, seed=None, options=None):
        observations, infos = super().reset(seed=seed)
        self.now = observations
        self.open = {a: [] for a in observations}
        return observations, infos

    def step(self, action_dict):
        try:
            observations, rewards, ends, cuts, infos = super().step(action_dict)
        except RuntimeError:
            for rows in self.open.values():
                self.log.append([(o, r, n, "boot") for o, r, n, _ in rows])
            raise
        for agent, reward in rewards.items():
            following = observations.get(agent, self.now[agent])  # who left is valued from what it saw last
            end = "end" if ends.get(agent) else None
            self.open[agent].append((self.now[agent], reward, following, end))
            if ends.get(agent) or cuts.get(agent) or agent not in observations or cuts["__all__"]:
                self.log.append(self.open.pop(agent))
        for agent in self.trajectories:
            self.open.setdefault(agent, [])
        self.now = {a: o for a, o in observations.items() if a in self.trajectories}
        return observations, rewards, ends, cuts, infos


def play(steps, crash, seed):
    Logged.log.clear()
    env = JointVector(lambda b: Logged({"crash": crash}), 3)
    spec = JointSpec.build(env.spaces)
    sampler = Sampler(env, Uniform(), spec, seed=seed, max_failures=1000)
    return spec, sampler.fragment(steps, None), env


def brute_force(rows):
    """Return the advantages of one life by the defining double sum."""
    advantages = []
    for k in range(len(rows)):
        total = 0.0
        for m, (observation, reward, following, end) in enumerate(rows[k:]):
            after = 0.0 if end == "end" else value_of(following)
            total += (GAMMA * LAMBDA) ** m * (reward + GAMMA * after - value_of(observation))
        advantages.append(total)
    return advantages


@pytest.mark.parametrize("seed", range(3))
def test_advantages_of_ragged_lives_equal_sums_written_out(seed):
    spec, rollout, env = play(steps=60, crash=0.05, seed=seed)
    masks = rollout.masks()
    advantages, _ = generalised_advantages(
        torch.tensor(rollout.rewards, dtype=torch.float64),
        torch.tensor(value_of(rollout.views.observations[0][""])),
        torch.tensor(value_of(rollout.final.observations[0][""])).reshape(-1, 3),
        torch.tensor(rollout.final_at),
        torch.tensor(masks.bootstrap),
        torch.tensor(masks.chain),
        gamma=GAMMA,
        lambda_=LAMBDA,
    )
    found = {}
    alive = rollout.views.alive[:-1]
    for t, b, i in np.argwhere(alive):
        found[tuple(rollout.views.observations[0][""][t, b, i])] = float(advantages[t, b, i])
    open_lives = [rows for copy in env._envs for rows in copy.open.values()]
    compared = 0
    for rows in [*Logged.log, *open_lives]:
        for row, expected in zip(rows, brute_force(rows), strict=True):
            assert found.pop(tuple(row[0])) == pytest.approx(expected, abs=1e-5)
            compared += 1
    assert compared > 100
    assert not found, "the rollout holds actions that nobody took"
    assert rollout.failed.any()
    assert spec.agents == ("a", "b", "c")


def test_replayed_next_observations_are_the_true_ones():
    spec, rollout, env = play(steps=80, crash=0.05, seed=3)
    replay = JointReplay(spec, 1000)
    replay.add(rollout)
    batch = replay.sample(np.random.default_rng(0), 5000)
    truth = {}
    for rows in [*Logged.log, *(rows for copy in env._envs for rows in copy.open.values())]:
        for observation, reward, following, end in rows:
            truth[tuple(observation)] = (reward, following, end)
    now, following = batch.observations[0][""].numpy(), batch.next.observations[0][""].numpy()
    for m, i in np.argwhere(batch.alive.numpy()):
        reward, expected, end = truth[tuple(now[m, i])]
        assert batch.rewards[m, i].item() == pytest.approx(reward)
        assert batch.bootstrap[m, i].item() == (end != "end")
        if end != "end":
            np.testing.assert_array_equal(following[m, i], expected)
            assert batch.next.alive[m, i]


class Ending(Constant):
    """Ends for good after ten steps; the observation is the time."""

    ends = True

    def observe(self):
        return {a: np.full(1, self.t / 10, np.float32) for a in self.agents}


def test_nobody_is_there_after_the_last_step_of_a_game_that_ends_for_all():
    """Nothing of the next episode: a team's value, valued by who is there next, would grow without bound."""
    env = JointVector(lambda b: Ending(), 2)
    spec = JointSpec.build(env.spaces)
    replay = JointReplay(spec, 1000)
    replay.add(Sampler(env, Uniform(), spec, seed=0, max_failures=0).fragment(35, None))
    batch = replay.sample(np.random.default_rng(0), 500)
    last = batch.observations[0][""][..., 0] > 0.85
    assert last.any()
    assert torch.equal(batch.next.alive, ~last)
    assert torch.equal(batch.bootstrap, ~last)
    torch.testing.assert_close(
        batch.next.observations[0][""][..., 0], torch.where(last, 0, batch.observations[0][""][..., 0] + 0.1)
    )


def test_final_rows_of_joined_rollouts_are_where_their_trajectories_are_cut():
    joined = JointRollout.concat([play(steps=40, crash=0.05, seed=seed)[1] for seed in range(2)])
    assert sorted(joined.final_at.tolist()) == np.argwhere(joined.masks().last.any(-1)).tolist()


def test_masks_by_hand():
    #              step 0 dies | 1 cut alone | 2 leaves unflagged | 3 goes on
    alive = np.array([[[1, 1, 1, 1]], [[0, 0, 0, 1]]], bool)
    terminated = np.array([[[1, 0, 0, 0]]], bool)
    truncated = np.array([[[0, 1, 0, 0]]], bool)
    no = np.zeros((1, 1), bool)
    masks = derive_masks(alive, terminated, truncated, no, no)
    assert masks.bootstrap.tolist() == [[[False, True, True, True]]]
    assert masks.chain.tolist() == [[[False, False, False, True]]]
    assert masks.last.tolist() == [[[False, True, True, False]]]
    assert masks.fresh[1].tolist() == [[False, False, False, False]]
