"""Entries: how agents enter an episode."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from smarts.arrays import Bools
from smarts.errors import MapError
from smarts.geometry.boxes import boxes_overlap
from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.lane_graph import HEIGHT_REACH, LaneGraph
from smarts.roads.routes import shortest_route
from smarts.sim.agent_pool import AgentPool
from smarts.sim.clearing import vehicles_in_the_way
from smarts.sim.map_matching import FARTHEST_STEP
from smarts.sim.ownership import Ownership
from smarts.sim.starts import corridor_of, distance_along
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.mission import AgentMission, GoalKind
from smarts.types.vehicles import Owner
from smarts.types.world import World


class Entries:
    """Lets agents enter, at the beginning of the episode or when their time has come.

    An agent's new vehicle is put into a cleared gap: traffic that would have to brake hard for it is removed.
    An agent that is to take over a vehicle waits until `HandoverRules` has found one; after the patience of
    its start it gets a new vehicle. An agent that is no ego gets its column when it enters, and waits as long
    as all columns of its interface are held.
    """

    def __init__(self, world: World, ownership: Ownership, routes: AgentRoutes, pool: AgentPool) -> None:
        worlds = len(routes.number)
        self.episodes: list[EpisodeStart | None] = [None] * worlds
        """The present episode of each simulation."""
        self.waiting: list[list[int]] = [[] for _ in range(worlds)]
        """Numbers of the agents that have yet to enter, by simulation."""
        self.coming = np.zeros(worlds, np.int32)
        """How many of them get their column when they enter, shape (B,)."""
        self._crowded: list[set[int]] = [set() for _ in range(worlds)]
        """Numbers of the agents that could not enter when they were to."""
        self._world, self._ownership = world, ownership
        self._routes, self._pool = routes, pool

    def reset(self, row: int, start: EpisodeStart) -> None:
        """Begin an episode in an empty simulation; let in the agents that enter at once.

        Raises:
            ScenarioError: The run has no room for an agent; see `AgentPool.begin`.
        """
        self.episodes[row] = start
        self._crowded[row].clear()
        self._pool.begin(row, start)
        waiting = [
            number
            for number, agent in enumerate(start.agents)
            if agent.entry_time > 0 or agent.take_over or not self._enters_at_once(row, number, agent)
        ]
        self._wait(row, waiting)

    def clear_way(self, row: int) -> None:
        """Clear traffic that blocks agents' spawns, if the episode says so; requires map matching."""
        start = self.episodes[row]
        for slot in np.flatnonzero(self._world.vehicles.owner[row] == Owner.AGENT).tolist():
            if start is not None and start.clears:
                self._clear_around(row, slot)

    def enter(self, env_mask: Bools) -> None:
        """Let in the agents whose time has come; give routes to those that have just taken over a vehicle."""
        for row, waiting in enumerate(self.waiting):
            if waiting and env_mask[row]:
                self._wait(row, [number for number in waiting if not self._enters(row, number)])

    def kept_out(self, row: int) -> list[str]:
        """Return the names of the agents whose time has come and that cannot enter yet."""
        crowded = self._crowded[row]
        if not crowded:
            return []
        return [self._pool.starts[row][number].name for number in self.waiting[row] if number in crowded]

    def is_waiting(self, row: int, number: int) -> bool:
        """Return whether an agent that has not entered still can: it has no column, or waits in it."""
        agent_id = self._pool.column(row, number)
        return agent_id == UNSET or self._world.agents.state[row, agent_id] == AgentStatus.WAITING

    def _wait(self, row: int, numbers: list[int]) -> None:
        """Write which agents of a simulation have yet to enter."""
        self.waiting[row] = numbers
        self.coming[row] = sum(self._pool.column(row, number) == UNSET for number in numbers)

    def _enters(self, row: int, number: int) -> bool:
        """Let an agent in if it can enter now; return whether it has no longer to wait."""
        start, world = self._pool.starts[row][number], self._world
        if not self.is_waiting(row, number):
            agent_id = self._pool.column(row, number)
            if start.take_over and world.agents.entry_step[row, agent_id] == world.step[row]:
                self._go_on(row, agent_id, start)
            return True
        # This is the beginning of the step: its number is already that of its end.
        now = (int(world.step[row]) - 1) * world.dt
        patience = start.take_over.patience if start.take_over else 0.0
        if now < start.entry_time + patience - 1e-9:
            return False
        if self._is_occupied(row, start):
            self._crowded[row].add(number)
            return False
        slot = self._admit(row, number, start)
        if slot is None:
            return False
        vehicles = world.vehicles
        pose = vehicles.position[row, [slot]], vehicles.heading[row, [slot]]
        height = vehicles.height[row, [slot]]
        found = self._routes.atlas.locate(world.map[[row]], *pose, height=height)
        vehicles.lane[row, slot], vehicles.lane_position[row, slot] = found.lane[0], found.s[0]
        vehicles.height[row, slot] = self.roads(row).height_at(found.lane[0], found.s[0])
        self._clear_around(row, slot)
        return True

    def _enters_at_once(self, row: int, number: int, start: AgentStart) -> bool:
        """Let an agent in at a reset; return whether it is in. An agent that is no ego needs a free place."""
        if start.interface != UNSET and self._is_occupied(row, start):
            self._crowded[row].add(number)
            return False
        return self._admit(row, number, start) is not None

    def _admit(self, row: int, number: int, start: AgentStart) -> int | None:
        """Put an agent's vehicle at its start and return its slot, None if no column or no slot is free.

        Raises:
            TrafficError: No slot is free for an ego.
        """
        if start.interface != UNSET and self._world.vehicles.alive[row].all():
            self._crowded[row].add(number)
            return None
        agent_id = self._pool.column(row, number)
        if agent_id == UNSET:
            agent_id = self._pool.take(row, number)
        if agent_id == UNSET:
            self._crowded[row].add(number)
            return None
        return self._ownership.admit(row, agent_id, start)

    def _is_occupied(self, row: int, start: AgentStart) -> bool:
        """Return whether another agent's vehicle is at the start."""
        vehicles = self._world.vehicles.of(row)
        is_level = ~(np.abs(vehicles.height - start.height) > HEIGHT_REACH)
        others = np.flatnonzero((vehicles.owner == Owner.AGENT) & is_level)
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
        vehicles, roads = world.vehicles.of(row), self.roads(row)
        lane = int(vehicles.lane[slot])
        edge = roads.lane_edge[lane] if lane >= 0 else -1
        is_inside_junction = lane >= 0 and bool(roads.is_internal[lane])

        def leads_here(other: int) -> bool:
            route = int(vehicles.route[other])
            return route < 0 or is_inside_junction or edge in world.routes.edges(row, route)

        for other in vehicles_in_the_way(roads, vehicles, slot, leads_here):
            world.registry.dismiss(row, other)

    def _go_on(self, row: int, agent_id: int, start: AgentStart) -> None:
        """Give an agent that has taken a vehicle over a route from there to its goal, with all laps."""
        world = self._world
        slot, lane = int(world.agents.slot[row, agent_id]), -1
        if slot >= 0 and world.missions.goal[row, agent_id] != GoalKind.ENDLESS:
            lane = int(world.vehicles.lane[row, slot])
        own, roads = self._routes.route(row, agent_id), self.roads(row)
        if lane < 0 or not own:
            return
        route, is_laps = own, world.missions.goal[row, agent_id] == GoalKind.LAPS
        s = float(world.vehicles.lane_position[row, slot])
        if math.isnan(distance_along(corridor_of(roads, route), roads, lane, s)):
            rest = route[1:] if is_laps else ()
            try:
                route = shortest_route(roads, _edge_ahead(roads, lane), route[0 if rest else -1]) + rest
            except MapError:
                return  # No way leads from here to the goal, so the agent begins off its route.
        if is_laps:
            route = _with_all_laps(roads, route, lane, s, start.mission)
        if route != own:
            self._reroute(row, agent_id, replace(start.mission, route=route))
        corridor, goal = corridor_of(roads, route), int(world.missions.goal_lane[row, agent_id])
        begin = distance_along(corridor, roads, lane, s)
        end = distance_along(corridor, roads, goal, float(world.missions.goal_s[row, agent_id]), last=True)
        length = end - (0.0 if math.isnan(begin) else begin)
        world.missions.route_length[row, agent_id] = max(0.0, length)

    def _reroute(self, row: int, agent_id: int, mission: AgentMission) -> None:
        """Give an agent its mission with another route, which its vehicle plans from now on."""
        world = self._world
        self._routes.assign_agent(row, agent_id, mission.route)
        number = world.routes.number(row, map(self.roads(row).edge_number, mission.route))
        world.vehicles.route[row, world.agents.slot[row, agent_id]] = number
        world.missions.write(row, agent_id, mission, number)

    def roads(self, row: int) -> LaneGraph:
        """Return the map of a simulation."""
        return self._routes.atlas.graphs[self._world.map[row]]


