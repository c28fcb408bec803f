"""Every sensor stays in bounds in any world, is equal in any batch, and writes only masked agents."""

import sys
from contextlib import closing
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import pytest

from smarts.agents import AgentInterface, AgentType
from smarts.agents.benchmark import benchmark_interface
from smarts.env import HiWayEnv, VectorHiWayEnv
from smarts.roads.scene import Scene
from smarts.sensors import SENSORS
from smarts.sensors.bounds import FARTHEST
from smarts.sensors.protocol import KernelSensor
from smarts.sensors.suite import SensorSuite
from smarts.types.interface import Field
from smarts.types.mission import AgentMission, Via
from smarts.types.traffic import Signal
from tests import maps
from tests.worlds import Car, world_of

VIA = Via(position=(-40.0, -1.6), lane=1, radius=2.0, speed=8.0)
ROUTE = AgentMission(route=("west_in", "north_out"), vias=(VIA,))
AGENT_STATES = np.arange(2, dtype=np.int32)
ABSURD = (np.nan, np.inf, -np.inf, 1e300, -1e300, -7.5, 0.0)


@pytest.fixture(params=list(SENSORS))
def sensor(request):
    return SENSORS[request.param]()


def random_cars(generator):
    """Return two agents and other vehicles on and beside a crossing, some of them absurdly fast."""
    places = generator.uniform(-60, 60, (6, 2))
    headings = generator.uniform(-np.pi, np.pi, 6)
    speeds = generator.choice([0.0, 5.0, 30.0, 1e4], 6)
    return [
        Car(*place, heading, speed, mission=ROUTE if number < 2 else None)
        for number, (place, heading, speed) in enumerate(zip(places, headings, speeds, strict=True))
    ]


def scene_of(*rows):
    made = world_of(*rows, maps=[maps.crossing()])
    made.world.signals[:] = np.arange(made.world.signals.shape[1]) % len(Signal)
    return Scene(made.world, made.atlas, made.routes)


def observe(sensor, scene, observe_mask, filled_with=0):
    out = {field.name: field.allocate(scene.world.worlds, len(AGENT_STATES)) for field in sensor.fields()}
    for array in out.values():
        array[:] = filled_with
    sensor.bind(scene, AGENT_STATES, out)(np.array(observe_mask))
    return out


def check_bounds(sensor, out):
    for field in sensor.fields():
        values = out[field.name]
        assert values.dtype == field.dtype
        assert np.isfinite(values).all(), field.name
        assert ((values >= field.low) & (values <= field.high)).all(), field.name


def test_readings_are_in_bounds_in_a_nonsensical_world(sensor):
    generator = np.random.Generator(np.random.Philox(4))
    scene = scene_of(random_cars(generator))
    for _ in range(30):
        make_absurd(scene.world, generator)
        check_bounds(sensor, observe(sensor, scene, [[True, True]]))


def make_absurd(world, generator):
    tables = (world.vehicles, world.before, world.agents, world.missions)
    for column in (column for table in tables for column in table):
        if column.dtype == np.float64:
            hit = generator.random(column.shape) < 0.2
            column[hit] = generator.choice(ABSURD, int(hit.sum()))
    lane = world.vehicles.lane
    lane[:] = np.where(generator.random(lane.shape) < 0.2, -1, generator.integers(0, 20, lane.shape))


def test_readings_are_the_same_in_any_batch(sensor):
    generator = np.random.Generator(np.random.Philox(2))
    rows = [random_cars(generator) for _ in range(3)]
    together = observe(sensor, scene_of(*rows), [[True, True]] * 3)
    for row, cars in enumerate(rows):
        alone = observe(sensor, scene_of(cars), [[True, True]])
        for name, values in alone.items():
            assert (values[0] == together[name][row]).all(), name


def test_whole_readings_of_masked_agents_are_written(sensor):
    scene = scene_of(random_cars(np.random.Generator(np.random.Philox(5))))
    fresh, used = (observe(sensor, scene, [[False, True]], filled_with) for filled_with in (0, 1))
    assert all((fresh[name][0, 1] == used[name][0, 1]).all() for name in fresh)
    assert all((used[name][0, 0] == 1).all() for name in used)


def test_kernels_are_compiled_once():
    scene = scene_of(*[random_cars(np.random.Generator(np.random.Philox(6)))] * 2)
    interface = AgentInterface.from_type(AgentType.Full, occlusion_map=True)
    SensorSuite(scene, [interface, interface, None, None]).observe(np.eye(2, 4) > 0)
    for name in SENSORS:
        if issubclass(SENSORS[name], KernelSensor):
            write = SENSORS[name].write
            assert not write.signatures, name
            # None where the bound kernel comes from the cache on disk.
            assert len(write.callee.signatures) <= 1, name


@dataclass(frozen=True)
class Odometer:
    """How far the vehicle has been driven."""

    unit: float = 1.0

    def fields(self):
        return (Field("distance", (), np.float32, 0, FARTHEST, "m", "driven since entry"),)

    def bind(self, scene, agent_ids, out):
        def observe(observe_mask):
            distance = scene.world.agents.distance_travelled[:, agent_ids] / self.unit
            out["distance"][observe_mask] = distance[observe_mask]

        return observe

    @staticmethod
    def as_object(readings, seen) -> float:
        return float(readings["distance"])


@pytest.fixture
def odometer(monkeypatch):
    """Register the sensor for a test."""
    module = ModuleType("an_odometer")
    module.Odometer = Odometer
    monkeypatch.setitem(sys.modules, "an_odometer", module)
    monkeypatch.setitem(SENSORS._places, "odometer", "an_odometer:Odometer")


def test_a_new_sensor_is_one_file_and_one_line(odometer):
    interface = AgentInterface(odometer=True)
    assert interface.sensors["odometer"] is True
    assert interface.replace(odometer=Odometer(1000.0)).odometer == Odometer(1000.0)
    assert AgentInterface().odometer is False
    with closing(HiWayEnv(["loop"], {"a": interface, "b": AgentInterface()}, seed=1)) as env:
        env.reset()
        for _ in range(5):
            seen, *_ = env.step({})
        assert seen["a"].odometer == pytest.approx(seen["a"].distance_travelled)
        assert seen["b"].odometer is None
        assert "odometer" in dir(seen["a"])
    with closing(
        VectorHiWayEnv(1, ["loop"], {"a": benchmark_interface(odometer=Odometer(10.0))}, observation="raw")
    ) as arrays:
        assert "odometer/distance" in arrays.spaces.blocks[0].observation
        for now in [arrays.reset(1), *(arrays.step([np.zeros((1, 1), int)]) for _ in range(3))]:
            odometers = now.observations[0]
        driven = odometers["ego_vehicle_state/distance_travelled"]
        np.testing.assert_allclose(odometers["odometer/distance"], driven / 10.0, rtol=1e-6)
