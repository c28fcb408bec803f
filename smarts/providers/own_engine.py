"""Users' own traffic engines, whose errors name engine, file and line."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.errors import OwnCodeError, shown
from smarts.providers.traffic_engine import KeepsVehicles, TrafficEngine
from smarts.registry import definition_of, guarded
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode import EpisodeStart
from smarts.types.vehicles import Owner
from smarts.types.world import World


def make_own_engine(
    name: str, kind: Callable[..., Any], world: World, maps: Sequence[LaneGraph]
) -> TrafficEngine:
    """Return a user's engine, with checks of what it raises, returns and writes.

    Raises:
        OwnCodeError: Its constructor raises.
    """
    doing = f"the traffic engine {name!r} (traffic_engine)"
    engine = guarded(kind, doing)(world, maps)
    return (OwnKeepingEngine if isinstance(engine, KeepsVehicles) else OwnEngine)(engine, doing, world)


class OwnEngine(TrafficEngine):
    """Calls a user's engine, and checks what it returns and the motion that it writes.

    Args:
        engine: The user's.
        doing: Description of the engine, for errors.
        world: World in which it moves vehicles.
    """

    def __init__(self, engine: Any, doing: str, world: World) -> None:
        self._engine, self._doing, self._world = engine, doing, world
        calls = ("reset", "step", "can_accept", "close")
        self._reset, self._step, self._can_accept, self._close = (
            guarded(getattr(engine, name), doing) for name in calls
        )
        self._read()

    def reset(self, starts: Mapping[int, EpisodeStart]) -> None:
        """See `TrafficEngine`."""
        self._reset(starts)
        self._read()
        begun = np.zeros(self._world.worlds, np.bool_)
        begun[list(starts)] = True
        self._check_motion(begun, "reset")

    def step(self, env_mask: Bools) -> None:
        """See `TrafficEngine`."""
        self._step(env_mask)
        self._read()
        self._check_motion(env_mask, "step")

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """See `TrafficEngine`."""
        return self._refusals("can_accept", self._can_accept, rows, slots)

    def close(self) -> None:
        """See `TrafficEngine`."""
        self._close()

    def _read(self) -> None:
        self.failures, self.is_full = self._engine.failures, np.asarray(self._engine.is_full, np.bool_)

    def _refusals(self, name: str, call: Callable[..., Any], rows: Ints, slots: Ints) -> Bytes:
        """Return the answer of a gate if it is one number for each vehicle."""
        if not len(rows):
            return np.zeros(0, np.int8)  # an answer for no vehicles has no type
        given = call(rows, slots)
        found = np.asarray(given)
        if found.shape != rows.shape or found.dtype.kind not in "iu":
            raise OwnCodeError(
                f"{self._doing}: {name} returns {shown(given)} for {len(rows)} vehicles",
                place=definition_of(getattr(self._engine, name)),
                remedy="return an array of a Refusal for each vehicle",
            )
        return found

    def _check_motion(self, env_mask: Bools, name: str) -> None:
        """Raise if a position, a heading or a speed that the engine wrote is not finite."""
        vehicles = self._world.vehicles
        motion = np.dstack([vehicles.position, vehicles.heading, vehicles.speed])
        bad = ~np.isfinite(motion).all(-1) & vehicles.alive & (vehicles.owner == Owner.TRAFFIC)
        bad &= env_mask[:, None]
        bad[list(self.failures)] = False
        for row, slot in np.argwhere(bad)[:1].tolist():
            raise OwnCodeError(
                f"{self._doing}: x, y, heading, speed of a vehicle are {motion[row, slot].tolist()}",
                place=definition_of(getattr(self._engine, name)),
                remedy="write finite numbers",
            )


class OwnKeepingEngine(OwnEngine):
    """Calls a user's engine that keeps some of its vehicles for a while: a `KeepsVehicles`."""

    def can_release(self, rows: Ints, slots: Ints) -> Bytes:
        """See `KeepsVehicles`."""
        release = guarded(self._engine.can_release, self._doing)
        return self._refusals("can_release", release, rows, slots)
