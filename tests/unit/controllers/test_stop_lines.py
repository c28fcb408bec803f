"""How the fallback controller waits at junctions: the speeds of its reference, by hand."""

import math

import numpy as np
import pytest

from smarts.controllers.stop_lines import limit_by_right_of_way
from smarts.dynamics.performance import performance
from smarts.types.mission import AgentMission, GoalKind
from tests.maps import crossing
from tests.worlds import Car, world_of

NORTH = AgentMission(route=("south_in", "north_out"), goal=GoalKind.POSITION, goal_position=(1.6, 80.0))


def speeds(y, speed, other):
    """Return the limited speeds of points that are 1 m apart, from the middle of a car on its way north."""
    made = world_of([Car(1.6, y, math.pi / 2, speed, NORTH), other], maps=[crossing()])
    vehicles = made.world.vehicles
    points = np.zeros((30, 4))
    points[:, 0], points[:, 1] = 1.6, y + np.arange(30)
    points[:, 2], points[:, 3] = math.pi / 2, 10.0
    routes, lane = made.routes.current.value, int(vehicles.lane[0, 0])
    (row,) = (r for r in range(routes.start[routes.free], len(routes.lane)) if routes.lane[r] == lane)
    place = float(vehicles.lane_position[0, 0])
    limit_by_right_of_way(
        made.world.state, made.atlas.roads, routes, performance(made.atlas), 0, 0, row, place, points
    )
    return points[:, 3]


@pytest.mark.parametrize(("y", "speed"), [(-6.4, 0.4), (-6.4, 0.0), (-6.2, 0.3)])
def test_a_vehicle_that_has_come_to_where_it_waits_does_not_creep_on(y, speed):
    """Its front is 0.7 m or less before the lane of a car that stands in its way."""
    assert (speeds(y, speed, Car(1.6, -1.6, 0.0, 0.0)) == 0.0).all()


def test_a_vehicle_rolls_up_to_where_it_waits():
    """From its line, 2.5 m ahead of it, where it would brake with 3 m/s^2 over 1.5 m to stop 1 m before."""
    found = speeds(-15.0, 2.0, Car(1.6, -1.6, 0.0, 0.0))
    assert found[0] == pytest.approx(math.sqrt(2.0 * 3.0 * 1.5))
    assert found[-1] == 0.0
