"""What lane following reads and writes of the world, gathered once, and the lanes beside each lane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.controllers.model_predictive import sharpest_curvatures
from smarts.dynamics import vehicle, vehicle_names
from smarts.roads.atlas import RoadAtlas
from smarts.roads.scene import Scene
from smarts.types.vehicles import VehicleKind

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]


class Abilities(NamedTuple):
    """What each `VehicleKind` can drive, shape (K,) each."""

    agility: Floats
    """How fast it can change its curvature, for its steering's rate [1/(m s)]."""
    wheelbase: Floats
    """[m]"""
    centre_to_rear: Floats
    """From the footprint's centre back to the rear axle [m]."""
    sharpest: Floats
    """The largest curvature of the rear axle's path [1/m]."""

    @classmethod
    def of_all(cls) -> Abilities:
        """Return those of all kinds; what cannot drive has no bounds."""
        known, kinds = vehicle_names(), len(VehicleKind)
        agility, wheelbase, centre_to_rear = np.full(kinds, np.inf), np.ones(kinds), np.zeros(kinds)
        for kind in VehicleKind:
            if kind.name.lower() in known:
                one = vehicle(kind.name.lower())
                agility[kind] = one.steering.rate / one.wheelbase
                wheelbase[kind] = one.wheelbase
                centre_to_rear[kind] = one.cog_to_rear_axle - one.centre_to_cog
        return cls(agility, wheelbase, centre_to_rear, sharpest_curvatures())


class LaneState(NamedTuple):
    """Arrays of the world as they stand there, for kernels; what is in them changes in place."""

    map: Ints
    step: Ints
    slot: Ints
    entry_step: Ints
    route: Ints
    """Number of each agent's route, shape (B, A)."""
    route_progress: Floats
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
    steering: Floats
    """Angle of each agent's front wheels [rad], shape (B, A)."""
    abilities: Abilities

    @classmethod
    def of(cls, scene: Scene) -> LaneState:
        """Return the state of a scene."""
        world, vehicles, agents = scene.world, scene.world.vehicles, scene.world.agents
        left, right = neighbours(scene.atlas)
        return cls(
            map=world.map,
            step=world.step,
            slot=agents.slot,
            entry_step=agents.entry_step,
            route=scene.routes.number,
            route_progress=agents.route_progress,
            target_lane=agents.target_lane,
            change_phase=agents.change_phase,
            effective=agents.effective,
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
            steering=agents.steering,
            abilities=Abilities.of_all(),
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
