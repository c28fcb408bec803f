"""The feature `neighbors`."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats, Ints, Singles
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import RADIUS, SPEED_SCALE, compressed
from smarts.sensors.nearest import nearest_vehicles
from smarts.types.agent_states import AgentStates
from smarts.types.vehicles import VehicleStates

NEIGHBORS = 8
NEIGHBOR_VALUES = 5
"""Of each: nearness, position ahead and to the left, relative velocity ahead and to the left."""


class Neighbors(Feature):
    """The eight nearest vehicles within 50 m, nearest first, as seen from the agent's vehicle.

    Of each: 1 - distance / 50 m; compressed: position ahead and to the left, velocity relative to the own one
    ahead and to the left. Of equally near vehicles the one of the lower slot comes first.
    """

    size = NEIGHBORS * NEIGHBOR_VALUES

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        world = self.context.scene.world
        return bind(_observe, world.agents, world.vehicles, self.context.agent_ids, *out)


@kernel
def velocity(vehicles: VehicleStates, b: int, slot: int) -> tuple[float, float]:
    """Return a vehicle's velocity along x and y [m/s]."""
    cos, sin = math.cos(vehicles.heading[b, slot]), math.sin(vehicles.heading[b, slot])
    speed, aside = vehicles.speed[b, slot], vehicles.lateral_speed[b, slot]
    return speed * cos - aside * sin, speed * sin + aside * cos


@kernel
def neighbors_within(vehicles: VehicleStates, b: int, own: int, found: Ints, squares: Floats) -> int:
    """List the nearest vehicles nearer than `RADIUS`; see `nearest_vehicles`."""
    count = nearest_vehicles(vehicles, b, own, RADIUS, found, squares)
    while count > 0 and squares[count - 1] >= RADIUS * RADIUS:
        count -= 1
    return count


@kernel
def _observe(
    agents: AgentStates, vehicles: VehicleStates, agent_ids: Ints, out: Singles, observe_mask: Bools
) -> None:
    found, squares = np.empty(NEIGHBORS, np.int32), np.empty(NEIGHBORS)
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            own, numbers = agents.slot[b, agent_ids[g]], out[b, g]
            count = neighbors_within(vehicles, b, own, found, squares)
            x, y = vehicles.position[b, own, 0], vehicles.position[b, own, 1]
            cos, sin = math.cos(vehicles.heading[b, own]), math.sin(vehicles.heading[b, own])
            own_vx, own_vy = velocity(vehicles, b, own)
            numbers[:] = 0.0
            for place in range(count):
                slot, first = found[place], place * NEIGHBOR_VALUES
                dx, dy = vehicles.position[b, slot, 0] - x, vehicles.position[b, slot, 1] - y
                vx, vy = velocity(vehicles, b, slot)
                vx, vy = vx - own_vx, vy - own_vy
                numbers[first] = 1.0 - math.sqrt(squares[place]) / RADIUS
                numbers[first + 1] = compressed(dx * cos + dy * sin, RADIUS)
                numbers[first + 2] = compressed(dy * cos - dx * sin, RADIUS)
                numbers[first + 3] = compressed(vx * cos + vy * sin, SPEED_SCALE)
                numbers[first + 4] = compressed(vy * cos - vx * sin, SPEED_SCALE)
