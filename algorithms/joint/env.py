"""The interface of vector environments: B environments, N agents, arrays in, arrays out.

Axis letters throughout `algorithms`: T steps of a fragment, B environments, N agents (columns), n agents of
one block or group, A discrete actions, S global state, M rows of a minibatch, K sparse rows.

The interface is duck-typed: an environment need not import this module. `JointVector` gives it to any RLlib
`MultiAgentEnv`; `tests/vector_contract.py` in the repository checks that an environment keeps the contract.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from algorithms.errors import SpaceError

Floats = NDArray[np.floating]
Bools = NDArray[np.bool_]
Ints = NDArray[np.integer]
Leaves = Mapping[str, np.ndarray]
"""Observation arrays by name: `""` for a plain Box, the path ("lidar/near") for each leaf of a Dict space."""

CARRIED = "@"
"""Names of leaves that the sampler adds to what environments deliver begin with this."""
LATENT = "@latent"
"""Leaf with what a policy drew for an agent at the episode's start, (..., n, *shape)."""
MEMORY = "@memory"
"""Leaf with the memory (..., n, H) of a recurrent policy before this observation."""

Action = Box | Discrete


class AgentBlock(NamedTuple):
    """Agents with equal spaces; they occupy contiguous columns.

    Attributes:
        agents: Names, in column order.
        observation: Space of each leaf; arrays have the dtype of the space. Learners store float32 instead of
            other floating-point numbers.
        action: Their action space.
        masked: Whether the environment gives masks of discrete actions.
    """

    agents: tuple[str, ...]
    observation: Mapping[str, Box]
    action: Action
    masked: bool = False


class JointSpaces(NamedTuple):
    """Spaces of a vector environment.

    Attributes:
        blocks: Agents by equal spaces; block order is column order.
        state: Size of the global state, 0 if the environment has none.
        has_graph: Whether steps carry a communication graph.
    """

    blocks: tuple[AgentBlock, ...]
    state: int = 0
    has_graph: bool = False


def columns_of(blocks: Sequence[AgentBlock]) -> list[slice]:
    """Return the columns of each block's agents."""
    ends = np.cumsum([len(block.agents) for block in blocks]).tolist()
    return [slice(end - len(block.agents), end) for end, block in zip(ends, blocks, strict=True)]


class FinalStep(NamedTuple):
    """True last observations of the environments whose observations were overwritten in a step.

    Attributes:
        rows: Environment numbers, shape (K,).
        observations: Per block, leaves of shape (K, n, ...).
        masks: Per block, action masks (K, n, A), or None.
        state: Global state (K, S), or None.
        graph: Communication graph (K, N, N), or None.
    """

    rows: Ints
    observations: tuple[Leaves, ...]
    masks: tuple[Bools | None, ...] = ()
    state: Floats | None = None
    graph: Bools | None = None


class JointStep(NamedTuple):
    """One step of all environments: outcomes, and what agents see next; valid until the next step.

    Attributes:
        observations: Per block, leaves of shape (B, n, ...), after auto-reset. An agent whose trajectory ends
            in this step while its environment continues keeps its last observation here, with `alive` False;
            zeros afterwards.
        rewards: Shape (B, N); zero for agents that did not act.
        terminated: Ended, not bootstrapped; shape (B, N).
        truncated: Cut short, value to be bootstrapped; shape (B, N).
        alive: Agents that act in the *next* step, shape (B, N). An agent that acted and no longer does has
            terminated or was truncated, unless its environment was reset or failed. Where agents come and
            go, an environment may be without any from a step in which one ended or which reset it, until
            one enters; `step` is then called without actions that count.
        reset: Environments that were reset in this step, shape (B,).
        final: Last observations of environments that were reset, or in which another agent took over a column
            in this step.
        masks: Per block, action masks (B, n, A), or None.
        state: Global state (B, S), or None: then the learner concatenates the observations.
        graph: Communication graph (B, N, N), `graph[b, i, j]`: i hears j; or None.
        failed: Environments whose step failed and which were recreated, with the cause; their transition is
            invalid.
        metrics: Numbers of episodes that ended, by environment.
    """

    observations: tuple[Leaves, ...]
    rewards: Floats
    terminated: Bools
    truncated: Bools
    alive: Bools
    reset: Bools
    final: FinalStep | None = None
    masks: tuple[Bools | None, ...] = ()
    state: Floats | None = None
    graph: Bools | None = None
    failed: Mapping[int, BaseException] = {}
    metrics: Mapping[int, Mapping[str, float]] = {}


