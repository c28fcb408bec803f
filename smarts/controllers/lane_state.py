"""What lane following reads and writes of the world, gathered once, and the lanes beside each lane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.dynamics import vehicle, vehicle_names
from smarts.roads.atlas import RoadAtlas
from smarts.roads.scene import Scene
from smarts.types.vehicles import VehicleKind

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]


class LaneState(NamedTuple):
    """Arrays of the world as they stand there, for kernels; what is in them changes in place."""

    map: Ints
    step: Ints
    slot: Ints
    entry_step: Ints
    route: Ints
    """Number of each seat's route, shape (B, A)."""
    route_done: Floats
    target_lane: Ints
    change_phase: Bytes
    effective: Bools
    alive: Bools
    kind: Bytes
    position: Floats
    heading: Floats
    speed: Floats
    length: Floats
    width: Floats
    lane: Ints
    lane_position: Floats
    lane_offset: Floats
    desired_speed: Floats
    left: Ints
    """Lane to the left in the same direction, numbered across all maps, -1 for none, shape (L,)."""
    right: Ints
    agility: Floats
    """How fast each `VehicleKind` can change its curvature, for its steering's rate [1/(m s)], shape (K,)."""

    @classmethod
    def of(cls, scene: Scene) -> LaneState:
        """Return the state of a scene."""
        world, vehicles, seats = scene.world, scene.world.vehicles, scene.world.seats
        left, right = neighbours(scene.atlas)
        return cls(
            map=world.map,
            step=world.step,
            slot=seats.slot,
            entry_step=seats.entry_step,
            route=scene.routes.number,
            route_done=seats.route_done,
            target_lane=seats.target_lane,
            change_phase=seats.change_phase,
            effective=seats.effective,
            alive=vehicles.alive,
            kind=vehicles.kind,
            position=vehicles.position,
            heading=vehicles.heading,
            speed=vehicles.speed,
            length=vehicles.length,
            width=vehicles.width,
            lane=vehicles.lane,
            lane_position=vehicles.lane_position,
            lane_offset=vehicles.lane_offset,
            desired_speed=vehicles.desired_speed,
            left=left,
            right=right,
            agility=agilities(),
        )


def neighbours(atlas: RoadAtlas) -> tuple[Ints, Ints]:
    """Return the lanes to the left and right of each lane of all maps, -1 where there is none, shape (L,)."""
    bases = atlas.roads.lane_base[:-1]
    found = []
    for name in ("left", "right"):
        beside = [getattr(graph, name) for graph in atlas.graphs]
        raised = [np.where(lanes < 0, -1, lanes + base) for lanes, base in zip(beside, bases, strict=True)]
        found.append(np.concatenate(raised).astype(np.int32))
    return found[0], found[1]


def agilities() -> Floats:
    """Return `LaneState.agility`."""
    known = vehicle_names()
    found = np.full(len(VehicleKind), np.inf)
    for kind in VehicleKind:
        if kind.name.lower() in known:
            parameters = vehicle(kind.name.lower())
            found[kind] = parameters.steering.rate / parameters.wheelbase
    return found
