"""All sensors of all agents: one call of each sensor serves every agent that has it with the same options."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.roads.scene import Scene
from smarts.sensors import SENSORS
from smarts.sensors.protocol import Sensor
from smarts.types.frame import Readings

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]

EVERYBODY_HAS = ("ego_vehicle_state", "mission", "via_data")
"""The sensors that are always on."""


def sensors_of(interface: AgentInterface, wanted: Collection[str] | None = None) -> dict[str, Sensor]:
    """Return the sensors of an agent by name, made from the options of its interface.

    Args:
        interface: Of the agent.
        wanted: Names of those that somebody looks at, None for all.
    """
    options = interface.sensors
    return {
        name: SENSORS[name](options[name]) if name in options else SENSORS[name]()
        for name in SENSORS
        if (name in options or name in EVERYBODY_HAS) and (wanted is None or name in wanted)
    }


@dataclass(frozen=True)
class _Group:
    """AgentStates whose sensors are equal, with the arrays that they share."""

    name: str
    """In `Readings`."""
    sensor: Sensor
    agent_ids: Ints
    wanted: Bools
    """Buffer that groups of the same agents share, shape (B, G)."""
    block: Mapping[str, NDArray]


class SensorSuite:
    """Observes the agents that are wanted; an implementation of `smarts.sim.stages.Sensors`.

    In the readings, the block of a sensor has its name; where agents have the same sensor with other options,
    the second group has its name and ":2", and so on. Groups are in the order of their first agents.

    Args:
        scene: What is to be observed.
        interfaces: Of the agent in each agent, None for an agent without sensors, shape (A,).
        looked_at: Names of the sensors that somebody looks at, by agent; all of those that are not in it.
    """

    def __init__(
        self,
        scene: Scene,
        interfaces: Sequence[AgentInterface | None],
        looked_at: Mapping[int, Collection[str]] | None = None,
    ) -> None:
        self._scene = scene
        self._groups = _groups(interfaces, looked_at or {}, scene.world.worlds)
        buffers = {id(group.wanted): (group.agent_ids, group.wanted) for group in self._groups}
        self._wanted = tuple(buffers.values())
        self._readings = Readings(
            {group.name: group.block for group in self._groups},
            {group.name: group.agent_ids for group in self._groups},
        )
        self._places = {
            (group.name.partition(":")[0], int(agent_id)): (group.name, column)
            for group in self._groups
            for column, agent_id in enumerate(group.agent_ids)
        }

    def observe(self, observe_mask: Bools) -> Readings:
        """Return the readings of the wanted agents, shape (B, A)."""
        for agents, buffer in self._wanted:
            np.take(observe_mask, agents, axis=1, out=buffer)
        if np.count_nonzero(observe_mask):
            for group in self._groups:
                group.sensor.observe(self._scene, group.agent_ids, group.wanted, group.block)
        return self._readings

    def place(self, sensor: str, agent_id: int) -> tuple[str, int] | None:
        """Return the block and the column in it of an agent's sensor, None if the agent does not have it."""
        return self._places.get((sensor, agent_id))


def _groups(
    interfaces: Sequence[AgentInterface | None], looked_at: Mapping[int, Collection[str]], worlds: int
) -> list[_Group]:
    """Return the groups, those of one sensor after each other, in the order of the registry."""
    agents: dict[str, dict[Sensor, list[int]]] = {name: {} for name in SENSORS}
    for agent_id, interface in enumerate(interfaces):
        made = sensors_of(interface, looked_at.get(agent_id)) if interface else {}
        for name, sensor in made.items():
            agents[name].setdefault(sensor, []).append(agent_id)
    members_of = {tuple(members) for groups in agents.values() for members in groups.values()}
    wanted = {members: np.zeros((worlds, len(members)), np.bool_) for members in members_of}
    return [
        _Group(
            name=name if number == 1 else f"{name}:{number}",
            sensor=sensor,
            agent_ids=np.array(members, np.int32),
            wanted=wanted[tuple(members)],
            block={field.name: field.allocate(worlds, len(members)) for field in sensor.fields()},
        )
        for name, groups in agents.items()
        for number, (sensor, members) in enumerate(groups.items(), start=1)
    ]
