"""Hand-made worlds without SUMO: vehicles at given poses, matched to the map, some of them with agents."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.scene import Scene
from smarts.sim.agent_pool import AgentPool, Hold
from smarts.sim.map_matching import MapMatcher
from smarts.sim.ownership import Ownership
from smarts.types.episode import AgentStart
from smarts.types.mission import AgentMission
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World


@dataclass(frozen=True)
class Car:
    """A vehicle; with a mission it gets the next free `agent_id`."""

    x: float
    y: float
    heading: float = 0.0
    speed: float = 0.0
    mission: AgentMission | None = None
    owner: int = Owner.TRAFFIC
    kind: VehicleKind = VehicleKind.PASSENGER
    length: float = 5.0
    width: float = 1.8
    name: str = "car"
    height: float = np.nan


@dataclass(frozen=True)
class HandMade:
    """A world with its maps and routes. Slots and agents are in the order of the cars."""

    world: World
    atlas: RoadAtlas
    routes: AgentRoutes
    ownership: Ownership
    pool: AgentPool

    def match(self) -> None:
        """Match all vehicles to the map."""
        MapMatcher(Scene(self.world, self.atlas, self.routes)).match(np.ones(self.world.worlds, np.bool_))

    def advance(self) -> None:
        """Begin a step: copy the current state to `world.before`."""
        self.world.advance(np.ones(self.world.worlds, np.bool_))


class Willing:
    """A provider that accepts any vehicle."""

    def can_accept(self, env_mask: np.ndarray, slots: np.ndarray) -> np.ndarray:
        return np.full(len(env_mask), Refusal.NONE)


def world_of(
    *rows: Sequence[Car], maps: Sequence[LaneGraph], capacity: int = 16, agents: int = 4, vias: int = 2
) -> HandMade:
    """Return a world with a simulation for each row of cars; row i is on map i modulo the number of maps."""
    atlas = RoadAtlas(maps)
    world = World(
        worlds=len(rows),
        capacity=capacity,
        agents=agents,
        lanes=max(len(graph.lane_ids) for graph in maps),
        vias=vias,
    )
    willing, routes = Willing(), AgentRoutes(atlas, len(rows), agents)
    pool = AgentPool(world, routes)
    ownership = Ownership(world, {Owner.TRAFFIC: willing, Owner.AGENT: willing}, pool)
    made = HandMade(world, atlas, routes, ownership, pool)
    for row, cars in enumerate(rows):
        world.map[row] = row % len(maps)
        _place(made, row, cars)
    made.match()
    for row in range(len(rows)):
        world.settle(row)
    return made


def place_on_route(made: HandMade, agent: int = 0) -> tuple[int, int, float]:
    """Return an agent's slot, the row of its lane on its route, and its place there; of simulation 0."""
    routes, slot = made.routes.current.value, int(made.world.agents.slot[0, agent])
    route = routes.free + routes.number[0, agent]
    lane = made.world.vehicles.lane[0, slot]
    (row,) = (row for row in range(routes.start[route], routes.start[route + 1]) if routes.lane[row] == lane)
    return slot, row, float(made.world.vehicles.lane_position[0, slot])


def _place(made: HandMade, row: int, cars: Sequence[Car]) -> None:
    missions = [car.mission for car in cars if car.mission]
    made.routes.assign(row, int(made.world.map[row]), [mission.route for mission in missions])
    agent_id = 0
    for car in cars:
        if car.mission:
            graph = made.atlas.graphs[made.world.map[row]]
            route = made.world.routes.number(row, map(graph.edge_number, car.mission.route))
            made.world.missions.write(row, agent_id, car.mission, route)
            pose = (car.x, car.y, car.heading)
            start = AgentStart(car.name, pose, car.speed, car.mission, car.kind, car.length, car.width)
            slot = made.ownership.admit(row, agent_id, start)
            made.world.agents.agent[row, agent_id] = agent_id
            made.pool.starts[row].append(start)
            made.pool.holds[row].append(Hold(agent_id, agent_id, 0))
            agent_id += 1
        else:
            slot = made.world.registry.admit(row, car.name, car.owner, car.kind, car.length, car.width)
            made.world.vehicles.position[row, slot] = car.x, car.y
            made.world.vehicles.heading[row, slot] = car.heading
            made.world.vehicles.speed[row, slot] = car.speed
        made.world.vehicles.height[row, slot] = car.height
