"""The interface of traffic engines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from smarts.arrays import Bools, Bytes, Ints
from smarts.errors import TrafficError
from smarts.types.episode import EpisodeStart


class TrafficEngine(Protocol):
    """Moves the vehicles that carry its owner number, in B simulations, in sight of all others.

    An engine is made by `Engine(world, maps, owner=number)`, `maps` being the lane graphs in the order of
    `world.map`. It reads all of `world`, and writes of the simulations that take part:

    - identity of arrivals and departures, by `world.registry`; it admits none beyond `EpisodeStart.limit`
      vehicles in the simulation, and none onto a vehicle that enters in the same step;
    - motion and `desired_speed` of the vehicles that it owns, and their `route`, a number of `world.routes`;
    - `world.signals`, where it controls lights.

    It follows the arrays: a vehicle whose owner changes to its number is its own from the next step on, one
    whose owner changes to another is to be reacted to, one that has been dismissed is gone. Where `route` is
    not -1, it says where a vehicle of others is bound for.

    Several engines may run in one simulation, under different numbers.
    """

    failures: Mapping[int, TrafficError]
    """What went wrong in the last step, by row; those rows are to be reset."""

    is_full: Bools
    """Whether arrivals have had to wait for room under the limit in this episode, shape (B,)."""

    def reset(self, starts: Mapping[int, EpisodeStart]) -> None:
        """Begin episodes, by row, in simulations that hold their first agents.

        Raises:
            TrafficError: The engine refuses; all these rows are to be reset again.
        """
        ...

    def step(self, env_mask: Bools) -> None:
        """Advance some simulations by `world.dt`; others' vehicles are where they are at its end.

        Args:
            env_mask: Which simulations, shape (B,).
        """
        ...

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """Return for each vehicle the `Refusal` to drive on with it from where it is; changes nothing.

        Args:
            rows: Simulation of each vehicle, shape (N,).
            slots: Slot of each vehicle, shape (N,).
        """
        ...

    def close(self) -> None:
        """Free what the engine holds; may be called again."""
        ...
