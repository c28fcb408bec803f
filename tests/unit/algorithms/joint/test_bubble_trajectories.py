"""Advantages of agents that learn in bubbles, against a log kept vehicle by vehicle and sums written out."""

from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch

from algorithms.joint.replay import JointReplay
from algorithms.joint.sampler import Sampler
from algorithms.joint.spec import JointSpec
from algorithms.parts.advantages import generalised_advantages
from algorithms.parts.distributions import SampledActions
from smarts.env import VectorHiWayEnv

pytestmark = pytest.mark.nightly

LEFT_TURN = Path(__file__).parents[4] / "examples" / "left_turn_bubble"
GAMMA, LAMBDA, STEPS = 0.9, 0.8, 220


class KeepLane:
    """Stands for policies."""

    has_log_prob = False

    def act(self, view, exploration, generator):
        return [SampledActions(torch.zeros(view.alive.shape, dtype=torch.int64), None, torch.zeros(1))]


class Row(NamedTuple):
    """One decision of one vehicle's driver."""

    place: tuple[int, int, int]
    """Step of the fragment, simulation, column."""
    seen: dict
    reward: float
    following: dict
    is_terminated: bool


class Logged:
    """An environment that keeps what each driver of a vehicle saw and got, by the number of its hold."""

    def __init__(self, env):
        self._env, self.spaces, self.num_envs = env, env.spaces, env.num_envs
        self.lives = defaultdict(list)
        self.ended = {}
        self._time = 0

    def reset(self, *arguments, **options):
        return self._keep(self._env.reset(*arguments, **options))

    def step(self, actions):
        before, alive, holds = self._seen, self._alive, self._holds
        step = self._env.step(actions)
        final = {} if step.final is None else {int(b): k for k, b in enumerate(step.final.rows)}
        for b, i in np.argwhere(alive).tolist():
            leaves = step.final.observations[0] if b in final else step.observations[0]
            following = _of(leaves, final.get(b, b), i)
            life, is_over = (b, int(holds[b, i])), bool(step.terminated[b, i])
            row = Row((self._time, b, i), _of(before, b, i), float(step.rewards[b, i]), following, is_over)
            self.lives[life].append(row)
            if step.terminated[b, i] or step.truncated[b, i]:
                self.ended[life] = "reset" if b in final else "inside"
        self._time += 1
        return self._keep(step)

    def _keep(self, step):
        self._seen = {name: array.copy() for name, array in step.observations[0].items()}
        self._alive = step.alive.copy()
        self._holds = self._env._runner._pool.serial[:, : step.alive.shape[1]].copy()
        return step


def _of(leaves, b, i):
    return {name: array[b, i].copy() for name, array in leaves.items()}


def value_of(leaves, leading):
    """Return a value that depends on every number of an observation, shape `leading`."""
    total = np.zeros(leading)
    for array in leaves.values():
        flat = np.asarray(array, np.float64).reshape(*leading, -1)
        total += np.sin(1.0 + flat + np.arange(flat.shape[-1])).sum(-1)
    return total


def written_out(rows):
    """Return the advantages of one life by the defining double sum."""
    errors = [
        row.reward
        + GAMMA * (0.0 if row.is_terminated else value_of(row.following, ()))
        - value_of(row.seen, ())
        for row in rows
    ]
    powers = (GAMMA * LAMBDA) ** np.arange(len(rows))
    return [float(powers[: len(rows) - k] @ errors[k:]) for k in range(len(rows))]


@pytest.fixture(scope="module")
def played():
    env = VectorHiWayEnv(2, [LEFT_TURN], 2, learn_in_bubbles=True, episode_time=30.0)
    try:
        logged = Logged(env)
        spec = JointSpec.build(env.spaces)
        yield logged, spec, Sampler(logged, KeepLane(), spec, seed=5).fragment(STEPS, None)
    finally:
        env.close()


def test_advantages_of_drivers_that_leave_equal_sums_written_out(played):
    logged, _, rollout = played
    masks, (leaves,), (last,) = rollout.masks(), rollout.views.observations, rollout.final.observations
    advantages, _ = generalised_advantages(
        torch.tensor(rollout.rewards, dtype=torch.float64),
        torch.tensor(value_of(leaves, (STEPS + 1, 2, 2))),
        torch.tensor(value_of(last, (len(rollout.final_at), 2))),
        torch.tensor(rollout.final_at),
        torch.tensor(masks.bootstrap),
        torch.tensor(masks.chain),
        gamma=GAMMA,
        lambda_=LAMBDA,
    )
    compared = 0
    for rows in logged.lives.values():
        for row, expected in zip(rows, written_out(rows), strict=True):
            assert rollout.views.alive[row.place]
            assert float(advantages[row.place]) == pytest.approx(expected, rel=1e-6, abs=1e-6)
            compared += 1
    assert compared == rollout.views.alive[:-1].sum() > 200


def test_columns_are_used_again_and_ends_are_of_every_kind(played):
    logged, _, rollout = played
    columns = defaultdict(list)
    for (b, _), rows in logged.lives.items():
        columns[b, rows[0].place[2]].append(rows)
    again = sum(
        before[-1].place[0] + 1 == after[0].place[0]
        for lives in columns.values()
        for before, after in pairwise(lives)
    )
    assert again, "a vehicle comes in the decision in which another one leaves"
    assert {"reset", "inside"} == set(logged.ended.values())
    assert rollout.truncated.any()
    masks = rollout.masks()
    for rows in logged.lives.values():
        assert all(masks.chain[row.place] for row in rows[:-1])
        assert not masks.chain[rows[-1].place] or rows[-1].place[0] == STEPS - 1


def test_replayed_next_observations_are_those_of_the_same_vehicle(played):
    logged, spec, rollout = played
    replay = JointReplay(spec, 1000)
    replay.add(rollout)
    truth = {value_of(row.seen, ()).item(): row for rows in logged.lives.values() for row in rows}
    batch = replay.sample(np.random.default_rng(0), 2000)
    now, following = batch.observations[0], batch.next.observations[0]
    for m, i in np.argwhere(batch.alive.numpy()).tolist():
        row = truth[value_of({name: array[m, i].numpy() for name, array in now.items()}, ()).item()]
        assert batch.rewards[m, i].item() == pytest.approx(row.reward)
        assert bool(batch.bootstrap[m, i]) != row.is_terminated
        if not row.is_terminated:
            for name, array in following.items():
                assert np.array_equal(array[m, i].numpy(), row.following[name])
