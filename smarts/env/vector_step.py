"""What the vector environment returns: spaces, and the result of a decision."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray

from smarts.arrays import Bools, Singles

Ints = NDArray[np.integer]
Leaves = Mapping[str, NDArray]


class Block(NamedTuple):
    """Agents with equal spaces; they occupy contiguous columns."""

    agents: tuple[str, ...]
    """Names, in column order."""
    observation: Mapping[str, Box]
    """Space of each array of the observation: its path, such as "ego_vehicle_state/speed"; "" if there is
    only one."""
    action: Box | Discrete
    masked: bool
    """Whether there are action masks."""


class Spaces(NamedTuple):
    """The spaces of all agents."""

    blocks: tuple[Block, ...]
    """Blocks of agents in the order of their columns."""
    state: int = 0
    """Size of a global state; 0: no state."""
    has_graph: bool = False


class Final(NamedTuple):
    """The last observations of simulations that were reset in a step."""

    rows: Ints
    """Indices of these simulations, shape (K,)."""
    observations: tuple[Leaves, ...]
    """Last observations per block, shape (K, n, ...)."""
    masks: tuple[Bools | None, ...]
    """Action masks per block, shape (K, n, actions)."""
    state: None = None
    graph: None = None


class VectorStep(NamedTuple):
    """The result of one decision of all simulations, after resets; valid until the next."""

    observations: tuple[Leaves, ...]
    """Observations per block, shape (B, n, ...), after resets. If an agent ends before its simulation,
    this is its last observation; later ones are zero."""
    rewards: Singles
    """0 for agents that did not act, shape (B, N)."""
    terminated: Bools
    """The agent's episode terminated, shape (B, N)."""
    truncated: Bools
    """The agent's episode was truncated, shape (B, N)."""
    alive: Bools
    """Agents that act in the next step, shape (B, N)."""
    reset: Bools
    """Simulations that were reset in this step, shape (B,)."""
    final: Final | None = None
    """Last observations of the simulations that were reset."""
    masks: tuple[Bools | None, ...] = ()
    """Allowed actions per block, shape (B, n, actions). Agents that do not act get a mask with only
    action 0 allowed, so that masked logits are not all infinite."""
    state: None = None
    graph: None = None
    failed: Mapping[int, BaseException] = {}
    """Simulations whose traffic failed and that were reset: the rest of their step is invalid."""
    metrics: Mapping[int, Mapping[str, float]] = {}
    """Metrics of the simulations that were reset: shares of the agents by outcome, and steps."""
    social_failures: Mapping[int, Mapping[str, str]] = {}
    """Social agents that have failed since the last result, by simulation and name, also in the steps of
    a reset, and why: the fallback controller drives their vehicles."""
    social_infos: Mapping[int, Mapping[str, Any]] = {}
    """Other facts about social agents, by simulation: `kept_out`, the names of agents that cannot
    enter, `bubbles`, counts of what happened in the episode so far, by id, and `late_decisions`, numbers of
    late decisions, by policy; for simulations that were reset, in the episode that has ended."""
