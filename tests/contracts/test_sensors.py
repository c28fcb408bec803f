"""Every sensor: in bounds whatever the world is like, the same in any batch, serving only who asks."""

import numpy as np
import pytest

from smarts.roads.scene import Scene
from smarts.sensors import SENSORS
from smarts.types.mission import SeatMission
from tests import maps
from tests.worlds import Car, world_of

ROUTE = SeatMission(route=("west_in", "north_out"))


@pytest.fixture(params=list(SENSORS))
def sensor(request):
    return SENSORS[request.param]()


def random_cars(generator):
    """Return two agents and some others on and beside a crossing, some of them absurdly fast."""
    places = generator.uniform(-60, 60, (6, 2))
    headings = generator.uniform(-np.pi, np.pi, 6)
    speeds = generator.choice([0.0, 5.0, 30.0, 1e4], 6)
    return [
        Car(*place, heading, speed, mission=ROUTE if number < 2 else None)
        for number, (place, heading, speed) in enumerate(zip(places, headings, speeds, strict=True))
    ]


def observe(sensor, rows, wanted, filled_with=0):
    made = world_of(*rows, maps=[maps.crossing()])
    seats = np.arange(2, dtype=np.int32)
    out = {field.name: field.allocate(len(rows), len(seats)) for field in sensor.fields()}
    for array in out.values():
        array[:] = filled_with
    sensor.observe(Scene(made.world, made.atlas, made.routes), seats, np.array(wanted), out)
    return out


def test_readings_are_in_bounds(sensor):
    generator = np.random.Generator(np.random.Philox(1))
    for _ in range(20):
        out = observe(sensor, [random_cars(generator)], [[True, True]])
        for field in sensor.fields():
            values = out[field.name]
            assert values.dtype == field.dtype
            assert np.isfinite(values).all(), field.name
            assert ((values >= field.low) & (values <= field.high)).all(), field.name


def test_readings_are_the_same_in_any_batch(sensor):
    generator = np.random.Generator(np.random.Philox(2))
    rows = [random_cars(generator) for _ in range(3)]
    together = observe(sensor, rows, [[True, True]] * 3)
    for row, cars in enumerate(rows):
        alone = observe(sensor, [cars], [[True, True]])
        for name, values in alone.items():
            assert (values[0] == together[name][row]).all(), name


def test_who_is_not_wanted_is_left_alone(sensor):
    generator = np.random.Generator(np.random.Philox(3))
    out = observe(sensor, [random_cars(generator)], [[False, True]], filled_with=1)
    assert all((values[0, 0] == 1).all() for values in out.values())