def _with_all_laps(
    roads: LaneGraph, route: tuple[str, ...], lane: int, s: float, mission: AgentMission
) -> tuple[str, ...]:
    """Return a route of laps with further ones, so that it crosses the goal line as often as there are laps.

    A line that the vehicle may reach at once counts as crossed. Without a way round, the route stays as it
    is.
    """
    corridor, goal = corridor_of(roads, route), mission.goal_lane
    begin = distance_along(corridor, roads, lane, s)
    rows = np.flatnonzero(corridor.lane == goal)
    share = mission.goal_s / float(roads.length[goal])
    lines = corridor.begin[rows] + share * (corridor.end[rows] - corridor.begin[rows])
    ahead = np.count_nonzero(lines > FARTHEST_STEP + (0.0 if math.isnan(begin) else begin))
    edge = roads.edge_ids[roads.lane_edge[goal]]
    if ahead >= mission.laps or route[-1] != edge:
        return route
    if edge in route[:-1]:
        lap = route[len(route) - route[-2::-1].index(edge) - 1 :]
    else:
        try:
            lap = shortest_route(roads, edge, edge, lap=True)[1:]
        except MapError:
            return route
    return route + lap * (mission.laps - int(ahead))


def _edge_ahead(roads: LaneGraph, lane: int) -> str:
    """Return the id of the road edge that a lane belongs to or, inside a junction, leads into."""
    return roads.edge_ids[roads.lane_edge[roads.way_across(lane)[-1]]]
