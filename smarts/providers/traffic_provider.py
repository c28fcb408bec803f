"""What the simulation asks of a traffic provider, and what it gives to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.roads.lane_graph import LaneGraph
from smarts.types.traffic import TrafficFiles
from smarts.types.vehicles import VehicleKind, VehicleStates


class Roster(Protocol):
    """Issues and withdraws the slots of one simulation; implemented in `smarts.sim.roster`."""

    def admit(self, name: str, owner: int, kind: VehicleKind, length: float, width: float) -> int:
        """Give a vehicle the lowest free slot, write its identity there, and return the slot."""
        ...

    def dismiss(self, slot: int) -> None:
        """Take the vehicle out of the world and clear its row."""
        ...


class TrafficProvider(Protocol):
    """Moves the vehicles that carry its number as their owner, and reacts to all others."""

    owner: int
    """Its number among the providers."""
    signals: NDArray[np.int8]
    """What each lane's light shows, a `Signal`, shape (L,)."""
    is_full: bool
    """Whether arrivals had to wait for a free slot in this episode."""

    def reset(
        self,
        files: TrafficFiles,
        seed: int,
        states: VehicleStates,
        roster: Roster,
        roads: LaneGraph,
        limit: int | None = None,
        bound_for: Mapping[int, Sequence[str]] | None = None,
    ) -> None:
        """Begin an episode: traffic joins those who are in the world, at most `limit` vehicles with them.

        `bound_for` says where they are bound for, by slot, as `set_route` does.
        """
        ...

    def step(self, states: VehicleStates) -> None:
        """Advance by one step; the rows of others already hold the pose at its end."""
        ...

    def can_accept(self, slot: int) -> bool:
        """Return whether it could drive on with a vehicle of another from where that is now."""
        ...

    def clear(self, states: VehicleStates, slots: Sequence[int]) -> None:
        """Remove traffic from around these vehicles, and let none appear there in the next step."""
        ...

    def route(self, slot: int) -> tuple[str, ...]:
        """Return the edges that a vehicle has yet to drive, its own first."""
        ...

    def set_route(self, slot: int, edges: Sequence[str]) -> None:
        """Say where a vehicle is bound for, its present edge first."""
        ...

    def close(self) -> None:
        """Give back what the provider holds."""
        ...
