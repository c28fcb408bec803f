"""Agents of all vehicles of a traffic, in one simulation: they observe them, or drive them, too.

Axis letters: A agents, N agents that decide.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from shapely import box

from smarts.agents.benchmark import benchmark_interface
from smarts.agents.criteria import DoneCriteria
from smarts.agents.pooled import PooledAgents
from smarts.arrays import Bools, Ints
from smarts.controllers import action_format
from smarts.env.actions import Parsed
from smarts.env.groups import context_of
from smarts.errors import SmartsError
from smarts.geometry.rings import rings_of
from smarts.observations.arrays import ArrayObservation
from smarts.observations.lists import Observed, feature_list
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.assembly import assemble
from smarts.sim.schedule import vehicle_limit
from smarts.sstudio.built import BuiltScenario
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.bubbles import PlacedBubble
from smarts.types.episode import EpisodeStart
from smarts.types.vehicles import VehicleStates

FAR = 1e4
"""Beyond the map's ends [m]."""


class Decision(NamedTuple):
    """What the agents that decide now see."""

    hold: NDArray[np.int64]
    """Number of each agent's time with its vehicle, shape (N,), as the others."""
    agent_id: Ints
    slot: Ints
    observations: Mapping[str, NDArray]
    """By field, shape (N, ...)."""
    action_mask: Bools
    """Lane actions that are allowed, shape (N, 4)."""


class TrafficAgents:
    """One simulation of a scenario's traffic, with an agent for each of its vehicles.

    A bubble as wide as the map has the agents observe the vehicles, and drive them if they are to, as in any
    bubble (`docs/guide/bubbles.md`). There are no learning agents; the scenario's own bubbles rest.

    Args:
        built: The scenario.
        traffic: Variation of its traffic.
        observation: What the agents observe.
        action: How they act.
        decision_interval: Steps from one decision to the next.
        drives: Whether they drive.
        seed: Seed of the run.

    Raises:
        SmartsError: The scenario has no such traffic, or the observation depends on the number of agents.
    """

    def __init__(
        self,
        built: BuiltScenario,
        traffic: str,
        observation: Observed,
        action: ActionSpaceType,
        *,
        decision_interval: int = 5,
        drives: bool = False,
        seed: int = 42,
    ) -> None:
        built.traffic_files(traffic)
        observed, self.interval = feature_list(observation), decision_interval
        for each in (*observed.stacked, *observed.features):
            if each.kind().size_for(1) != each.kind().size_for(2):
                raise SmartsError(
                    f"the feature {each.name!r} depends on the number of agents",
                    place="observation",
                    remedy="give a list of features without it",
                )
        interface = benchmark_interface(action=action, vehicle_model="kinematic")
        if drives:  # nothing ends an agent but its vehicle's way
            never = DoneCriteria(collision=False, off_road=False, off_route=False)
            interface = interface.replace(done_criteria=never, max_episode_steps=None)
        played = built.with_traffic([traffic])
        count = vehicle_limit(played)
        pool = [PooledAgents(interface, count)]
        self._parts = assemble([played], [], pool=pool, seed=seed)
        self.world, self.actions = self._parts.scene.world, self._parts.actions
        names = {str(number): interface for number in range(count)}
        context = context_of(self._parts.scene, names, 0, decision_interval)
        self._array = ArrayObservation(context, observed)
        self._format = action_format(action)
        self._bubbles = (_bubble(played, drives=drives),)
        shape = self.world.agents.slot.shape
        self._seen, self._all = np.zeros(shape, np.int64), np.ones(1, np.bool_)
        self._everyone = np.ones(shape, np.bool_)

    @property
    def vehicles(self) -> VehicleStates:
        """All vehicles now."""
        return self.world.vehicles.of(0)

    def name(self, slot: int) -> str:
        """Return a vehicle's name."""
        return self.world.registry.name(0, slot)

    @property
    def roads(self) -> LaneGraph:
        """The map."""
        return self._parts.scene.atlas.graphs[0]

    def reset(self, episode: int = 0, *, begin: float | None = None) -> EpisodeStart:
        """Begin an episode, and return what it is.

        Args:
            episode: Its number.
            begin: Where in a recording it begins [s]; by default as the scenario says.

        Raises:
            TrafficError: The traffic engine refused.
        """
        start = self._parts.schedule.start(0, episode)
        self._seen[:] = 0
        self.actions.given[:] = False
        files = start.traffic
        if begin is not None and files.recording is not None:
            files = replace(files, recording=replace(files.recording, begin=begin))
        start = replace(start, bubbles=self._bubbles, room=None, traffic=files)
        self._parts.simulation.reset({0: start})
        return start

    def decide(self) -> Decision:
        """Observe all vehicles that have an agent; to be called at each decision, and only then."""
        agents, serial = self.world.agents, self._parts.pool.serial
        is_there = (agents.state == AgentStatus.SHADOWING) | (agents.state == AgentStatus.ACTIVE)
        self._array.reset(is_there & (self._seen != serial))
        self._seen[is_there] = serial[is_there]
        arrays = self._array.observe(is_there)
        (columns,) = np.nonzero(is_there[0])
        return Decision(
            serial[0, columns],
            columns.astype(np.int32),
            agents.slot[0, columns],
            {name: array[0, columns] for name, array in arrays.items()},
            agents.action_mask[0, columns],
        )

    def step(self, decision: Decision | None = None, actions: NDArray | None = None) -> None:
        """Step until the next decision.

        Args:
            decision: The last one.
            actions: Its agents' actions, shape (N, ...), where they drive.

        Raises:
            TrafficError: The traffic failed.
        """
        if decision is not None and actions is not None:
            places = np.zeros_like(decision.agent_id), decision.agent_id
            numbers: Any = self._format.parse_batch(actions)
            Parsed(self._format, numbers, places).write(self.actions, self.world.agents.action_mask)
        for _ in range(self.interval):
            frame = self._parts.simulation.step(self.actions, self._all, self._everyone)
            self.actions.fresh[:] = False
            for failure in frame.failures.values():
                raise failure

    def close(self) -> None:
        """Free the simulation."""
        self._parts.simulation.close()


def _bubble(built: BuiltScenario, *, drives: bool) -> PlacedBubble:
    """Return a bubble as wide as the map; its zone is beyond the map where agents only observe."""
    points = built.roads().point_xy
    low, high = points.min(axis=0) - FAR, points.max(axis=0) + FAR
    everywhere = box(*low, *high)
    zone = everywhere if drives else box(*(high + FAR), *(high + FAR + 1))
    margin = everywhere if drives else everywhere.union(zone)
    return PlacedBubble("traffic", "driver", UNSET, 0, rings_of(zone), rings_of(margin))
