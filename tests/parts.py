"""Minimal stages of the step, for tests that need a simulation but not these stages."""

import math
from collections.abc import Sequence

import numpy as np

from smarts.agents.interface import AgentInterface
from smarts.errors import SmartsError
from smarts.providers.sumo_engine import SumoEngine
from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.roads.scene import Scene
from smarts.sim.agent_pool import AgentPool
from smarts.sim.entries import Entries
from smarts.sim.map_matching import MapMatcher
from smarts.sim.ownership import Ownership
from smarts.sim.simulation import Simulation, Stages
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.missions import PlacedMission, place_missions
from smarts.types.actions import Actions, CommandMode, Commands
from smarts.types.agent_states import AgentStatus
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.events import Contacts, Events
from smarts.types.frame import Readings
from smarts.types.mission import AgentMission, GoalKind
from smarts.types.streams import Purpose, stream, traffic_seed
from smarts.types.transfers import NO_TRANSFERS, Refusal
from smarts.types.vehicles import Owner
from smarts.types.world import World

SUBSTEPS = 10
LIMIT = 200
"""Maximum number of traffic vehicles in a simulation."""


class PassOn:
    """Controllers that use the first three values of every action as throttle, brake and steering."""

    def __init__(self, worlds: int, agents: int) -> None:
        self._commands = Commands.allocate(worlds, agents, substeps=SUBSTEPS)

    def command(self, actions, rows):
        self._commands.mode[rows] = CommandMode.ACTUATORS
        self._commands.actuators[rows] = actions.values[rows, :, :3]
        return self._commands


class Bicycles:
    """Bicycle models without slip: throttle 1 is 3 m/s^2, brake 1 is 8 m/s^2, steering 1 is 0.5 rad."""

    def __init__(self, world: World, agents: int) -> None:
        self.failures = {}
        self._world = world
        self._tracks = np.zeros((world.worlds, agents, SUBSTEPS, 3))

    def reset(self, rows):
        pass

    def step(self, commands, rows):
        world = self._world
        driven = (world.agents.state == AgentStatus.ACTIVE) & rows[:, None]
        for row, agent_id in zip(*map(np.ndarray.tolist, np.nonzero(driven)), strict=True):
            self._drive(world, row, agent_id, commands.actuators[row, agent_id].tolist())
        return self._tracks

    def _drive(self, world, row, agent_id, actuators):
        throttle, brake, steering = actuators
        vehicles, slot = world.vehicles, int(world.agents.slot[row, agent_id])
        x, y = vehicles.position[row, slot].tolist()
        heading, speed = float(vehicles.heading[row, slot]), float(vehicles.speed[row, slot])
        dt = world.dt / SUBSTEPS
        yaw_rate = 0.0
        for substep in range(SUBSTEPS):
            speed = max(0.0, speed + (3.0 * throttle - 8.0 * brake) * dt)
            yaw_rate = speed * math.tan(0.5 * steering) / (0.6 * float(vehicles.length[row, slot]))
            heading = math.remainder(heading + yaw_rate * dt, math.tau)
            x, y = x + speed * math.cos(heading) * dt, y + speed * math.sin(heading) * dt
            self._tracks[row, agent_id, substep] = x, y, heading
        vehicles.position[row, slot] = x, y
        vehicles.heading[row, slot] = heading
        vehicles.acceleration[row, slot] = (speed - vehicles.speed[row, slot]) / world.dt
        vehicles.speed[row, slot] = speed
        vehicles.yaw_rate[row, slot] = yaw_rate
        world.agents.steering[row, agent_id] = 0.5 * steering

    def can_accept(self, rows, slots):
        return np.full(len(rows), Refusal.NONE)

    def close(self):
        pass


class NoContacts:
    def __init__(self, worlds: int, agents: int, capacity: int) -> None:
        self._contacts = Contacts.allocate(worlds, agents, capacity)

    def find(self, tracks, rows):
        return self._contacts


