"""Agents of strangers, which learn nothing of an episode but what their vehicles see."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.agents.acting import Request, part_of
from smarts.agents.hosting.remote import RemoteAgent
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.errors import SmartsError


class RefusedError(SmartsError):
    """An entry of a submission is not evaluated, or its evaluation has failed."""


class BlindAgent(BatchAgent):
    """Asks another agent, which learns no more of the episode than what it sees.

    The run's seed, world and episode are functions of no number of the request: the seed of the agent's draws
    is a digest of the first observation of its vehicle, so that draws repeat with the episode, and vehicles
    are numbered as they come.

    Args:
        agent: The other agent.
    """

    observation: Any  # pyright: ignore[reportIncompatibleVariableOverride]
    period: Any  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, agent: BatchAgent) -> None:
        self._agent, self.observation, self.period = agent, agent.observation, agent.period
        self._seeds: dict[int, int] = {}
        self._holds: dict[int, int] = {}
        self._count = 0

    def act(self, obs: ActionBatch) -> NDArray:
        """Return the other agent's actions.

        Raises:
            RefusedError: It cannot act on what it sees.
        """
        for row in np.flatnonzero(obs.is_first).tolist():
            vehicle = int(obs.agent_id[row])
            self._seeds[vehicle], self._holds[vehicle] = _digest_of(obs, row), self._count
            self._count += 1
        nothing, vehicles = np.zeros(len(obs.env_id), np.int32), obs.agent_id.tolist()
        hold = np.array([self._holds[vehicle] for vehicle in vehicles], np.int64)
        seed = np.array([self._seeds[vehicle] for vehicle in vehicles], np.uint64)
        try:
            return self._agent.act(obs._replace(env_id=nothing, hold=hold, episode=nothing, seed=seed))
        except SmartsError:
            raise
        except Exception as error:
            raise RefusedError(f"cannot act: {type(error).__name__}: {error}") from error


class SeparateAgents(RemoteAgent):
    """Asks an agent elsewhere about each vehicle through a connection of its own.

    `smarts_agent_kit` and `smarts-bench serve` act for each connection in a process of its own, where nothing
    is known of other vehicles.

    Args:
        agent: As it was made for all vehicles; it is not asked itself.
    """

    def __init__(self, agent: RemoteAgent) -> None:
        super().__init__(agent.start, agent.facts)
        self._agents: dict[int, RemoteAgent] = {}

    def act(self, obs: ActionBatch) -> NDArray:
        """Return the actions of the vehicles, which are asked for one after the other.

        Raises:
            HostError: One fails, or does not answer.
            ValueError: Answers are of different shapes.
        """
        if not len(obs.agent_id):
            return super().act(obs)
        answers = []
        for row, vehicle in enumerate(obs.agent_id.tolist()):
            if vehicle not in self._agents:
                self._agents[vehicle] = RemoteAgent(self.start, self.facts)
            alone = part_of(Request(obs), np.arange(len(obs.agent_id)) == row)
            answers.append(self._agents[vehicle].act(alone.batch))
        return np.concatenate(answers)

    def close(self) -> None:
        """End the agents; may be called again."""
        for each in self._agents.values():
            each.close()
        super().close()


def _digest_of(obs: ActionBatch, row: int) -> int:
    """Return a number of what a vehicle sees, in [0, 2^64)."""
    seen = hashlib.blake2b(digest_size=8)
    for name in sorted(obs.observations):
        seen.update(name.encode() + np.ascontiguousarray(obs.observations[name][row]).tobytes())
    seen.update(obs.action_mask[row].tobytes() + str(int(obs.agent_id[row])).encode())
    return int.from_bytes(seen.digest(), "little")
