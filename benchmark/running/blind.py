"""Agents that are asked without anything that tells which episode it is."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.agents.policy import ActionBatch, BatchAgent


class BlindAgent(BatchAgent):
    """Asks another agent, which learns no more of the episode than what it sees.

    The run's seed, world and episode are functions of no number of the request: the seed of the agent's draws
    is a digest of the first observation of its vehicle, so that draws repeat with the episode.

    Args:
        agent: The other agent.
    """

    observation: Any  # pyright: ignore[reportIncompatibleVariableOverride]
    period: Any  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, agent: BatchAgent) -> None:
        self._agent, self.observation, self.period = agent, agent.observation, agent.period
        self._seeds: dict[int, int] = {}

    def act(self, obs: ActionBatch) -> NDArray:
        """Return the other agent's actions."""
        for row in np.flatnonzero(obs.is_first).tolist():
            self._seeds[int(obs.agent_id[row])] = _digest_of(obs, row)
        nothing = np.zeros(len(obs.env_id), np.int64)
        return self._agent.act(
            obs._replace(
                env_id=nothing.astype(np.int32),
                hold=nothing,
                episode=nothing.astype(np.int32),
                seed=np.array([self._seeds[agent] for agent in obs.agent_id.tolist()], np.uint64),
            )
        )


def _digest_of(obs: ActionBatch, row: int) -> int:
    """Return a number of what a vehicle sees, in [0, 2^64)."""
    seen = hashlib.blake2b(digest_size=8)
    for name in sorted(obs.observations):
        seen.update(name.encode() + np.ascontiguousarray(obs.observations[name][row]).tobytes())
    seen.update(obs.action_mask[row].tobytes() + str(int(obs.agent_id[row])).encode())
    return int.from_bytes(seen.digest(), "little")
