"""Entries: how agents come into an episode."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from smarts.arrays import Bools
from smarts.errors import MapError
from smarts.geometry.boxes import boxes_overlap
from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.routes import shortest_route
from smarts.sim.clearing import vehicles_in_the_way
from smarts.sim.ownership import Ownership
from smarts.sim.starts import corridor_of, distance_along
from smarts.types.agent_states import AgentStatus
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.mission import GoalKind
from smarts.types.vehicles import Owner
from smarts.types.world import World


class Entries:
    """Puts agents into their agents, at the beginning of the episode or when their time has come.

    An agent's new vehicle is put into a cleared gap: traffic that would have to brake hard for it is taken
    out of the world. An agent that is to take over a vehicle waits until `HandoverRules` has found one; if
    its patience ends first, it gets a new vehicle.
    """

    def __init__(self, world: World, ownership: Ownership, routes: AgentRoutes) -> None:
        self.episodes: list[EpisodeStart | None] = [None] * len(routes.number)
        """What each simulation plays."""
        self.pending: set[int] = set()
        """Simulations in whose episode somebody enters later than at the beginning."""
        self._world, self._ownership = world, ownership
        self._routes = routes

    def starts(self, row: int) -> Sequence[AgentStart]:
        """Return how the agents of a simulation begin, in the order of their agents."""
        episode = self.episodes[row]
        return episode.agents if episode else ()

    def reset(self, row: int, start: EpisodeStart) -> None:
        """Assign an episode's missions in an empty simulation; let in the agents that enter at once."""
        world = self._world
        self.episodes[row] = start
        self.pending.discard(row)
        self._routes.assign(row, start.map, [agent_id.mission.route for agent_id in start.agents])
        roads = self._routes.atlas.graphs[start.map]
        for agent_id, agent_start in enumerate(start.agents):
            route = world.routes.number(row, map(roads.edge_number, agent_start.mission.route))
            world.missions.write(row, agent_id, agent_start.mission, route)
            world.agents.agent[row, agent_id] = agent_id
            world.agents.state[row, agent_id] = AgentStatus.WAITING
            if agent_start.entry_time <= 0 and not agent_start.take_over:
                self._ownership.admit(row, agent_id, agent_start)
            else:
                self.pending.add(row)

    def clear_way(self, row: int) -> None:
        """Clear traffic that blocks agents' spawns; requires map matching."""
        for slot in np.flatnonzero(self._world.vehicles.owner[row] == Owner.AGENT).tolist():
            self._clear_around(row, slot)

    def enter(self, env_mask: Bools) -> None:
        """Let in the agents whose time has come; give routes to those that have just taken over a vehicle."""
        world = self._world
        state = world.agents.state
        for row in sorted(row for row in self.pending if env_mask[row]):
            # This is the beginning of the step: its number is already that of its end.
            now = (int(world.step[row]) - 1) * world.dt
            for agent_id, start in enumerate(self.starts(row)):
                if state[row, agent_id] == AgentStatus.WAITING:
                    self._enter(row, agent_id, start, now)
                elif start.take_over and world.agents.entry_step[row, agent_id] == world.step[row]:
                    self._go_on(row, agent_id)

    def _enter(self, row: int, agent_id: int, start: AgentStart, now: float) -> None:
        world = self._world
        patience = start.take_over.patience if start.take_over else 0.0
        if now < start.entry_time + patience - 1e-9 or self._is_occupied(row, start):
            return
        slot = self._ownership.admit(row, agent_id, start)
        vehicles = world.vehicles
        found = self._routes.atlas.locate(
            world.map[[row]], vehicles.position[row, [slot]], vehicles.heading[row, [slot]]
        )
        vehicles.lane[row, slot], vehicles.lane_position[row, slot] = found.lane[0], found.s[0]
        self._clear_around(row, slot)

    def _is_occupied(self, row: int, start: AgentStart) -> bool:
        """Return whether another agent's vehicle is at the start, which only time can clear."""
        vehicles = self._world.vehicles.of(row)
        others = np.flatnonzero(vehicles.owner == Owner.AGENT)
        x, y, heading = start.pose
        return bool(
            boxes_overlap(
                np.array([[x, y]]),
                np.array([heading]),
                np.array([[start.length, start.width]]),
                vehicles.position[others],
                vehicles.heading[others],
                np.stack([vehicles.length[others], vehicles.width[others]], -1),
            ).any()
        )

    def _clear_around(self, row: int, slot: int) -> None:
        world = self._world
        vehicles, roads = world.vehicles.of(row), self._roads(row)
        lane = int(vehicles.lane[slot])
        edge = roads.lane_edge[lane] if lane >= 0 else -1
        is_inside_junction = lane >= 0 and bool(roads.is_internal[lane])

        def leads_here(other: int) -> bool:
            route = int(vehicles.route[other])
            return route < 0 or is_inside_junction or edge in world.routes.edges(row, route)

        for other in vehicles_in_the_way(roads, vehicles, slot, leads_here):
            world.registry.dismiss(row, other)

    def _go_on(self, row: int, agent_id: int) -> None:
        """Give an agent that has taken a vehicle over a route from where that is, if it is off its own."""
        world = self._world
        slot, lane = int(world.agents.slot[row, agent_id]), -1
        if slot >= 0 and world.missions.goal[row, agent_id] != GoalKind.ENDLESS:
            lane = int(world.vehicles.lane[row, slot])
        route, roads = self._routes.route(row, agent_id), self._roads(row)
        if lane < 0 or not route:
            return
        s, goal = float(world.vehicles.lane_position[row, slot]), int(world.missions.goal_lane[row, agent_id])
        if math.isnan(distance_along(corridor_of(roads, route), roads, lane, s)):
            try:
                route = shortest_route(roads, _edge_ahead(roads, lane), route[-1])
            except MapError:
                return  # No way leads from here to the goal, so the agent begins off its route.
            self._routes.assign_agent(row, agent_id, route)
            number = world.routes.number(row, map(roads.edge_number, route))
            world.missions.route[row, agent_id] = world.vehicles.route[row, slot] = number
            mission = dataclasses.replace(self.starts(row)[agent_id].mission, route=route)
            world.missions.write(row, agent_id, mission, number)
        corridor, goal_s = corridor_of(roads, route), float(world.missions.goal_s[row, agent_id])
        begin = distance_along(corridor, roads, lane, s)
        length = distance_along(corridor, roads, goal, goal_s, last=True) - (
            0.0 if math.isnan(begin) else begin
        )
        world.missions.route_length[row, agent_id] = max(0.0, length)

    def _roads(self, row: int) -> LaneGraph:
        return self._routes.atlas.graphs[self._world.map[row]]


def _edge_ahead(roads: LaneGraph, lane: int) -> str:
    """Return the id of the road edge that a lane belongs to or, inside a junction, leads into."""
    while roads.is_internal[lane]:
        lane = int(roads.successors(lane)[0])
    return roads.edge_ids[roads.lane_edge[lane]]
