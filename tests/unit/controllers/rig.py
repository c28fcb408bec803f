"""A rig that drives agents' vehicles on hand-made maps with controllers, tracking and dynamics."""

import math

import numpy as np

from smarts.controllers.action_masks import ActionMasker
from smarts.controllers.set import ControllerSet
from smarts.providers.vehicle import FleetVehicles
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, ActionSpaceType
from smarts.types.mission import AgentMission
from smarts.types.vehicles import VehicleKind
from tests.maps import Road, graph_of
from tests.worlds import Car, world_of

SIZES = {VehicleKind.PASSENGER: (4.5, 1.6), VehicleKind.BUS: (12.19, 2.55), VehicleKind.TRUCK: (8.0, 2.5)}


def agent(x, y, heading=0.0, speed=0.0, *, route=("road",), kind=VehicleKind.PASSENGER):
    length, width = SIZES[kind]
    return Car(x, y, heading, speed, AgentMission(route=route), kind=kind, length=length, width=width)


def winding(radius, *, before=80.0, turn=math.pi / 2, after=150.0, lanes=1, speed=40.0):
    """Return a map with edge "road": along +x from the origin, left by `turn` [rad], then straight."""
    angles = np.linspace(0.0, turn, 2 + math.ceil(radius * turn / 0.5))
    bend = [(before + radius * math.sin(a), radius * (1.0 - math.cos(a))) for a in angles]
    x, y = bend[-1]
    end = (x + after * math.cos(turn), y + after * math.sin(turn))
    return graph_of({"road": Road([(0.0, 0.0), *bend, end], lanes, speed=speed)})


class Rig:
    """Vehicles of agents of one action type; after each step, vehicles are matched and masks are written."""

    def __init__(self, *rows, graph, kind=ActionSpaceType.LaneWithContinuousSpeed, model="bullet", **options):
        self.made = world_of(*rows, maps=[graph])
        self.world = self.made.world
        self.graph = graph
        scene = Scene(self.world, self.made.atlas, self.made.routes)
        shape = self.world.agents.slot.shape
        self.actions = Actions.allocate(*shape, path=64)
        self.actions.kind[:] = kind
        self.controllers = ControllerSet(scene, [kind], **options)
        self.vehicles = FleetVehicles(self.world, model)
        self.action_masker = ActionMasker(scene)
        self.rows = np.ones(shape[0], np.bool_)
        self.vehicles.reset(self.rows)
        self.action_masker.write(self.rows)
        self.commands = self.tracks = None

    def act(self, *values, path=None, agent_id=0):
        """Give the agent `agent_id` of every simulation a new action."""
        self.actions.given[:, agent_id] = self.actions.fresh[:, agent_id] = True
        self.actions.values[:, agent_id, : len(values)] = values
        if path is not None:
            self.actions.path[:, agent_id, : len(path)] = path
            self.actions.path_length[:, agent_id] = len(path)
        self.actions.action_mask[:, agent_id] = self.world.agents.action_mask[:, agent_id]

    def step(self, steps=1, rows=None):
        rows = self.rows if rows is None else rows
        for _ in range(steps):
            self.world.advance(rows)
            self.commands = self.controllers.command(self.actions, rows)
            self.tracks = self.vehicles.step(self.commands, rows)
            for error in self.vehicles.failures.values():
                raise error
            self.made.match()
            self.action_masker.write(rows)
            self.actions.fresh[:] = False
        return self

    def log(self, steps, *columns, slot=0):
        """Step, and return columns of the first simulation's vehicle after each step."""
        found = []
        for _ in range(steps):
            self.step()
            found.append([np.copy(getattr(self.world.vehicles, column)[0, slot]) for column in columns])
        return np.array(found)

    def track(self, steps, slot=0):
        """Step, and return the first simulation's position after each step, shape (steps, 2)."""
        return np.array([self.step().world.vehicles.position[0, slot].copy() for _ in range(steps)])

    @property
    def position(self):
        return self.world.vehicles.position[0, 0]

    @property
    def speed(self):
        return float(self.world.vehicles.speed[0, 0])

    @property
    def agents(self):
        return self.world.agents

    def close(self):
        self.vehicles.close()
