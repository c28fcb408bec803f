"""A stage on which vehicles are put where a test wants them, and events are judged."""

import numpy as np

from smarts.roads.scene import Scene
from smarts.sim.events import AgentEvents
from smarts.types.events import Contacts, Event
from smarts.types.interface import AgentRules
from smarts.types.mission import AgentMission, GoalKind
from tests import maps
from tests.worlds import world_of

AGENT_STATES = 4
ROAD = AgentMission(
    route=("road",), goal=GoalKind.POSITION, goal_position=(150.0, 0.0), goal_lane=0, goal_s=150.0
)


class Stage:
    """A hand-made world whose vehicles are put where a test wants them, and the judge of it."""

    def __init__(self, *rows, graph=None, ending=None, alive=(), **rules):
        self.made = world_of(*rows, maps=[graph or maps.straight()], agents=AGENT_STATES)
        self.world = self.made.world
        self.rules = AgentRules.allocate(AGENT_STATES)
        for name, value in rules.items():
            getattr(self.rules, name)[:] = value
        if ending is not None:
            self.rules.ending[:] = ending
        scene = Scene(self.world, self.made.atlas, self.made.routes)
        self.judge = AgentEvents(scene, self.rules, alive)
        self.contacts = Contacts.allocate(self.world.worlds, AGENT_STATES, self.world.vehicles.capacity)
        self.rows = np.ones(self.world.worlds, np.bool_)

    def step(self, *places, row=0, hits=()):
        """Move vehicles to (x, y) or (x, y, heading); return the events of the first agent's agent."""
        self.made.advance()
        vehicles = self.world.vehicles
        for slot, (x, y, *heading) in enumerate(places):
            vehicles.position[row, slot] = x, y
            vehicles.heading[row, slot] = heading[0] if heading else 0.0
        self.made.match()
        self.contacts.partner[:] = -1
        for agent_id, partner in hits:
            self.contacts.partner[row, agent_id] = partner
        self.events = self.judge.detect(self.contacts, self.rows)
        return Event(int(self.events.bits[row, 0]))

    @property
    def agents(self):
        return self.world.agents