@runtime_checkable
class VectorJointEnv(Protocol):
    """B parallel multi-agent environments, stepped together, with same-step auto-reset.

    Optional methods: `get_state() -> Any` (picklable) and `set_state(state)`, which make continued training
    after a restore exact; `annotate(name, values)`, which tells an environment that records or shows its
    episodes what the next step's actions were sampled from: per block, "probabilities" (B, n, A), or "mean"
    and "std" (B, n, k), bounded actions in [-1, 1]; None for the blocks that have the other.
    A vector environment that continues with another index where an episode fails has an attribute `worlds`,
    the present indices, shape (B,).
    """

    num_envs: int
    spaces: JointSpaces

    def reset(self, seed: int, indices: Ints, *, stride: int = 0) -> JointStep:
        """Start all environments.

        Args:
            seed: Root seed, 0 to 2**63 - 1. An episode is a function of it, the index and the number of
                episodes that the environment has played since this call.
            indices: Index of each environment's random stream, shape (B,).
            stride: 0: an environment plays successive episodes of its index. k > 0: it plays the first
                episode of its index w, then of w + k, and so on: a fixed list is dealt to the environments.
        """
        ...

    def step(self, actions: tuple[np.ndarray, ...]) -> JointStep:
        """Act: per block int64 (B, n), or float32 (B, n, k) in the units of the environment."""
        ...

    def recreate(self, failures: Mapping[int, BaseException]) -> JointStep:
        """Replace the given environments by fresh ones; return where all environments stand."""
        ...

    def close(self) -> None:
        """Release all resources."""
        ...


def map_arrays(function: Callable[..., Any], first: Any, *others: Any) -> Any:
    """Apply a function to the arrays at equal places of nested tuples and dicts; None stays None."""
    if first is None:
        return None
    if isinstance(first, Mapping):
        return {
            name: map_arrays(function, part, *(each[name] for each in others)) for name, part in first.items()
        }
    if isinstance(first, tuple):
        return tuple(map_arrays(function, *parts) for parts in zip(first, *others, strict=True))
    return function(first, *others)


def episode_seed(seed: int, index: int, episode: int) -> int:
    """Return the seed of one episode, in [0, 2**31); the same on every machine and in every process."""
    return int(np.random.SeedSequence([seed, index, episode]).generate_state(1)[0] >> 1)


def is_vector_env(env: Any) -> bool:
    """Return whether an environment already has the vector interface."""
    return isinstance(env, VectorJointEnv)


def name_of(env: Any) -> str:
    """Return the class of an environment as its user wrote it, whatever is wrapped around it."""
    inner = getattr(env, "par_env", env)  # RLlib's wrapper of PettingZoo's environments
    own = getattr(env, "name", None) if is_vector_env(env) else None
    return own if isinstance(own, str) else type(getattr(inner, "unwrapped", inner)).__name__


def agents_of(env: Any) -> tuple[list[str], Callable[[str], Any], Callable[[str], Any]]:
    """Return the agents of an RLlib `MultiAgentEnv`, and functions to their observation and action spaces.

    RLlib's wrapper of PettingZoo's environments knows only the agents that are there after the first reset.

    Raises:
        SpaceError: It is no environment of several agents, or leaves out their names.
    """
    methods = all(hasattr(env, name) for name in ("get_observation_space", "get_action_space"))
    if not methods or not getattr(env, "possible_agents", ()):
        raise SpaceError(
            f"{name_of(env)} has no `possible_agents`" if methods else f"{name_of(env)} is no MultiAgentEnv",
            place="environment()",
            remedy="give an RLlib MultiAgentEnv that sets `possible_agents`, an environment of PettingZoo in "
            "ParallelPettingZooEnv, or a vector environment, see docs/develop/algorithms_inside.md",
        )
    wrapped: Any = getattr(env, "par_env", None)
    if set(getattr(wrapped, "possible_agents", ())) > set(env.possible_agents):
        return list(wrapped.possible_agents), wrapped.observation_space, wrapped.action_space
    return list(env.possible_agents), env.get_observation_space, env.get_action_space
