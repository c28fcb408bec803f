"""All sensors of all agents: one call of each sensor serves every agent that has it with the same options."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.agents.sensors import ALWAYS_ON, SENSORS
from smarts.arrays import Bools, Ints
from smarts.roads.scene import Scene
from smarts.sensors.protocol import Sensor
from smarts.types.frame import Readings
from smarts.types.interface import Field


def sensors_of(interface: AgentInterface, names: Collection[str] | None = None) -> dict[str, Sensor]:
    """Return the sensors of an agent by name, made from the options of its interface.

    Args:
        interface: Of the agent.
        names: Of the sensors that are read, None for all.
    """
    options = dict.fromkeys(ALWAYS_ON, True) | interface.sensors
    return {
        name: _made(name, options[name])
        for name in SENSORS
        if name in options and (names is None or name in names)
    }


def _made(name: str, option: Any) -> Sensor:
    """Return the sensor for an option: True, the sensor itself, or what the class takes."""
    if option is True:
        return SENSORS[name]()
    return option if hasattr(option, "bind") else SENSORS[name](option)


class ReadingsBlock(Mapping[str, NDArray]):
    """The arrays of a sensor's fields, in one piece of memory, so that they are copied at once.

    Args:
        fields: Of the sensor.
        shape: Of simulations and agents.
    """

    def __init__(self, fields: Sequence[Field], shape: tuple[int, int]) -> None:
        sizes = [int(np.prod((*shape, *field.shape))) * np.dtype(field.dtype).itemsize for field in fields]
        # Each array begins on a cache line of its own.
        begins = [*accumulate((-(-size // 64) * 64 for size in sizes), initial=0)]
        self._memory = np.zeros(begins[-1], np.uint8)
        self._layout = {
            field.name: ((*shape, *field.shape), field.dtype, begin)
            for field, begin in zip(fields, begins, strict=False)
        }
        self._arrays: dict[str, NDArray] = {}

    def copy(self) -> ReadingsBlock:
        """Return a copy."""
        made = ReadingsBlock.__new__(ReadingsBlock)
        made._memory, made._layout, made._arrays = self._memory.copy(), self._layout, {}
        return made

    def __getitem__(self, name: str) -> NDArray:
        """Return a field's array, made when it is first asked for."""
        if name not in self._arrays:
            shape, dtype, begin = self._layout[name]
            self._arrays[name] = np.ndarray(shape, dtype, self._memory, begin)
        return self._arrays[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._layout)

    def __len__(self) -> int:
        return len(self._layout)


@dataclass(frozen=True)
class _Group:
    """Agents whose sensors are equal, with the arrays that they share."""

    name: str
    """In `Readings`."""
    agent_ids: Ints
    observe_mask: Bools
    """Buffer that groups of the same agents share, shape (B, G)."""
    block: ReadingsBlock
    observe: Callable[[Bools], object]


class SensorSuite:
    """Observes agents; the stage of sensors of `smarts.sim.simulation.Stages`.

    In the readings, the block of a sensor has its name; where agents have the same sensor with other options,
    the second group has its name and ":2", and so on. Groups are in the order of their first agents. Egos
    share no group with other agents, so that their arrays are the same without these.

    Args:
        scene: What is to be observed.
        interfaces: Of each agent, None for an agent without sensors, shape (A,).
        looked_at: Names of the sensors that are read, by agent; all of the agents that are not in it.
    """

    def __init__(
        self,
        scene: Scene,
        interfaces: Sequence[AgentInterface | None],
        looked_at: Mapping[int, Collection[str]] | None = None,
    ) -> None:
        self._groups = _groups(scene, interfaces, looked_at or {})
        masks = {id(group.observe_mask): (group.agent_ids, group.observe_mask) for group in self._groups}
        self._masks = tuple(masks.values())
        self.readings = Readings(
            {group.name: group.block for group in self._groups},
            {group.name: group.agent_ids for group in self._groups},
        )

    def observe(self, observe_mask: Bools) -> Readings:
        """Return the readings of the agents in the mask, shape (B, A)."""
        observed = set()
        for agent_ids, mask in self._masks:
            np.take(observe_mask, agent_ids, axis=1, out=mask)
            if np.count_nonzero(mask):
                observed.add(id(mask))
        for group in self._groups:
            if id(group.observe_mask) in observed:
                group.observe(group.observe_mask)
        return self.readings


def _groups(
    scene: Scene, interfaces: Sequence[AgentInterface | None], looked_at: Mapping[int, Collection[str]]
) -> list[_Group]:
    """Return the groups, in the order of the registry."""
    worlds = scene.world.worlds
    masks: dict[tuple[int, ...], Bools] = {}
    groups = []
    for name, by_sensor in _members(interfaces, looked_at, scene.world.egos).items():
        for number, ((_, sensor), members) in enumerate(by_sensor.items(), start=1):
            mask = masks.setdefault(tuple(members), np.zeros((worlds, len(members)), np.bool_))
            agent_ids = np.array(members, np.int32)
            block = ReadingsBlock(sensor.fields(), (worlds, len(members)))
            groups.append(
                _Group(
                    name if number == 1 else f"{name}:{number}",
                    agent_ids,
                    mask,
                    block,
                    sensor.bind(scene, agent_ids, block),
                )
            )
    return groups


def _members(
    interfaces: Sequence[AgentInterface | None], looked_at: Mapping[int, Collection[str]], egos: int
) -> dict[str, dict[tuple[bool, Sensor], list[int]]]:
    """Return the agents with a sensor, by its name, whether they are egos, and its options."""
    members: dict[str, dict[tuple[bool, Sensor], list[int]]] = {name: {} for name in SENSORS}
    for agent_id, interface in enumerate(interfaces):
        made = sensors_of(interface, looked_at.get(agent_id)) if interface else {}
        for name, sensor in made.items():
            members[name].setdefault((agent_id < egos, sensor), []).append(agent_id)
    return members
