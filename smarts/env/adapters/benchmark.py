"""The paper's benchmark: what an agent sees, does and is paid for."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.agents.checks import check_truth
from smarts.agents.criteria import DoneCriteria, EventConfiguration
from smarts.agents.interface import AgentInterface
from smarts.env.adapters.features import (
    FEATURES,
    Driving,
    EgoColumns,
    Missions,
    write_features,
    write_stack,
)
from smarts.env.adapters.own_reward import Reward, make_rewards
from smarts.env.adapters.picture import Pictures
from smarts.env.adapters.protocol import MASK, AdapterContext
from smarts.env.adapters.situation import (
    SITUATION,
    write_arrival_order,
    write_identity,
    write_mask,
    write_situation,
)
from smarts.geometry.binding import bind
from smarts.sim.columns import columns_of
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.frame import Frame
from smarts.types.interface import Field

Bools = NDArray[np.bool_]

FRAMES = 3
"""Instants in an observation, one for each decision."""
MAX_STEPS = 1000
"""Time limit of the benchmark's agents [steps of 0.1 s]."""
REST = 20.0
"""How long they may stand [s]."""
_MASK = Field(MASK, (len(LaneAction),), np.int8, 0, 1, "", "which lane actions are legal")


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
    """Observations of 203 numbers (with four agents), four lane actions of which some are masked.

    Agents that act by another type have that type's action space and no mask.

    The vector holds the features of three decisions, oldest first (`smarts.env.adapters.features` says which
    they are; at first, three times those of the first one), then which of the agents one is. Then, not in the
    paper, the light of its lane, how long it has stood and which lane changes are due: without them an agent
    cannot know what ends its episode. At last, how many came to the junction before. The picture, if wanted,
    shows the same three decisions from above. The last observation of an agent that ends within a decision is
    of that step, so nearer to the one before it.

    Args:
        served: The agents.
        interface: Theirs.
        reward: Name of the weights in `rewards.yaml`, or the weights themselves, also as a dict; or an own
            reward (`smarts.env.adapters.own_reward`), or `module:Class` of it.
        discount: By which the learner discounts a decision, if not as in the weights.
        image: Whether there is a grey picture from above, "image", beside the vector "observation".
        image_size: Its rows and columns.
        image_resolution: Side of its pixels [m].

    Raises:
        SmartsError: The picture is not possible, or `image` is not a truth value.
    """

    sensors: ClassVar[Collection[str] | None] = ()

    def __init__(
        self,
        served: AdapterContext,
        interface: AgentInterface,
        *,
        reward: Reward = "benchmark",
        discount: float | None = None,
        image: bool = False,
        image_size: int = 64,
        image_resolution: float = 1.0,
    ) -> None:
        check_truth("image", image, "the adapter's options")
        world, agents = served.scene.world, len(served.agents)
        size = FRAMES * FEATURES + agents + SITUATION
        self._pictures = Pictures(served, image_size, image_resolution, FRAMES) if image else None
        self.fields = (
            Field("observation", (size,), np.float32, -1.0, 1.0, "", "features of three decisions"),
            *([self._pictures.field] if self._pictures else []),
            *([_MASK] if served.action == ActionSpaceType.Lane else []),
        )
        self.observations = {field.name: field.allocate(world.worlds, agents) for field in self.fields}
        self._served = served
        self._features = np.zeros((world.worlds, agents, FEATURES), np.float32)
        self._is_new = np.ones((world.worlds, agents), np.bool_)
        each = served.interfaces or (interface,) * agents
        self._patience = np.array([_patience(one, world.dt) for one in each])
        self._rewards = make_rewards(served, reward, discount)
        self.rewards = self._rewards.values
        self._bind()

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Count a step towards the reward, and look around if a decision ends with it."""
        settle = self._rewards.collect(frame, is_last)
        if np.count_nonzero(settle):
            self._look(frame, settle)

    def reset(self, egos: Bools) -> None:
        """Forget what is remembered of these egos, shape (B, N)."""
        agents = egos[:, self._served.agent_ids]
        self._rewards.reset(egos)
        self._is_new[agents] = True
        for array in self.observations.values():
            array[agents] = 0

    def _look(self, frame: Frame, chosen: Bools) -> None:
        self._write_features(chosen)
        if self._pictures:
            self._pictures.write(frame, chosen, self._is_new, self.observations["image"])
        self._write_stack(chosen)
        self._write_situation(chosen)
        self._write_arrival_order(chosen)
        self._write_identity(chosen)
        if self._write_mask is not None:
            self._write_mask(chosen)

    def _bind(self) -> None:
        """Hand the kernels what stays the same."""
        scene, agent_ids = self._served.scene, self._served.agent_ids
        world, agents, vectors = scene.world, scene.world.agents, self.observations["observation"]
        columns = (
            columns_of(agents, EgoColumns),
            columns_of(world.missions, Missions),
            columns_of(world.vehicles, Driving),
        )
        roads = scene.atlas.roads, scene.routes.current, world.map, scene.routes.number
        self._write_features = bind(write_features, *roads, agent_ids, *columns, self._features)
        self._write_stack = bind(write_stack, self._features, self._is_new, FRAMES, vectors)
        situation = columns[0], columns[2], world.signals, world.step, self._patience, vectors
        self._write_situation = bind(write_situation, *roads, agent_ids, *situation)
        arrival_order = agents.state, agents.arrival_number, agents.arrival_junction
        self._write_arrival_order = bind(write_arrival_order, agent_ids, *arrival_order, vectors)
        self._write_identity = bind(write_identity, FRAMES * FEATURES, vectors)
        mask = self.observations.get(MASK)
        self._write_mask = None if mask is None else bind(write_mask, agent_ids, agents.action_mask, mask)


def _patience(interface: AgentInterface, dt: float) -> float:
    """Return how many steps an agent may stand, infinite if for ever."""
    if not interface.done_criteria.not_moving:
        return np.inf
    return max(1.0, interface.event_configuration.not_moving_time / dt)
