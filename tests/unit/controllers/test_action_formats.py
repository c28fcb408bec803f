"""Action formats: single actions and batches are parsed alike, and errors name the invalid action."""

import numpy as np
import pytest

from smarts.controllers import action_format, action_space
from smarts.controllers.action_formats import NumbersFormat, PathFormat, Rejected, numbers_of
from smarts.errors import ActionError
from smarts.types.actions import Actions, ActionSpaceType

COUNT, POINTS = 6, 40
PLACE = "action of 'ego'"


@pytest.fixture
def samples():
    def draw(kind):
        space = action_space(kind)
        space.seed(3)
        return np.array([space.sample() for _ in range(COUNT)])

    return draw


@pytest.mark.parametrize("kind", ActionSpaceType)
def test_single_actions_and_batches_are_written_alike(samples, kind):
    found, given = action_format(kind), samples(kind)
    one, many = Actions.allocate(1, COUNT, POINTS), Actions.allocate(1, COUNT, POINTS)
    for agent_id, action in enumerate(given):
        found.write(found.parse(action, PLACE, POINTS), (0, agent_id), one)
    parsed = found.parse_batch(given)
    assert not isinstance(parsed, Rejected)
    found.write(parsed, (np.zeros(COUNT, int), np.arange(COUNT)), many)
    for name in Actions._fields:
        np.testing.assert_array_equal(getattr(one, name), getattr(many, name), name)
    has_numbers = kind != ActionSpaceType.Empty
    assert (many.values.any() or many.path.any()) == has_numbers
    assert many.path_length.any() == found.has_path


@pytest.mark.parametrize(
    "kind", [ActionSpaceType.Lane, ActionSpaceType.Continuous, ActionSpaceType.Trajectory]
)
def test_the_first_invalid_action_of_a_batch_is_named(samples, kind):
    given = samples(kind).astype(np.float64)
    given[[2, 4]] = np.nan
    rejected = action_format(kind).parse_batch(given)
    assert isinstance(rejected, Rejected)
    assert rejected.first == 2


def test_numbers_are_clipped_and_whole_columns_rounded():
    found = NumbersFormat([0, -1], [60, 1], whole=[1])
    assert found.parse([70, 0.6], PLACE, 0).tolist() == [60, 1]
    assert found.parse(np.array([-1, -7]), PLACE, 0).tolist() == [0, -1]


def test_a_speed_alone_differs_from_acceleration_and_yaw_rate():
    found = action_format(ActionSpaceType.Direct)
    assert found.parse(7, PLACE, 0).tolist() == [7, 0, 1]
    assert found.parse(1e9, PLACE, 0).tolist() == [60, 0, 1]
    assert found.parse((7, 0.5), PLACE, 0).tolist() == [7, 0.5, 0]


@pytest.mark.parametrize("columns", [[[1] * 41] * 4, [[1, 2]] * 5, [[1, 2], [1], [1], [1]]])
def test_paths_have_columns_of_equal_length(columns):
    with pytest.raises(ActionError) as caught:
        PathFormat((1, 2, 3, 4)).parse(columns, PLACE, POINTS)
    assert caught.value.place == PLACE
    assert f"1 to {POINTS} points" in caught.value.remedy


@pytest.mark.parametrize("value", [None, "1", True, [1, 2], float("nan")])
def test_values_that_are_not_numbers_are_rejected_with_place_and_remedy(value):
    with pytest.raises(ActionError) as caught:
        numbers_of(value, (), PLACE, lambda: "give a number")
    assert (caught.value.place, caught.value.remedy) == (PLACE, "give a number")
    assert repr(value)[:20] in caught.value.problem or str(value)[:20] in caught.value.problem
