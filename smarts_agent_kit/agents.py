"""Agents, and the batches that they act on.

Axis letter: N agents of a request.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

LONGEST_DECISION = 100
"""The most steps from one decision of an agent to the next."""


class Agent:
    """Acts on what it sees. Subclasses define `act`."""

    @classmethod
    def from_function(
        cls,
        agent_function: Callable[[Any], Any] | None = None,
        *,
        policy_function: Callable[[Any], Any] | None = None,
    ) -> Agent:
        """Return an agent that acts by a function of the observation; either argument's name will do.

        Raises:
            TypeError: There is no function, or it cannot be called.
        """
        function = agent_function if policy_function is None else policy_function
        if not callable(function):
            raise TypeError(f"from_function() needs a function of the observation, not {function!r}")
        return _FunctionAgent(function)

    def act(self, obs: Any) -> Any:
        """Return the action for an (adapted) observation."""
        raise NotImplementedError(f"{type(self).__name__} does not define act(obs)")


class _FunctionAgent(Agent):
    def __init__(self, function: Callable[[Any], Any]) -> None:
        self._function = function

    def act(self, obs: Any) -> Any:
        return self._function(obs)


class ActionBatch(NamedTuple):
    """A request for the actions of N agents of one policy, in any simulations; arrays of shape (N, ...)."""

    observations: Mapping[str, NDArray]
    """Observations by field, shape (N, *shape); the policy may keep them."""
    action_mask: NDArray[np.bool_]
    """Whether each of the four lane actions may be chosen, shape (N, 4)."""
    env_id: NDArray[np.int32]
    """The simulation."""
    agent_id: NDArray[np.int32]
    """The agent's column in it."""
    hold: NDArray[np.int64]
    """Number of the agent among all that have held a column of its simulation, in all episodes."""
    episode: NDArray[np.int32]
    """Number of the simulation's episode."""
    step: NDArray[np.int32]
    """Step of the episode."""
    is_first: NDArray[np.bool_]
    """Whether this is the first request for this agent."""
    seed: NDArray[np.uint64]
    """Seed of the agent's random draws: a function of the run's seed, world, episode and agent alone."""
    drives: NDArray[np.bool_]
    """Whether the agent drives its vehicle; in a bubble's air-lock it only observes. Its last action there is
    carried out when it takes the vehicle over."""


class AgentPolicy(Agent):
    """The paper's name of `Agent`."""


class BatchAgent(Agent):
    """Acts for all its vehicles of all simulations by one call on arrays; it is made once in a run.

    What it remembers of a vehicle is keyed by (env_id, agent_id) and starts over where `batch.is_first`; what
    it draws at random comes from `batch.seed`: a run repeats bit for bit, whatever its number of simulations.

    Finite numbers outside of the action's space are clipped, as those of learning agents are. An agent whose
    action is NaN, or no action of the space's shape, fails alone. If `act` raises, all agents of the call
    fail, in all simulations, and it is not asked about them again; it is called for vehicles that come later.
    So a simulation of a batch equals the simulation alone as long as `act` does not raise; let it return NaN
    for the agents that it cannot act for.
    """

    observation: ClassVar[Any] = "benchmark"
    """What it observes: a name of `observations.yaml`, or a list or dict of features."""
    period: ClassVar[int] = 1
    """Steps from one decision to the next."""
    interface: ClassVar[Any] = None
    """How its vehicles act: a mapping of plain values, as {"action": "Lane"}; see docs/guide/hosts.md."""

    def act(self, obs: ActionBatch) -> NDArray:
        """Return the actions, shape (N,) for numbers of discrete actions, else (N, K)."""
        raise NotImplementedError(f"{type(self).__name__} does not define act(batch)")
