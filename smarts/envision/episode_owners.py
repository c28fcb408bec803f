"""Which agent has each vehicle of a recorded episode, and what it does with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Longs
from smarts.sim.episode_files import RecordedEpisode
from smarts.types.agent_states import UNSET, AgentStatus

Vehicle = tuple[int, int]
"""Slot and generation."""


@dataclass(frozen=True)
class Holder:
    """The agent that has a vehicle in a step."""

    agent_id: int
    """The agent's column."""
    policy: int
    """Number of its social policy in `EpisodeOwners.groups`, -1 for an ego."""
    observes: bool
    """Whether traffic drives, in an air-lock."""
    leaves: bool
    """Whether the vehicle is to go back to traffic."""


class EpisodeOwners:
    """Finds the holders of vehicles in any step.

    Args:
        episode: The recorded episode.
    """

    def __init__(self, episode: RecordedEpisode) -> None:
        states, agents, holds = (episode.table(name) for name in ("agent_states", "agents", "holds"))
        order = np.argsort(states["step"], kind="stable")
        self._rows = {
            name: states[name][order]
            for name in ("step", "agent_id", "slot", "generation", "state", "release_step")
        }
        first = np.searchsorted(self._rows["step"], np.arange(int(episode.facts["steps"]) + 2))
        self._first: Longs = first
        is_ego = agents["interface"] < 0
        columns = agents["agent_id"][is_ego]
        is_in_turn = len(np.unique(columns)) < len(columns)
        self.egos = 0 if is_in_turn else len(columns)
        """Number of egos that keep their column; they are the first agents."""
        self._social_columns = np.unique(agents["agent_id"][~is_ego & (agents["agent_id"] != UNSET)])
        is_social = holds["interface"] >= 0
        names = sorted(set(holds["policy"][is_social].tolist())) or [""] * bool(len(self._social_columns))
        self.groups: dict[int, str] = {UNSET: "learning agents"} if is_in_turn else {}
        """Other agents, by number of their policy: its name, or what they are."""
        self.groups |= {number: name or "social agents" for number, name in enumerate(names)}
        self._policy = self._policies_of_rows(
            {name: column[is_social] for name, column in holds.items()}, names
        )

    def holders(self, step: int) -> dict[Vehicle, Holder]:
        """Return the vehicles that agents have in a step."""
        span = slice(self._first[step], self._first[step + 1])
        columns = (self._rows[name][span].tolist() for name in ("slot", "generation", "agent_id", "state"))
        released = self._rows["release_step"][span] != UNSET
        found = {}
        for slot, generation, agent_id, state, is_released, policy in zip(
            *columns, released.tolist(), self._policy[span].tolist(), strict=True
        ):
            observes, leaves = state == AgentStatus.SHADOWING, state == AgentStatus.LEAVING
            is_leaving = leaves or (is_released and state == AgentStatus.ACTIVE)
            found[slot, generation] = Holder(agent_id, policy, observes, is_leaving)
        return found

    def _policies_of_rows(self, holds: dict[str, NDArray], names: Sequence[str]) -> Longs:
        """Return the number of the policy of each row, -1 for egos."""
        policy = np.where(np.isin(self._rows["agent_id"], self._social_columns), 0, UNSET)
        if not len(holds["agent"]):
            return policy
        # The hold of a column that began last.
        begins = _place(holds["agent_id"], holds["first_step"])
        order = np.argsort(begins, kind="stable")
        numbers = np.array([names.index(name) for name in holds["policy"].tolist()])[order]
        found = (
            np.searchsorted(begins[order], _place(self._rows["agent_id"], self._rows["step"]), "right") - 1
        )
        return np.where(policy == UNSET, UNSET, numbers[found])


def _place(agent_id: NDArray, step: NDArray) -> Longs:
    """Return numbers in the order of columns, then steps."""
    return agent_id.astype(np.int64) << 32 | step.astype(np.int64)
