"""Conditions of bubbles: the facts about a simulation and its vehicles, and what conditions remember."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np

from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio.sstypes.condition import ConditionRequires
from smarts.types.agent_states import UNSET
from smarts.types.condition_state import ConditionState, SceneCondition
from smarts.types.vehicles import VehicleKind
from smarts.types.world import World

_NAMES = ConditionRequires.actor_ids
_STATE = ConditionRequires.current_actor_state
_STATUS = ConditionRequires.current_actor_road_status


@dataclass(frozen=True)
class ActorState:
    """The vehicle that a condition is about."""

    actor_id: str
    """Its name."""
    vehicle_config_type: str
    """Its type, such as "passenger"."""
    speed: float
    """[m/s]"""
    position: tuple[float, float]
    """Its centre [m]."""
    heading: float
    """[rad]"""


@dataclass(frozen=True)
class RoadStatus:
    """The vehicle's place on the road."""

    road: str | None
    """Id of the edge that its centre is on, None beside all lanes."""
    off_road: bool
    """Whether its centre is beside all lanes."""


class ConditionRunner:
    """Evaluates the conditions of bubbles with the facts that they need.

    Triggers keep their clocks by bubble, or by bubble and vehicle, for one episode.

    Args:
        world: The state; read.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._memory = [defaultdict[Any, dict[Any, float]](dict) for _ in range(world.worlds)]
        self._names: list[tuple[int, frozenset[str]]] = [(UNSET, frozenset())] * world.worlds
        """The names of each simulation's vehicles, and the step that they are of."""

    def clear(self, row: int) -> None:
        """Forget the episode of one simulation."""
        self._memory[row].clear()
        self._names[row] = UNSET, frozenset()

    def is_active(self, row: int, bubble: int, condition: SceneCondition) -> bool:
        """Return whether a bubble's `active_condition` holds; call it in every step, for its clocks."""
        facts = self._facts(row, condition)
        return bool(condition.evaluate(memory=self._memory[row][bubble], **facts))

    def admits(
        self, row: int, bubble: int, slot: int, condition: SceneCondition, roads: LaneGraph
    ) -> ConditionState:
        """Return what a bubble's `airlock_condition` says of a vehicle."""
        facts, requires = self._facts(row, condition), condition.requires
        if requires & _STATE:
            facts["current_actor_state"] = self._state(row, slot)
        if requires & _STATUS:
            facts["current_actor_road_status"] = self._status(row, slot, roads)
        key = bubble, slot, int(self._world.vehicles.generation[row, slot])
        return condition.evaluate(memory=self._memory[row][key], **facts)

    def _facts(self, row: int, condition: SceneCondition) -> dict[str, Any]:
        """Return the facts about a simulation that a condition needs."""
        world = self._world
        facts: dict[str, Any] = {"time": float(world.step[row]) * world.dt}
        if condition.requires & _NAMES:
            facts["actor_ids"] = self._names_at(row, int(world.step[row]))
        return facts

    def _names_at(self, row: int, step: int) -> frozenset[str]:
        """Return the names of the vehicles in a simulation, which are read once a step."""
        if self._names[row][0] != step:
            slots = np.flatnonzero(self._world.vehicles.alive[row]).tolist()
            self._names[row] = step, frozenset(self._world.registry.name(row, slot) for slot in slots)
        return self._names[row][1]

    def _state(self, row: int, slot: int) -> ActorState:
        world = self._world
        vehicles = world.vehicles
        return ActorState(
            actor_id=world.registry.name(row, slot),
            vehicle_config_type=VehicleKind(int(vehicles.kind[row, slot])).name.lower(),
            speed=float(vehicles.speed[row, slot]),
            position=tuple(vehicles.position[row, slot].tolist()),
            heading=float(vehicles.heading[row, slot]),
        )

    def _status(self, row: int, slot: int, roads: LaneGraph) -> RoadStatus:
        vehicles = self._world.vehicles
        lane = int(vehicles.lane[row, slot])
        half = float(roads.width[lane]) / 2 if lane >= 0 else 0.0
        if lane < 0 or abs(float(vehicles.lane_offset[row, slot])) > half:
            return RoadStatus(None, off_road=True)
        return RoadStatus(roads.edge_ids[roads.lane_edge[lane]], off_road=False)