class NoEvents:
    """Events of a simulation in which nothing happens and episodes do not end."""

    def __init__(self, worlds: int, agents: int) -> None:
        self._events = Events.allocate(worlds, agents)

    def reset(self, contacts, rows):
        return self._events

    def detect(self, contacts, rows):
        return self._events


class NoTransfers:
    def clear(self, row):
        pass

    def propose(self, events, rows):
        return NO_TRANSFERS


class NoSensors:
    def observe(self, observe_mask):
        return Readings({}, {})


class NoRecorder:
    def record(self, frame):
        pass

    def close(self):
        pass


def simulation_of(
    scenarios: Sequence[BuiltScenario], *, worlds: int, egos: int, spare_agents: int = 0
) -> tuple[Simulation, Actions]:
    """Return a simulation with SUMO's traffic and egos as bicycle models, and its actions.

    The caller resets it with starts from `episode`.
    """
    maps = [built.roads() for built in scenarios]
    atlas = RoadAtlas(maps)
    agents = egos + spare_agents
    world = World(
        worlds=worlds,
        capacity=LIMIT + agents,
        agents=agents,
        egos=egos,
        lanes=max(len(graph.lane_ids) for graph in maps),
        vias=4,
    )
    traffic = SumoEngine(world, maps)
    vehicles = Bicycles(world, agents)
    routes = AgentRoutes(atlas, worlds, agents)
    pool = AgentPool(
        world, routes, [AgentInterface()] if spare_agents else (), [spare_agents] if spare_agents else ()
    )
    ownership = Ownership(world, {Owner.TRAFFIC: traffic, Owner.AGENT: vehicles}, pool)
    stages = Stages(
        ownership=ownership,
        entries=Entries(world, ownership, routes, pool),
        controllers=PassOn(worlds, agents),
        vehicles=vehicles,
        traffic=traffic,
        matcher=MapMatcher(Scene(world, atlas, routes)),
        contacts=NoContacts(worlds, agents, world.vehicles.capacity),
        events=NoEvents(worlds, agents),
        transfer_rules=NoTransfers(),
        sensors=NoSensors(),
        recorder=NoRecorder(),
    )
    return Simulation(world, stages), Actions.allocate(worlds, agents)


def episode(
    scenarios: Sequence[BuiltScenario],
    number: int,
    *,
    egos: int,
    world: int,
    seed: int = 42,
    episode: int = 0,
) -> EpisodeStart:
    """Return the start of an episode of `scenarios[number]` with random traffic and the first missions."""
    built = scenarios[number]
    plans = built.episodes(egos)
    plan = next((plan for plan in plans if plan.traffic == "random_social_vehicles"), plans[0])
    generator = stream(seed, Purpose.STARTS, world=world, episode=episode)
    variation = built.scenario.start_variation
    placed = place_missions(plan.missions, built.roads(), generator, variation, place=built.name)
    return EpisodeStart(
        seed=seed,
        world=world,
        episode=episode,
        scenario=built.name,
        map=number,
        traffic=built.traffic_files(plan.traffic),
        traffic_name=plan.traffic,
        traffic_seed=traffic_seed(seed, world=world, episode=episode),
        limit=LIMIT,
        agents=tuple(_agent_start(f"ego-{ego}", mission, built) for ego, mission in enumerate(placed)),
    )


def _agent_start(name: str, placed: PlacedMission, built: BuiltScenario) -> AgentStart:
    if placed.goal is None:
        raise SmartsError("the episodes of tests have goals", place=built.name)
    x, y, _ = placed.goal.pose(built.roads())
    mission = AgentMission(
        route=placed.route,
        goal=GoalKind.POSITION,
        goal_position=(x, y),
        goal_lane=placed.goal.lane,
        goal_s=placed.goal.s,
    )
    return AgentStart(name, placed.pose, placed.speed, mission, entry_time=placed.start_time)
