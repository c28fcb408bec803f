"""The traffic engine SUMO: one copy of libsumo per simulation, stepped in turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.errors import TrafficError
from smarts.providers.sumo_traffic import SumoTraffic
from smarts.providers.traffic_engine import TrafficEngine
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode import EpisodeStart
from smarts.types.vehicles import Owner
from smarts.types.world import World


class SumoEngine(TrafficEngine):
    """Runs SUMO in B simulations. If one fails, the others continue, and its next reset uses a new copy.

    Args:
        world: The world.
        maps: The maps, by their number in the atlas.
        owner: The engine's owner number.
        step: Duration of SUMO's step [s], see `SumoTraffic`.
    """

    def __init__(
        self, world: World, maps: Sequence[LaneGraph], owner: int = Owner.TRAFFIC, step: float | None = None
    ) -> None:
        self.failures: Mapping[int, TrafficError] = {}
        self.is_full = np.zeros(world.worlds, np.bool_)
        self._world, self._maps, self._owner = world, tuple(maps), owner
        self._step = step
        self._simulations = [self._make(row) for row in range(world.worlds)]
        self._broken: set[int] = set()

    def reset(self, starts: Mapping[int, EpisodeStart]) -> None:
        """See `TrafficEngine`."""
        for row, start in starts.items():
            if row in self._broken:
                with suppress(TrafficError):
                    self._simulations[row].close()
                self._simulations[row] = self._make(row)
            self._broken.add(row)
            self._simulations[row].reset(
                start.traffic, start.traffic_seed, self._maps[start.map], start.limit
            )
            self._broken.discard(row)
            self.is_full[row] = self._simulations[row].is_full

    def step(self, env_mask: Bools) -> None:
        """See `TrafficEngine`."""
        failures: dict[int, TrafficError] = {}
        for row in np.flatnonzero(env_mask).tolist():
            try:
                self._simulations[row].step()
                self.is_full[row] = self._simulations[row].is_full
            except TrafficError as error:
                self._broken.add(row)
                failures[row] = error
        self.failures = failures

    def can_accept(self, rows: Ints, slots: Ints) -> Bytes:
        """See `TrafficEngine`; `SumoGate` decides."""
        vehicles = zip(rows.tolist(), slots.tolist(), strict=True)
        return np.array([self._simulations[row].can_accept(slot) for row, slot in vehicles], np.int8)

    def can_release(self, rows: Ints, slots: Ints) -> Bytes:
        """See `KeepsVehicles`; `SumoGate` decides."""
        vehicles = zip(rows.tolist(), slots.tolist(), strict=True)
        return np.array([self._simulations[row].can_release(slot) for row, slot in vehicles], np.int8)

    def close(self) -> None:
        """See `TrafficEngine`; failed copies are freed too."""
        for row, simulation in enumerate(self._simulations):
            with suppress(TrafficError) if row in self._broken else nullcontext():
                simulation.close()

    def _make(self, row: int) -> SumoTraffic:
        return SumoTraffic(self._world, row, self._owner, step=self._step)
