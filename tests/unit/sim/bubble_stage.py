"""A road on which vehicles are put where a test wants them, with the real rules of bubbles and hand-overs."""

import numpy as np
from shapely.geometry import box

from smarts.agents import AgentInterface, PooledAgents
from smarts.agents.pooled import merge_pools
from smarts.bubbles.phases import Phase
from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.roads.scene import Scene
from smarts.sim.agent_pool import AgentPool
from smarts.sim.bubble_rules import BubbleRules
from smarts.sim.entries import Entries
from smarts.sim.map_matching import MapMatcher
from smarts.sim.ownership import Ownership
from smarts.sim.transfer_rules import HandoverRules
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import AgentStatus
from smarts.types.episode import EpisodeStart
from smarts.types.events import Events
from smarts.types.traffic import TrafficFiles
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World
from tests import maps
from tests.unit.bubbles.shapes import bubble

LANER = AgentInterface(action=ActionSpaceType.Lane, vehicle_model="kinematic")
ALL = np.ones(1, np.bool_)
NONE, AIRLOCK, DRIVEN, RELEASING = Phase
ZONE = box(100, -30, 120, 30)


class Gate:
    """A provider that takes any vehicle that can be driven, unless a test closes it."""

    closed: frozenset = frozenset()

    def can_accept(self, rows, slots):
        answers = np.full(len(slots), Refusal.NONE)
        answers[np.isin(slots, list(self.closed))] = Refusal.TOO_CLOSE
        return answers


class Agents(Gate):
    """The provider of agents' vehicles: no trailers."""

    world: World

    def can_accept(self, rows, slots):
        answers = super().can_accept(rows, slots)
        answers[self.world.vehicles.kind[rows, slots] == VehicleKind.TRAILER] = Refusal.KIND
        return answers


class Road:
    """One simulation on a straight road of three lanes, x from 0 to 400 m."""

    def __init__(self, *bubbles, columns=4, acts=True):
        self.atlas = RoadAtlas([maps.straight(3, 400.0)])
        lanes = len(self.atlas.graphs[0].lane_ids)
        self.world = World(worlds=1, capacity=24, agents=columns, lanes=lanes, egos=0)
        routes = AgentRoutes(self.atlas, 1, columns)
        (pooled,) = merge_pools([PooledAgents(LANER, columns)])
        self.pool = AgentPool(self.world, routes, [pooled.interface], [pooled.capacity])
        self.traffic, self.agents_gate = Gate(), Agents()
        self.agents_gate.world = self.world
        drivers = {Owner.TRAFFIC: self.traffic, Owner.AGENT: self.agents_gate}
        self.ownership = Ownership(self.world, drivers, self.pool)
        entries = Entries(self.world, self.ownership, routes, self.pool)
        can_take = self.agents_gate.can_accept
        self.handovers = HandoverRules(self.world, entries, self.pool, can_take)
        self.rules = BubbleRules(self.world, routes, self.pool, can_take)
        self.match = MapMatcher(Scene(self.world, self.atlas, routes)).match
        self.events = Events.allocate(1, columns)
        self.acts, self._fresh = acts, np.zeros((1, columns), np.bool_)
        self.begin(*bubbles)

    def begin(self, *bubbles):
        files = TrafficFiles(net=None)
        start = EpisodeStart(1, 0, 0, "road", 0, files, None, 0, 0, (), bubbles=bubbles)
        self.world.clear(0)
        self.pool.begin(0, start)
        self.rules.begin(0, start)
        self._speeds = {}

    def car(self, x, lane=1, speed=0.0, name="car", kind=VehicleKind.PASSENGER):
        """Put a vehicle in, its front at x; each step it goes on by `speed` * 0.1 s."""
        y = self.atlas.graphs[0].pose_at(lane, 10.0)[1]
        slot = self.world.registry.admit(0, name, Owner.TRAFFIC, kind, 4.0, 1.8)
        self.world.vehicles.position[0, slot] = x - 2.0, y
        self.world.vehicles.speed[0, slot] = speed
        self.world.vehicles.route[0, slot] = self.world.routes.number(0, [0])
        return slot

    def reset(self):
        self.match(ALL)
        self.world.settle(0)
        self._finish()
        return self

    def step(self, count=1, **fronts):
        """Make steps; vehicles named `c0`, `c1`, ... by their slot are put at these fronts first."""
        for _ in range(count):
            self.world.advance(ALL)
            self.refused = self.ownership.apply(ALL, self._fresh)
            vehicles = self.world.vehicles
            vehicles.position[0, :, 0] += vehicles.speed[0] * self.world.dt * vehicles.alive[0]
            for name, x in fronts.items():
                vehicles.position[0, int(name[1:]), 0] = x - 2.0
            self.ownership.drop_vanished(ALL)
            self.match(ALL)
            self._finish()
        return self

    def _finish(self):
        self.rules.place(ALL)
        self.proposed = self.rules.propose(self.events, ALL)
        self.ownership.submit(self.handovers.propose(self.events, ALL))
        self.ownership.submit(self.proposed)
        agents = self.world.agents
        is_asked = (agents.next_due == self.world.step) & (agents.slot >= 0)
        self._fresh = is_asked & self.acts

    def column(self, slot):
        held = np.flatnonzero(self.world.agents.slot[0] == slot)
        return int(held[0]) if len(held) else -1

    def phase(self, slot):
        column = self.column(slot)
        holds = self.rules._field.holds
        return Phase(int(holds.phase[0, column])) if column >= 0 else Phase.NONE

    def state(self, slot):
        """Return the status of the agent that holds a vehicle, VACANT without one."""
        column = self.column(slot)
        return AgentStatus(int(self.world.agents.state[0, column])) if column >= 0 else AgentStatus.VACANT

    def owner(self, slot):
        return Owner(int(self.world.vehicles.owner[0, slot]))

    def count(self, name):
        return int(getattr(self.rules.states, name)[0].sum())


def gate(margin=10.0, zone=ZONE, **more):
    return bubble(zone, margin, **more)


def phases(road, slot, steps):
    """Return the phase after each step, joined where equal."""
    seen = []
    for _ in range(steps):
        road.step()
        if not seen or seen[-1] != road.phase(slot):
            seen.append(road.phase(slot))
    return seen
