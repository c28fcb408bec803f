"""How fast vehicles drive through junctions, by hand."""

import math

import numpy as np
import pytest

from smarts.dynamics.performance import performance
from smarts.roads.atlas import RoadAtlas
from smarts.roads.paces import Performance, acceleration_over, paces_in
from smarts.types.vehicles import VehicleKind
from tests.maps import bend, crossing, straight

NO_PACE = np.zeros((0, 1))


def pace_in(roads, lane, agility):
    """Return the pace of one kind."""
    (found,) = paces_in(roads, lane, np.array([agility]))
    return found


@pytest.mark.parametrize(
    ("distance", "speed", "top", "expected"),
    [
        (10.0, 0.0, 14.0, 1.9),  # 4.5 m/s halfway: the engine's force limits it, not its power
        (25.0, 10.0, 20.0, 12.0 / math.sqrt(150.0)),
        (25.0, 10.0, 10.0, 1.2),
    ],
)
def test_power_limits_the_acceleration_at_speed(distance, speed, top, expected):
    heavy = Performance(np.array([1.9]), np.array([12.0]), np.array([0.05]), NO_PACE)
    assert acceleration_over(heavy, 0, distance, speed, top) == pytest.approx(expected)


def test_what_the_kinds_can_do():
    """A bus: 30,000 N, 188 kW, 14,860 kg, steering 0.4 rad/s, axles 7.184 m apart."""
    found = performance(RoadAtlas([straight()]))
    bus = [column[VehicleKind.BUS] for column in found[:3]]
    assert bus == pytest.approx([30_000 / 14_860 - 0.008 * 9.81, 188_000 / 14_860, 0.4 / 7.184])
    assert np.isinf(found.power[VehicleKind.TRAILER])


def test_bends_and_the_steering_limit_the_pace():
    """A quarter circle of 30 m, 47.1 m long: sqrt(3 * 30) m/s = 9.49 m/s, and more near its ends.

    There the bend, measured over 4 m, is smaller: by a half, then by a quarter. One whose steering is slow
    drives with 2 m/s for 5 m at either end, where the bend changes.
    """
    roads, fast = RoadAtlas([bend()]).roads, math.sqrt(90.0)
    ends = 1 / math.sqrt(180.0) + 1 / math.sqrt(120.0)
    assert pace_in(roads, 0, 10.0) == pytest.approx(48 / (44 / fast + 2 * ends), rel=2e-3)
    assert pace_in(roads, 0, 1e-3) == pytest.approx(48 / (10 / 2.0 + 38 / fast), rel=1e-2)


def test_an_atlas_has_a_table_of_paces_for_the_lanes_of_all_maps():
    """Each row inside a junction is what its lane gives alone; lanes of roads have their limits."""
    atlas = RoadAtlas([straight(), crossing()])
    table, roads = performance(atlas), atlas.roads
    assert table.pace.shape == (roads.lane_base[-1], len(VehicleKind))
    for lane in range(len(table.pace)):
        alone = [pace_in(roads, lane, a) for a in table.agility]
        assert table.pace[lane].tolist() == (
            alone if roads.lane_inside[lane] else [roads.lane_speed[lane]] * len(VehicleKind)
        )
    assert (table.pace[roads.lane_inside] < 9.0).any()
    assert performance(atlas).pace is table.pace
