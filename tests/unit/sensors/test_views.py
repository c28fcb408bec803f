"""Pictures from above, and the lidar, against what the geometry says of every pixel."""

import math

import numpy as np
import pytest

from smarts.agents.options import OGM, RGB, DrivableAreaGridMap, Lidar, OcclusionMap, SensorParams
from smarts.sensors.drivable_area_grid_map import DrivableArea
from smarts.sensors.lidar_point_cloud import LidarPoints
from smarts.sensors.occlusion_map import VisibleArea
from smarts.sensors.occupancy_grid_map import OccupancyGrid
from smarts.sensors.top_down_rgb import TopDownRgb
from smarts.types.colors import SceneColors
from smarts.types.vehicles import VehicleKind
from tests.unit.sensors.seeing import BEND, RADIUS, STRAIGHT_ON, at_crossing, in_bend, on_bend, seen
from tests.worlds import Car

HEIGHT, WIDTH, SIZE = 96, 80, 0.5
SHAPE = {"width": WIDTH, "height": HEIGHT, "resolution": SIZE}


def places(car):
    """Return the place in the map of every pixel of a view from a car, shape (height, width, 2)."""
    ahead = ((HEIGHT / 2 - 0.5 - np.arange(HEIGHT)) * SIZE)[:, None]
    left = ((WIDTH / 2 - 0.5 - np.arange(WIDTH)) * SIZE)[None, :]
    cosine, sine = math.cos(car.heading), math.sin(car.heading)
    return np.stack((car.x + ahead * cosine - left * sine, car.y + ahead * sine + left * cosine), -1)


def inside(points, car, margin=0.0):
    """Return which points lie in a car's footprint."""
    offset = points - np.array([car.x, car.y])
    cosine, sine = math.cos(car.heading), math.sin(car.heading)
    along = offset @ np.array([cosine, sine])
    across = offset @ np.array([-sine, cosine])
    return (abs(along) <= car.length / 2 + margin) & (abs(across) <= car.width / 2 + margin)


def test_road_in_a_curve():
    car = on_bend(0.7, mission=BEND)
    picture = seen(DrivableArea(DrivableAreaGridMap(**SHAPE)), in_bend(car))["data"][:, :, 0]
    points = places(car)
    radius, angle = np.hypot(*np.moveaxis(points, -1, 0)), np.arctan2(points[..., 1], points[..., 0])
    expected = (radius >= 26.8 - 1.6) & (radius <= RADIUS + 1.6) & (angle >= 0) & (angle <= math.pi / 2)
    # The map's picture has cells of 0.2 m; what is nearer to the edge than that may fall either way.
    edge = np.minimum(abs(radius - 25.2), abs(radius - 31.6))
    ends = radius * np.minimum(abs(angle), abs(angle - math.pi / 2))
    clear = (edge > 0.2) & (ends > 0.2)
    assert (picture[clear] == expected[clear]).all()
    assert expected[clear].sum() > 1000


def test_occupied_pixels_are_those_in_footprints():
    cars = [on_bend(0.7, mission=BEND), on_bend(1.0), on_bend(0.5, RADIUS - 3.2, length=12.0)]
    picture = seen(OccupancyGrid(OGM(**SHAPE)), in_bend(*cars))["data"][:, :, 0]
    expected = np.any([inside(places(cars[0]), car) for car in cars], axis=0)
    surely = np.any([inside(places(cars[0]), car, -1e-6) for car in cars], axis=0)
    assert (picture[surely] == 1).all()
    assert not picture[~expected].any()
    assert picture.sum() > 100


def test_colours_at_a_junction():
    own, other = Car(-15.0, -1.6, mission=STRAIGHT_ON), Car(1.6, 0.0, 2.0)
    picture = seen(TopDownRgb(RGB(**SHAPE)), at_crossing(own, other))["data"]
    points = places(own)
    for car, colour in ((own, SceneColors.Agent), (other, SceneColors.SocialVehicle)):
        levels = [round(255 * channel) for channel in colour.value[:3]]
        assert (picture[inside(points, car, -0.01)] == levels).all()
    road = [round(255 * channel) for channel in SceneColors.Road.value[:3]]
    assert (picture == road).all(axis=-1).mean() > 0.05


