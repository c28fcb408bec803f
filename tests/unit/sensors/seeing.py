"""What a sensor reports of a world made by hand."""

import math

import numpy as np

from smarts.roads.scene import Scene
from smarts.types.mission import AgentMission
from tests import maps
from tests.worlds import Car, world_of

RADIUS = 30.0
"""Radius of the right lane of the bend; the left one's is 3.2 m less."""
BEND = AgentMission(route=("bend",))
STRAIGHT_ON = AgentMission(route=("west_in", "east_out"))
TO_THE_LEFT = AgentMission(route=("west_in", "north_out"))


def on_bend(angle, radius=RADIUS, **more):
    """Return a car that follows the bend at an angle [rad] around its centre, which is the origin."""
    heading = math.remainder(angle + math.pi / 2, math.tau)
    return Car(radius * math.cos(angle), radius * math.sin(angle), heading, **more)


def in_bend(*cars, **more):
    return world_of(cars, maps=[maps.bend()], **more)


def at_crossing(*cars, **more):
    return world_of(cars, maps=[maps.crossing()], **more)


def scene_of(made):
    return Scene(made.world, made.atlas, made.routes)


def seen(sensor, made, agent_id=0):
    """Return the readings of one agent of the first simulation, by field."""
    out = {field.name: field.allocate(made.world.worlds, 1) for field in sensor.fields()}
    wanted = np.zeros((made.world.worlds, 1), np.bool_)
    wanted[0] = True
    sensor.bind(scene_of(made), np.array([agent_id], np.int32), out)(wanted)
    return {name: array[0, 0] for name, array in out.items()}
