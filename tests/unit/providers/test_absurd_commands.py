"""Extreme but finite commands: the state of every vehicle stays finite."""

from contextlib import closing

import numpy as np
import pytest

from smarts.providers.vehicle import TYPES, FleetVehicles
from smarts.types.actions import CommandMode, Commands
from smarts.types.mission import AgentMission
from tests import maps
from tests.worlds import Car, world_of

STEPS = 150
FASTEST = 500.0
"""Upper bound of the speed after `STEPS` steps with any engine [m/s]."""
KINDS = [*TYPES]


def _extremes(commands, step, draws):
    """Write a random mixture of the smallest and largest values that controllers allow, in each step."""
    commands.actuators[..., :2] = draws.choice([0.0, 1.0], commands.actuators[..., :2].shape)
    most = 10.0 if (commands.mode == CommandMode.ACTUATORS_RATE).any() else 1.0
    commands.actuators[..., 2] = draws.choice([-most, 0.0, most], commands.mode.shape)


def _bang_bang(commands, step, draws):
    """Write full throttle and intermittent full brake, with steering from lock to lock."""
    commands.actuators[...] = 1.0, float(step % 3 == 0), 1.0 if step % 2 else -1.0


def _anywhere(commands, step, draws):
    """Write random references."""
    commands.reference_length[...] = draws.integers(1, 64, commands.reference_length.shape)
    commands.reference[...] = draws.uniform(-1e6, 1e6, commands.reference.shape)


CASES = {
    "extremes": (CommandMode.ACTUATORS, _extremes),
    "steering rate": (CommandMode.ACTUATORS_RATE, _extremes),
    "bang-bang": (CommandMode.ACTUATORS, _bang_bang),
    "track": (CommandMode.TRACK, _anywhere),
}


@pytest.mark.parametrize(
    ("model", "case"),
    [("bullet", "extremes"), ("bullet", "track"), ("kinematic", "bang-bang"), ("dynamic", "steering rate")],
)
def test_every_state_stays_finite(model, case):
    mode, write = CASES[case]
    mission = AgentMission(route=("road",))
    # Vehicles begin side by side and behind each other, so that they also collide.
    cars = [
        Car(100.0 + 15.0 * (number // 2), 3.2 * (number % 2), 0.0, 30.0, mission, kind=kind)
        for number, kind in enumerate(KINDS)
    ]
    made = world_of(cars, maps=[maps.straight(length=600.0)], agents=len(cars))
    world, rows = made.world, np.ones(1, np.bool_)
    vehicles, commands = FleetVehicles(world, model), Commands.allocate(1, len(cars))
    draws = np.random.Generator(np.random.Philox(key=5))
    commands.mode[...] = mode
    with closing(vehicles):
        vehicles.reset(rows)
        for step in range(STEPS):
            write(commands, step, draws)
            world.advance(rows)
            tracks = vehicles.step(commands, rows)
            assert np.isfinite(tracks.poses).all(), f"step {step}"
            for name, column in world.vehicles._asdict().items():
                assert np.isfinite(column[0, : len(cars)]).all(), f"{name} in step {step}"
            assert np.abs(world.vehicles.speed[0, : len(cars)]).max() < FASTEST, f"step {step}"