def is_hidden(points, eye, car):
    """Return which points a car hides from the eye: the line between meets its box before the point."""
    cosine, sine = math.cos(car.heading), math.sin(car.heading)
    axes = np.array([[cosine, sine], [-sine, cosine]])
    begin = axes @ (np.array(eye) - np.array([car.x, car.y]))
    step = (points - np.array(eye)) @ axes.T
    half = np.array([car.length, car.width]) / 2
    with np.errstate(divide="ignore"):
        one, other = (-half - begin) / step, (half - begin) / step
    near, far = np.minimum(one, other).max(-1), np.maximum(one, other).min(-1)
    return (near <= far) & (near > 0) & (near < 1)


def test_what_lies_behind_vehicles_is_hidden():
    own, other = on_bend(0.4, mission=BEND), on_bend(0.8, RADIUS - 3.2)
    picture = seen(VisibleArea(OcclusionMap(**SHAPE)), in_bend(own, other))["data"][:, :, 0]
    points, eye = places(own), (own.x, own.y)
    hidden = is_hidden(points, eye, other)
    wider = Car(other.x, other.y, other.heading, length=other.length + 1.6, width=other.width + 1.6)
    narrower = Car(other.x, other.y, other.heading, length=other.length - 1.2, width=other.width - 0.6)
    surely = is_hidden(points, eye, narrower) & ~inside(points, wider)
    assert not picture[surely].any()
    assert picture[~is_hidden(points, eye, wider)].all()
    assert (picture == 1 - hidden)[~inside(points, wider)].mean() > 0.99
    assert surely.sum() > 50


def beams(*angles, reach=50.0):
    """Return a lidar whose lasers look so far up [rad], each in four directions."""
    return LidarPoints(Lidar(SensorParams(0.0, 2 * math.pi, angles, math.pi / 2, reach, 0.0, 0.0)))


def test_rays_meet_the_box_ahead_in_a_curve():
    own = on_bend(0.4, mission=BEND)
    ahead = Car(own.x + 10 * math.cos(own.heading), own.y + 10 * math.sin(own.heading), own.heading)
    cloud = seen(beams(-0.1, -0.2, 0.0), in_bend(own, ahead))
    forward = np.array([math.cos(own.heading), math.sin(own.heading)])
    place = np.array([own.x, own.y])
    # 0.3 m above the roof of 1.5 m: 7.5 m ahead a ray down by 0.1 rad is at 1.05 m, below the other's roof.
    assert cloud["hit"][0] == 1
    assert cloud["point"][0, :2] == pytest.approx(place + 7.5 * forward)
    assert cloud["point"][0, 2] == pytest.approx(1.8 - 7.5 * math.tan(0.1))
    # To the left it meets the ground.
    distance = 1.8 / math.tan(0.1)
    assert cloud["point"][1] == pytest.approx([*(place + distance * np.array([-forward[1], forward[0]])), 0])
    # A level ray passes above the car.
    assert cloud["hit"][8:].tolist() == [0] * 4
    assert not cloud["point"][8:].any()
    assert cloud["ray"][0] == pytest.approx(
        [*(50 * math.cos(0.1) * forward), -50 * math.sin(0.1)], rel=1e-5, abs=1e-4
    )


def test_level_rays_meet_a_bus_in_a_junction_as_far_as_they_reach():
    bus = Car(0.0, -1.6, math.pi / 2, kind=VehicleKind.BUS, length=12.0, width=2.5)
    made = at_crossing(Car(-20.0, -1.6, mission=STRAIGHT_ON), bus)
    cloud = seen(beams(0.0), made)
    assert cloud["hit"].tolist() == [1, 0, 0, 0]
    assert cloud["point"][0] == pytest.approx([-1.25, -1.6, 1.8])
    assert seen(beams(0.0, reach=18.7), made)["hit"].sum() == 0
    assert seen(beams(0.0, reach=18.8), made)["hit"].sum() == 1
