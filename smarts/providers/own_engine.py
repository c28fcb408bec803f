"""Users' own traffic engines, whose errors name engine, file and line."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from smarts.arrays import Bools
from smarts.errors import OwnCodeError
from smarts.providers.traffic_engine import TrafficEngine
from smarts.registry import definition_of, guarded
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode import EpisodeStart
from smarts.types.vehicles import Owner
from smarts.types.world import World


def make_own_engine(
    name: str, kind: Callable[..., Any], world: World, maps: Sequence[LaneGraph]
) -> TrafficEngine:
    """Return a user's engine, with checks of what it raises and of the motion that it writes.

    Raises:
        OwnCodeError: Its constructor raises.
    """
    doing = f"the traffic engine {name!r} (traffic_engine)"
    return OwnEngine(guarded(kind, doing)(world, maps), doing, world)


class OwnEngine:
    """Calls a user's engine, and checks the motion that it writes; a `KeepsVehicles` if the engine is one.

    Args:
        engine: The user's.
        doing: Description of the engine, for errors.
        world: World in which it moves vehicles.
    """

    def __init__(self, engine: Any, doing: str, world: World) -> None:
        self._engine, self._doing, self._world = engine, doing, world
        self._reset, self._step = guarded(engine.reset, doing), guarded(engine.step, doing)
        self.can_accept, self.close = guarded(engine.can_accept, doing), guarded(engine.close, doing)
        if hasattr(engine, "can_release"):
            self.can_release = guarded(engine.can_release, doing)
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

    def _read(self) -> None:
        self.failures, self.is_full = self._engine.failures, np.asarray(self._engine.is_full, np.bool_)

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
