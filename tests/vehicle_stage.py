"""The vehicle stage without the other stages."""

import numpy as np

from smarts.providers.vehicle import FleetVehicles
from smarts.types.actions import CommandMode, Commands
from smarts.types.mission import AgentMission
from tests import maps
from tests.worlds import Car, world_of

MISSION = AgentMission(route=("road",))


def ego(x=20.0, y=0.0, speed=10.0, **options):
    return Car(x, y, 0.0, speed, MISSION, **options)


class VehicleStage:
    """The vehicle stage without the other stages, on a straight road."""

    def __init__(self, *rows, model="bullet", **options):
        self.graph = maps.straight(lanes=3, length=600.0)
        self.made = world_of(*rows, maps=[self.graph])
        self.world = self.made.world
        self.commands = Commands.allocate(*self.world.agents.slot.shape)
        self.vehicles = FleetVehicles(self.world, model, **options)
        self.all = np.ones(self.world.worlds, np.bool_)
        self.vehicles.reset(self.all)

    def actuate(self, throttle=0.0, brake=0.0, steering=0.0, *, row=slice(None), agent_id=slice(None)):
        self.commands.mode[row, agent_id] = CommandMode.ACTUATORS
        self.commands.actuators[row, agent_id] = throttle, brake, steering

    def step(self, steps=1, rows=None):
        rows = self.all if rows is None else rows
        for _ in range(steps):
            self.world.advance(rows)
            self.made.ownership.apply(rows)
            tracks = self.vehicles.step(self.commands, rows)
        return tracks

    @property
    def boxes(self):
        """The keys of Bullet's boxes in the first simulation."""
        return list(self.vehicles.fleet._bullet._worlds[0]._boxes)
