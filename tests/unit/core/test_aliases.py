import math

import pytest

from smarts.core.coordinates import Heading, Point, Pose


@pytest.mark.parametrize(
    ("degrees", "heading"), [(0, math.pi / 2), (90, 0), (180, -math.pi / 2), (270, math.pi)]
)
def test_headings_of_compass_directions(degrees, heading):
    assert Heading.from_sumo(degrees) == pytest.approx(heading)
    assert Heading(heading).as_sumo == pytest.approx(degrees)


def test_a_vehicle_is_half_its_length_behind_its_bumper():
    pose = Pose.from_front_bumper(Point(10, 20), math.pi / 2, length=4)
    assert pose.point == pytest.approx((10, 18, 0))
    assert pose.heading == pytest.approx(math.pi / 2)
