import math

import pytest

from smarts.core.colors import Colors, SceneColors
from smarts.core.condition_state import ConditionState
from smarts.core.coordinates import BoundingBox, Dimensions, Heading, Point, Pose, RefLinePoint


def test_colours_are_rgba_in_unit_range():
    for colour in (*Colors, *SceneColors):
        assert len(colour.value) == 4
        assert all(0 <= channel <= 1 for channel in colour.value)
    assert Colors.Blue.value == (0, 153 / 255, 1, 1)
    assert SceneColors.Agent.value == Colors.Red.value


def test_only_true_counts_as_true():
    assert [state for state in ConditionState if state] == [ConditionState.TRUE]


@pytest.mark.parametrize(
    ("degrees", "heading"), [(0, math.pi / 2), (90, 0), (180, -math.pi / 2), (270, math.pi)]
)
def test_headings_of_compass_directions(degrees, heading):
    assert Heading.from_sumo(degrees) == pytest.approx(heading)
    assert Heading(heading).as_sumo == pytest.approx(degrees)


def test_headings_wrap():
    assert Heading(3 * math.pi) == pytest.approx(math.pi)
    assert Heading(math.pi / 4).relative_to(Heading(math.pi)) == pytest.approx(-3 * math.pi / 4)
    assert Heading(math.pi / 2).direction_vector() == pytest.approx([0, 1])


def test_a_vehicle_is_half_its_length_behind_its_bumper():
    pose = Pose.from_front_bumper(Point(10, 20), math.pi / 2, length=4)
    assert pose.point == pytest.approx((10, 18, 0))
    assert pose.heading == pytest.approx(math.pi / 2)


def test_boxes():
    box = BoundingBox(Point(0, -1), Point(4, 3, 2))
    assert box.as_dimensions == Dimensions(4, 4, 2)
    assert box.as_dimensions.as_lwh == (4, 4, 2)
    assert box.center == Point(2, 1, 1)
    assert box.contains(Point(1, 1))
    assert not box.contains(Point(1, 3.5))


def test_points_and_arrays():
    assert Point.from_np_array(Point(1, 2).as_np_array) == Point(1, 2, 0)
    assert RefLinePoint(5) == (5, 0, 0)
