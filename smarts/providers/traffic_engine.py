"""The protocol of traffic engines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from smarts.arrays import Bools, Bytes, Ints
from smarts.errors import TrafficError
from smarts.types.episode import EpisodeStart


class TrafficEngine(Protocol):
    """Moves the vehicles with its owner number in B simulations, and reacts to all other vehicles.

    An engine is constructed by `Engine(world, maps, owner=number)`; `maps` are the lane graphs, indexed by
    `world.map`. It reads all of `world`. In the simulations of a call, it writes:

    - arrivals and departures, by `world.registry`; it admits no vehicle beyond `EpisodeStart.limit`, and none
      that overlaps a vehicle that enters in the same step;
    - motion, `desired_speed` and `route` (a number of `world.routes`) of the vehicles that it owns, and their
      lanes and places on these if it knows them: these are `world.placed`;
    - `world.signals`, where it controls traffic lights.

    The engine follows changes of the arrays. It owns a vehicle from the step after the owner column changes
    to its number; it reacts to a vehicle after the column changes to another number; a dismissed vehicle is
    removed. `route` is the planned route of another provider's vehicle, -1 if unknown.

    Several engines with different numbers may run in one simulation.
    """

    failures: Mapping[int, TrafficError]
    """Errors of the last step, by simulation; the caller resets these simulations."""

    is_full: Bools
    """Whether the vehicle limit has delayed arrivals in this episode, shape (B,)."""

    def reset(self, starts: Mapping[int, EpisodeStart]) -> None:
        """Begin episodes in simulations whose first agents are in the world already.

        Args:
            starts: The episode of each simulation to reset.

        Raises:
            TrafficError: An episode cannot begin; the caller resets all these simulations again.
        """
        ...

    def step(self, env_mask: Bools) -> None:
        """Advance simulations by `world.dt`; other providers' vehicles have their poses of the step's end.

        Args:
            env_mask: The simulations to step, shape (B,).
        """
        ...

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """Return for each vehicle whether the engine can take it over, as a `Refusal`, shape (N,).

        Args:
            rows: Simulation of each vehicle, shape (N,).
            slots: Slot of each vehicle, shape (N,).
        """
        ...

    def close(self) -> None:
        """Free the engine's resources; may be called repeatedly."""
        ...


@runtime_checkable
class KeepsVehicles(Protocol):
    """A traffic engine that keeps some of its vehicles for a while; others release each at any time."""

    def can_release(self, rows: Ints, slots: Ints) -> Bytes:
        """Return for each vehicle whether an agent can take it from the engine, as a `Refusal`, shape (N,).

        Args:
            rows: Simulation of each vehicle, shape (N,).
            slots: Slot of each vehicle, shape (N,).
        """
        ...
