"""The paper's benchmark: what an agent sees, does and is paid for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Discrete, Space
from numpy.typing import NDArray

from smarts.agents.criteria import DoneCriteria, EventConfiguration
from smarts.agents.interface import AgentInterface
from smarts.env.adapters.actions import encode_array
from smarts.env.adapters.features import FEATURES, write_arrival_order, write_features, write_stack
from smarts.env.adapters.protocol import MASK, Served
from smarts.env.adapters.reward import Rewards, RewardWeights
from smarts.errors import SmartsError
from smarts.types.actions import Actions, ActionSpaceType, LaneAction
from smarts.types.frame import Frame
from smarts.types.interface import Field

Bools = NDArray[np.bool_]

FRAMES = 3
"""Instants in an observation, one for each decision."""


MAX_STEPS = 1000
"""Time limit of the benchmark's agents [steps of 0.1 s]."""
REST = 20.0
"""How long they may stand [s]."""


def benchmark_interface(**changes: Any) -> AgentInterface:
    """Return the interface of the benchmark's agents, with some fields changed."""
    interface = AgentInterface(
        action=ActionSpaceType.Lane,
        max_episode_steps=MAX_STEPS,
        done_criteria=DoneCriteria(not_moving=True),
        event_configuration=EventConfiguration(not_moving_time=REST),
        accelerometer=False,
        lane_positions=False,
    )
    return interface.replace(**changes)


class BenchmarkAdapter:
    """Observations of 200 numbers (with four agents), four lane actions of which some are masked.

    The vector holds the features of three decisions, oldest first (`smarts.env.adapters.features` says which
    they are; at first, three times those of the first one), then which of the agents one is, then how many
    came to the junction before.

    Args:
        served: The agents.
        interface: Theirs.
        reward: Name of the weights in `rewards.yaml`, or the weights themselves.
    """

    action: ClassVar[ActionSpaceType | None] = ActionSpaceType.Lane

    def __init__(
        self,
        served: Served,
        interface: AgentInterface,
        *,
        reward: str | RewardWeights = "benchmark",
    ) -> None:
        if served.action != self.action:
            raise SmartsError(
                f"the benchmark's agents act by {ActionSpaceType.Lane.name}, not by {served.action.name}",
                place=", ".join(served.agents),
                remedy="set `action` of their AgentInterface to ActionSpaceType.Lane, or use adapter 'raw'",
            )
        worlds, agents = served.scene.world.worlds, len(served.agents)
        size = FRAMES * FEATURES + agents + 1
        self.fields = (
            Field("observation", (size,), np.float32, -1.0, 1.0, "", "features of three decisions"),
            Field(MASK, (len(LaneAction),), np.int8, 0, 1, "", "which lane actions are legal"),
        )
        self.action_space: Space = Discrete(len(LaneAction))
        self._served = served
        self._features = np.zeros((worlds, agents, FEATURES), np.float32)
        self._observations = {field.name: field.allocate(worlds, agents) for field in self.fields}
        self._is_new = np.ones((worlds, agents), np.bool_)
        self._rewards = Rewards(served, reward)

    @property
    def observations(self) -> Mapping[str, NDArray]:
        """Array of each field, shape (B, G, *shape)."""
        return self._observations

    @property
    def rewards(self) -> NDArray[np.float32]:
        """Of the decision, shape (B, G)."""
        return self._rewards.values

    def encode(self, given: NDArray, chosen: Bools, out: Actions) -> None:
        """Take in lane actions 0 to 3, shape (B, G)."""
        encode_array(self._served, given, chosen, out)
        self._rewards.values[:] = 0.0

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Count a step towards the reward, and look around if a decision ends with it."""
        here = self._served.present(frame)
        settle = here if is_last else self._served.ended(frame)
        self._rewards.add(frame, here, settle)
        if settle.any():
            self._look(frame, settle)

    def reset(self, egos: Bools) -> None:
        """Forget what is remembered of these egos, shape (B, N)."""
        agents = egos[:, self._served.seats]
        self._rewards.reset(agents)
        self._is_new[agents] = True
        for array in self._observations.values():
            array[agents] = 0

    def _look(self, frame: Frame, chosen: Bools) -> None:
        world, served = frame.world, self._served
        seats, vehicles, missions = world.seats, world.vehicles, world.missions
        write_features(
            served.scene.atlas.roads,
            served.scene.routes.table,
            world.map,
            served.scene.routes.number,
            served.seats,
            chosen,
            seats.slot,
            seats.target_lane,
            seats.route_done,
            seats.steering,
            missions.goal,
            missions.goal_position,
            vehicles.alive,
            vehicles.position,
            vehicles.heading,
            vehicles.speed,
            vehicles.lateral_speed,
            vehicles.lane,
            vehicles.lane_position,
            vehicles.lane_offset,
            self._features,
        )
        vectors = self._observations["observation"]
        write_stack(self._features, chosen, self._is_new, FRAMES, vectors)
        write_arrival_order(served.seats, chosen, seats.state, seats.ticket, seats.ticket_junction, vectors)
        rows, agents = np.nonzero(chosen)
        vectors[rows, agents, FRAMES * FEATURES + agents] = 1.0
        self._observations[MASK][rows, agents] = seats.legal[rows, served.seats[agents]]
