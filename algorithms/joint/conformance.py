"""A check that a vector environment keeps the contract of `algorithms.joint.env`, for its authors' tests."""

from __future__ import annotations

import copy
from collections.abc import Mapping

import numpy as np
from gymnasium.spaces import Discrete

from algorithms.errors import SpaceError
from algorithms.joint.env import AgentBlock, Bools, Ints, JointStep, VectorJointEnv


def check_vector_env(env: VectorJointEnv, *, steps: int = 200, seed: int = 0) -> None:
    """Play random allowed actions and verify every step, then that episodes depend on (seed, index) alone.

    Raises:
        SpaceError: The contract is broken; the message says where.
    """
    indices = np.arange(env.num_envs)
    first = _play(env, indices, steps, seed)
    second = _play(env, indices, steps, seed)
    for t, (one, other) in enumerate(zip(first, second, strict=True)):
        _require(
            bool(np.array_equal(one.rewards, other.rewards)),
            t,
            "rewards differ when the same seed is replayed",
        )
        for a, b in zip(one.observations, other.observations, strict=True):
            same = all(np.array_equal(a[name], b[name]) for name in a)
            _require(same, t, "observations differ when the same seed is replayed")


def _play(env: VectorJointEnv, indices: Ints, steps: int, seed: int) -> list[JointStep]:
    rng = np.random.Generator(np.random.Philox(seed))
    now = copy.deepcopy(env.reset(seed, indices))
    _check_shapes(env, now, 0)
    history = [now]
    for t in range(1, steps + 1):
        step = copy.deepcopy(env.step(random_actions(env, now, rng)))
        _check_shapes(env, step, t)
        _check_ends(now.alive, step, t)
        _check_final(step, t)
        history.append(step)
        now = step
    return history


def _check_shapes(env: VectorJointEnv, step: JointStep, t: int) -> None:
    agents = sum(len(block.agents) for block in env.spaces.blocks)
    for name in ("rewards", "terminated", "truncated", "alive"):
        array = getattr(step, name)
        _require(array.shape == (env.num_envs, agents), t, f"`{name}` has shape {array.shape}")
    for name in ("terminated", "truncated", "alive", "reset"):
        _require(getattr(step, name).dtype == bool, t, f"`{name}` is not boolean")
    for block, leaves in zip(env.spaces.blocks, step.observations, strict=True):
        _check_leaves(block, leaves, env.num_envs, t)
    if env.spaces.state:
        shape = None if step.state is None else step.state.shape
        _require(shape == (env.num_envs, env.spaces.state), t, f"`state` has shape {shape}")


def _check_leaves(block: AgentBlock, leaves: Mapping[str, np.ndarray], num_envs: int, t: int) -> None:
    for name, space in block.observation.items():
        leaf = leaves[name]
        shape = (num_envs, len(block.agents), *space.shape)
        _require(leaf.shape == shape, t, f"observation leaf {name!r} has shape {leaf.shape}, not {shape}")
        _require(
            leaf.dtype == space.dtype, t, f"observation leaf {name!r} is {leaf.dtype}, not {space.dtype}"
        )


def _check_ends(acted: Bools, step: JointStep, t: int) -> None:
    valid = np.ones(len(acted), bool)
    valid[list(step.failed)] = False
    ended = (step.terminated | step.truncated) & valid[:, None]
    _require(not (ended & ~acted).any(), t, "an inactive agent ended")
    _require(
        not ((step.rewards != 0) & ~acted & valid[:, None]).any(), t, "an agent was rewarded that did not act"
    )
    _require(not (step.terminated & step.truncated).any(), t, "an agent both terminated and was truncated")
    taken_over = step.reset.copy()
    if step.final is not None:
        taken_over[step.final.rows] = True
    back = ended & step.alive & ~taken_over[:, None]
    _require(not back.any(), t, "an agent that ended is alive, yet its last observation is not in `final`")
    left = acted & ~step.alive & ~ended & valid[:, None] & ~step.reset[:, None]
    _require(not left.any(), t, "an agent that acted is gone without having terminated or been truncated")
    may_be_empty = step.reset | ended.any(1) | ~valid | ~acted.any(1)
    _require(
        bool((step.alive.any(1) | may_be_empty).all()),
        t,
        "no agent is active in an environment that was not reset, and in which none has ended",
    )


def _check_final(step: JointStep, t: int) -> None:
    needed = set(np.flatnonzero(step.reset).tolist()) - set(step.failed)
    given = set() if step.final is None else set(step.final.rows.tolist())
    _require(
        needed <= given, t, f"environments {sorted(needed - given)} were reset without final observations"
    )


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


def _require(holds: bool, t: int, problem: str) -> None:
    if not holds:
        raise SpaceError(
            f"step {t}: {problem}", place="vector environment", remedy="see algorithms/joint/env.py"
        )
