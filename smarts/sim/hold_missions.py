"""Missions of agents that take over vehicles of traffic: each vehicle's own planned route to its end."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from smarts.arrays import Ints
from smarts.errors import MapError
from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import ROAD_LANES
from smarts.roads.corridors import Corridor
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.starts import corridor_of, distance_along, mean_limit, time_at
from smarts.types.mission import AgentMission, GoalKind
from smarts.types.world import World

ROUTES_KEPT = 1024
"""Number of routes that are cached."""
ASIDE = 1.0
"""How far beside the road of the goal it is still reached [m]."""


@dataclass(frozen=True)
class Way:
    """A planned route, and the mission to drive it to its end."""

    corridor: Corridor
    mission: AgentMission
    end: float
    """Distance of the goal along the route [m]."""
    mean_limit: float
    """Mean speed of a driver at the limits [m/s]."""

    def mission_from(self, graph: LaneGraph, lane: int, s: float, speed: float) -> AgentMission:
        """Return the mission of a vehicle that is at a place of a lane now."""
        begin = distance_along(self.corridor, graph, lane, s)
        length = max(0.0, self.end - (0.0 if math.isnan(begin) else begin))
        time = time_at(self.mean_limit, float(graph.speed_limit[lane]), length, speed)
        return replace(self.mission, route_length=length, free_flow_time=time)


class HoldMissions:
    """Makes missions out of vehicles' planned routes.

    Args:
        world: The state; read.
        routes: Knows the maps.
    """

    def __init__(self, world: World, routes: AgentRoutes) -> None:
        self._world, self._atlas = world, routes.atlas
        self._way = lru_cache(maxsize=ROUTES_KEPT)(
            lambda number, edges: find_way(self._atlas.graphs[number], edges)
        )

    def mission(self, row: int, slot: int) -> AgentMission:
        """Return the mission to drive a vehicle's planned route; endless where none is known.

        A vehicle that has passed its edge before drives the rest of the route. The goal is the end of the
        route: off the map, or across the last edge in any lane.
        """
        world, vehicles = self._world, self._world.vehicles
        number, lane = int(vehicles.route[row, slot]), int(vehicles.lane[row, slot])
        if number < 0 or lane < 0:
            return AgentMission()
        map_number = int(world.map[row])
        graph = self._atlas.graphs[map_number]
        edges = world.routes.edges(row, number)
        edges = edges[_rest_of(edges, int(world.route_place[row, slot])) :]
        way = self._way(map_number, tuple(edges.tolist()))
        if way is None:
            return AgentMission()
        place = float(vehicles.lane_position[row, slot]), float(vehicles.speed[row, slot])
        return way.mission_from(graph, lane, *place)


def find_way(graph: LaneGraph, edges: tuple[int, ...]) -> Way | None:
    """Return a route with its mission, None if agents cannot drive it."""
    route = tuple(graph.edge_ids[edge] for edge in edges)
    lanes = [lane for lane in graph.edge_lanes(edges[-1]) if int(graph.kind[lane]) in ROAD_LANES]
    try:
        corridor = corridor_of(graph, route)
    except MapError:
        return None
    if not lanes:
        return None
    lane = lanes[len(lanes) // 2]
    goal_s = float(graph.length[lane])
    x, y, _ = graph.pose_at(lane, goal_s)
    leads_on = any(len(graph.successors(each)) for each in lanes)
    mission = AgentMission(
        route=route,
        goal=GoalKind.POSITION if leads_on else GoalKind.OFF_MAP,
        goal_position=(x, y),
        goal_radius=float(np.sum(graph.width[lanes])) / 2 + ASIDE,
        goal_lane=lane,
        goal_s=goal_s,
    )
    end = distance_along(corridor, graph, lane, goal_s, last=True)
    return Way(corridor, mission, end, mean_limit(graph, route))


def _rest_of(edges: Ints, place: int) -> int:
    """Return where the rest of a route begins for a vehicle: 0 unless it has passed its edge before.

    Args:
        edges: The route.
        place: Where the vehicle's next edge is on it.
    """
    here = max(0, place - 1)
    return here if edges[here] in edges[:here] else 0
