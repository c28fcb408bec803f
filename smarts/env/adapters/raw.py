"""The readings of an agent's sensors as they are."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.env.adapters.own_reward import Reward, make_rewards
from smarts.env.adapters.protocol import MASK, AdapterContext
from smarts.sensors.suite import sensors_of
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.frame import Frame, Readings
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]


class RawAdapter:
    """Every sensor's fields are observations, named "sensor/field"; the reward is metres of the route.

    Args:
        served: The agents.
        interface: Theirs; they have the same sensors with the same options.
        reward: Name of the weights in `rewards.yaml`, or the weights themselves, also as a dict; or an own
            reward (`smarts.env.adapters.own_reward`), or `module:Class` of it.
        discount: By which the learner discounts a decision, if not as in the weights.
    """

    sensors: ClassVar[Collection[str] | None] = None

    def __init__(
        self,
        served: AdapterContext,
        interface: AgentInterface,
        *,
        reward: Reward = "route_metres",
        discount: float | None = None,
    ) -> None:
        self._served = served
        self._rewards = make_rewards(served, reward, discount)
        self.rewards = self._rewards.values
        fields = {
            (sensor, field.name): replace(field, name=f"{sensor}/{field.name}")
            for sensor, made in sensors_of(interface).items()
            for field in made.fields()
        }
        worlds, agents = served.scene.world.worlds, len(served.agents)
        self._arrays = {place: field.allocate(worlds, agents) for place, field in fields.items()}
        self.observations = {fields[place].name: array for place, array in self._arrays.items()}
        self.fields = tuple(fields.values())
        if served.action == ActionSpaceType.Lane:
            mask = Field(MASK, (len(LaneAction),), np.int8, 0, 1, "", "which lane actions are legal")
            self.fields = (*self.fields, mask)
            self.observations[MASK] = mask.allocate(worlds, agents)
        self._blocks: dict[str, tuple[str, Ints]] = {}

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Count a step towards the reward, and copy the readings if a decision ends with it."""
        settle = self._rewards.collect(frame, is_last)
        if np.count_nonzero(settle):
            self._copy(frame, settle)

    def reset(self, egos: Bools) -> None:
        """Forget what is remembered of these egos, shape (B, N)."""
        agents = egos[:, self._served.agent_ids]
        self._rewards.reset(egos)
        for array in self.observations.values():
            array[agents] = 0

    def _copy(self, frame: Frame, chosen: Bools) -> None:
        rows, agents = np.nonzero(chosen)
        for (sensor, field), array in self._arrays.items():
            name, columns = self._block(frame.readings, sensor)
            array[rows, agents] = frame.readings.blocks[name][field][rows, columns[agents]]
        if MASK in self.observations:
            action_mask = frame.world.agents.action_mask
            self.observations[MASK][rows, agents] = action_mask[rows, self._served.agent_ids[agents]]

    def _block(self, readings: Readings, sensor: str) -> tuple[str, Ints]:
        """Return the readings' block of a sensor of these agents, and their columns in it."""
        if sensor not in self._blocks:
            for name, agents in readings.agent_ids.items():
                if name.partition(":")[0] == sensor and self._served.agent_ids[0] in agents:
                    columns = [
                        agents.tolist().index(agent_id) for agent_id in self._served.agent_ids.tolist()
                    ]
                    self._blocks[sensor] = (name, np.array(columns, np.int32))
        return self._blocks[sensor]
