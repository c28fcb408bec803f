"""The interface of vector environments: B copies, N agents, arrays in, arrays out.

Axis letters throughout `algorithms`: T steps of a fragment, B copies, N agents (columns), n agents of one
block or group, A discrete actions, S global state, M rows of a minibatch, K sparse rows.

The interface is duck-typed: an environment need not import this module. `JointVector` gives it to any RLlib
`MultiAgentEnv`; `check_vector_env` tells whether an environment keeps the contract.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

Floats = NDArray[np.floating]
Bools = NDArray[np.bool_]
Ints = NDArray[np.integer]
Leaves = Mapping[str, np.ndarray]
"""Observation arrays by name: `""` for a plain Box, the path ("lidar/near") for each leaf of a Dict space."""

CARRIED = "@"
"""Names of leaves that the sampler adds to what environments deliver begin with this."""
LATENT = "@latent"
"""Leaf with what a policy drew for an agent at the beginning of the episode, (..., n, *shape)."""
MEMORY = "@memory"
"""Leaf with the memory (..., n, H) that a recurrent policy had before it saw the rest."""

Action = Box | Discrete


class Block(NamedTuple):
    """Agents with equal spaces; they occupy contiguous columns.

    Attributes:
        agents: Names, in column order.
        observation: Space of each leaf; arrays keep the dtype of the space.
        action: Their action space.
        masked: Whether the environment says which discrete actions are legal.
    """

    agents: tuple[str, ...]
    observation: Mapping[str, Box]
    action: Action
    masked: bool = False


class JointSpaces(NamedTuple):
    """What a vector environment gives and takes.

    Attributes:
        blocks: Agents by equal spaces; block order is column order.
        state: Size of the global state, 0 if the environment has none.
        has_graph: Whether steps carry a communication graph.
    """

    blocks: tuple[Block, ...]
    state: int = 0
    has_graph: bool = False


class Final(NamedTuple):
    """True last observations of the copies whose observations were overwritten in a step.

    Attributes:
        rows: Copy numbers, shape (K,).
        observations: Per block, leaves of shape (K, n, ...).
        masks: Per block, legal actions (K, n, A), or None.
        state: Global state (K, S), or None.
        graph: Communication graph (K, N, N), or None.
    """

    rows: Ints
    observations: tuple[Leaves, ...]
    masks: tuple[Bools | None, ...] = ()
    state: Floats | None = None
    graph: Bools | None = None


class JointStep(NamedTuple):
    """What happened in one step of all copies, and where they stand; valid until the next step.

    Attributes:
        observations: Per block, leaves of shape (B, n, ...), after auto-reset. An agent that ended in this
            step while its copy goes on keeps its last observation here, with `alive` False; zeros afterwards.
        rewards: Shape (B, N); zero for agents that did not act.
        terminated: Ended for good, value zero; shape (B, N).
        truncated: Cut short, value to be bootstrapped; shape (B, N).
        alive: Who acts in the *next* step, shape (B, N). Who acted and does so no more has terminated or was
            truncated, unless its copy was reset or failed.
        reset: Copies that were reset in this step, shape (B,).
        final: Last observations of copies that were reset, or in which a column was taken over in this very
            step.
        masks: Per block, legal actions (B, n, A), or None.
        state: Global state (B, S), or None: then the learner concatenates the observations.
        graph: Who hears whom, (B, N, N), `graph[b, i, j]`: i hears j, or None.
        failed: Copies whose step failed and which were recreated, with the cause; their transition is void.
        metrics: Numbers of episodes that ended, by copy.
    """

    observations: tuple[Leaves, ...]
    rewards: Floats
    terminated: Bools
    truncated: Bools
    alive: Bools
    reset: Bools
    final: Final | None = None
    masks: tuple[Bools | None, ...] = ()
    state: Floats | None = None
    graph: Bools | None = None
    failed: Mapping[int, BaseException] = {}
    metrics: Mapping[int, Mapping[str, float]] = {}


@runtime_checkable
class VectorJointEnv(Protocol):
    """B copies of a parallel multi-agent environment, stepped together, with same-step auto-reset.

    Optional methods: `get_state() -> Any` (picklable) and `set_state(state)`, which make continued training
    after a restore exact; `annotate(name, values)`, by which evaluations tell an environment that keeps
    records what the next step's actions were sampled from: per block, "probabilities" (B, n, A) or "mean_std"
    (B, n, 2, k), None for the blocks that have the other. An environment that goes on with another world
    where one fails has an attribute `worlds`, the present one of each copy, shape (B,).
    """

    num_envs: int
    spaces: JointSpaces

    def reset(self, seed: int, worlds: Ints, *, stride: int = 0) -> JointStep:
        """Start all copies.

        Args:
            seed: Root seed, 0 to 2**63 - 1. An episode is a function of it, the world and how many the copy
                has played since this call.
            worlds: World of each copy, shape (B,).
            stride: 0: the next episode of a copy is the next one of its world. Else it is the same episode of
                the world that lies `stride` further: a fixed list of worlds is dealt to the copies.
        """
        ...

    def step(self, actions: tuple[np.ndarray, ...]) -> JointStep:
        """Act: per block int64 (B, n), or float32 (B, n, k) in the units of the environment."""
        ...

    def recreate(self, failures: Mapping[int, BaseException]) -> JointStep:
        """Throw the given copies away and start fresh ones; return where all copies stand now."""
        ...

    def close(self) -> None:
        """Release all resources."""
        ...


def episode_seed(seed: int, world: int, episode: int) -> int:
    """Return the seed of one episode, in [0, 2**31); the same on every machine and in every process."""
    return int(np.random.SeedSequence([seed, world, episode]).generate_state(1)[0] >> 1)


def is_vector_env(env: Any) -> bool:
    """Return whether an environment already has the vector interface."""
    return isinstance(env, VectorJointEnv)
