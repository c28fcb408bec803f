"""A check that a vector environment keeps the contract of `algorithms.joint.env`."""

from __future__ import annotations

import copy

import numpy as np
from gymnasium.spaces import Discrete

from algorithms.joint.env import Bools, Ints, JointStep, VectorJointEnv


def check_vector_env(env: VectorJointEnv, *, steps: int = 200, seed: int = 0) -> None:
    """Play random allowed actions and verify every step, then that episodes depend on (seed, index) alone."""
    indices = np.arange(env.num_envs)
    first, second = _play(env, indices, steps, seed), _play(env, indices, steps, seed)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.rewards, other.rewards)
        for a, b in zip(one.observations, other.observations, strict=True):
            for name in a:
                np.testing.assert_array_equal(a[name], b[name])


def _play(env: VectorJointEnv, indices: Ints, steps: int, seed: int) -> list[JointStep]:
    rng = np.random.Generator(np.random.Philox(seed))
    now = copy.deepcopy(env.reset(seed, indices))
    _check_shapes(env, now)
    history = [now]
    for _ in range(steps):
        step = copy.deepcopy(env.step(random_actions(env, now, rng)))
        _check_shapes(env, step)
        _check_ends(now.alive, step)
        history.append(step)
        now = step
    return history


def _check_shapes(env: VectorJointEnv, step: JointStep) -> None:
    agents = sum(len(block.agents) for block in env.spaces.blocks)
    for name in ("rewards", "terminated", "truncated", "alive"):
        assert getattr(step, name).shape == (env.num_envs, agents), name
    for name in ("terminated", "truncated", "alive", "reset"):
        assert getattr(step, name).dtype == bool, name
    for block, leaves in zip(env.spaces.blocks, step.observations, strict=True):
        for name, space in block.observation.items():
            assert leaves[name].shape == (env.num_envs, len(block.agents), *space.shape), name
            assert leaves[name].dtype == space.dtype, name
    if env.spaces.state:
        assert step.state is not None
        assert step.state.shape == (env.num_envs, env.spaces.state)


def _check_ends(acted: Bools, step: JointStep) -> None:
    valid = np.ones(len(acted), bool)
    valid[list(step.failed)] = False
    ended = (step.terminated | step.truncated) & valid[:, None]
    assert not (ended & ~acted).any(), "an inactive agent ended"
    assert not ((step.rewards != 0) & ~acted & valid[:, None]).any(), "an agent was rewarded without acting"
    assert not (step.terminated & step.truncated).any(), "an agent both terminated and was truncated"
    given = np.zeros(len(acted), bool)
    if step.final is not None:
        given[step.final.rows] = True
    back = ended & step.alive & ~(step.reset | given)[:, None]
    assert not back.any(), "an agent that ended is alive, yet its last observation is not in `final`"
    left = acted & ~step.alive & ~ended & valid[:, None] & ~step.reset[:, None]
    assert not left.any(), "an agent that acted is gone without having terminated or been truncated"
    may_be_empty = step.reset | ended.any(1) | ~valid | ~acted.any(1)
    assert (step.alive.any(1) | may_be_empty).all(), "no agent is active, though none has ended"
    assert not (step.reset & valid & ~given).any(), "an environment was reset without final observations"


def random_actions(env: VectorJointEnv, now: JointStep, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Return allowed actions of all agents in all environments, in the environments' units."""
    chosen = []
    masks = now.masks or (None,) * len(env.spaces.blocks)
    for block, mask in zip(env.spaces.blocks, masks, strict=True):
        shape = (env.num_envs, len(block.agents))
        if isinstance(block.action, Discrete):
            action_mask = np.ones((*shape, int(block.action.n)), bool) if mask is None else mask
            chosen.append((rng.random(action_mask.shape) * action_mask).argmax(-1) + int(block.action.start))
        else:
            low, high = np.clip(block.action.low, -1e3, None), np.clip(block.action.high, None, 1e3)
            chosen.append(rng.uniform(low, high, (*shape, *block.action.shape)).astype(np.float32))
    return tuple(chosen)
