"""What the planning of manoeuvres reads: tasks, lanes and vehicles, as tuples of arrays for its kernels."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.controllers.lane_path import place_on_lane
from smarts.controllers.lane_state import neighbours
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads
from smarts.roads.kernels import lane_length
from smarts.roads.scene import Scene
from smarts.sim.lane_facts import lane_facts

Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]


class Surroundings(NamedTuple):
    """Axis letters: B simulations, A agents, V vehicle slots, L lanes across all maps."""

    map: Ints
    """Shape (B,)."""
    roads: Roads
    left: Ints
    """Lane to the left in the same direction, -1 for none, shape (L,)."""
    right: Ints
    edge: Ints
    """Across all maps, shape (L,)."""
    slot: Ints
    """Shape (B, A)."""
    task: Bytes
    """As in `Missions`, like the next three, shape (B, A)."""
    task_radius: Floats
    task_lane: Ints
    task_speed: Floats
    alive: NDArray[np.bool_]
    """As in `VehicleStates`, like all that follow, shape (B, V)."""
    generation: Ints
    position: Floats
    heading: Floats
    speed: Floats
    length: Floats
    width: Floats
    lane: Ints
    lane_position: Floats


def surroundings_of(scene: Scene) -> Surroundings:
    """Return the arrays of a scene; they hold for good."""
    world, atlas = scene.world, scene.atlas
    left, right = neighbours(atlas)
    known = {"map": world.map, "roads": atlas.roads, "left": left, "right": right}
    known |= {"edge": lane_facts(atlas).edge, "slot": world.agents.slot}
    for name in Surroundings._fields:
        if name not in known:
            table = world.missions if name.startswith("task") else world.vehicles
            known[name] = getattr(table, name)
    return Surroundings(**known)


@kernel
def lane_under(around: Surroundings, b: int, slot: int) -> int:
    """Return a vehicle's lane, numbered across all maps; -1 without one."""
    lane = around.lane[b, slot]
    return around.roads.lane_base[around.map[b]] + lane if lane >= 0 else -1


@kernel
def distance_between(around: Surroundings, b: int, slot: int, other: int) -> float:
    """Return the distance between the centres of two vehicles [m]."""
    own, its = around.position[b, slot], around.position[b, other]
    return math.hypot(its[0] - own[0], its[1] - own[1])


@kernel
def beside(around: Surroundings, b: int, slot: int, lane: int) -> tuple[float, float]:
    """Return where on a lane a vehicle's centre is and how much of it is left [m]; < 0 beyond the ends."""
    x, y = around.position[b, slot]
    s, _ = place_on_lane(around.roads, lane, x, y)
    return s, lane_length(around.roads, lane) - s
