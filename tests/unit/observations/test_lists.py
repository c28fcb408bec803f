"""Lists of features: as they are given, what is refused, and features of users."""

import inspect
import sys
from types import ModuleType

import numpy as np
import pytest

from smarts.errors import OwnCodeError, SmartsError
from smarts.geometry.compiling import kernel
from smarts.observations import FEATURES
from smarts.observations.arrays import VECTOR
from smarts.observations.feature import Feature
from smarts.observations.lists import FeatureChoice, feature_list, observation_names
from tests.maps import straight
from tests.raising import raises
from tests.unit.observations.test_features import ArrayObservation, context_of, mission, observe
from tests.worlds import Car, world_of


def made_world(*speeds):
    cars = [Car(20.0 * n, 0.0, speed=speed, mission=mission("road")) for n, speed in enumerate(speeds)]
    return world_of(cars, maps=[straight()])


def test_an_observation_is_a_name_a_dict_or_a_list():
    assert set(observation_names()) == {"benchmark", "neighbor_rows", "paper", "raw"}
    longer = feature_list({"base": "benchmark", "frames": 2, "stacked": [{"image": {"size": 32}}]})
    assert longer.frames == 2
    assert longer.stacked[-1] == FeatureChoice("image", {"size": 32})
    assert longer.features == feature_list("benchmark").features
    assert feature_list(longer) is longer
    fewer = feature_list({"base": "benchmark", "drop": ["agent_index", "goal"], "features": ["goal"]})
    names = [[each.name for each in choices] for choices in (fewer.stacked, fewer.features)]
    assert names == [
        ["lane_offset", "speed", "steering", "heading_errors", "neighbors"],
        ["light", "time_stood", "lane_changes", "arrival_order", "action_mask", "goal"],
    ]
    assert fewer.reward == "benchmark"
    assert feature_list(["goal", "speed"]) == feature_list({"features": ["goal", "speed"]})


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ("benchmrk", "benchmrk"),
        (4, "4"),
        ({"stackd": []}, "stackd"),
        ({"features": "goal"}, "goal"),
        ({"features": [{"goal": 1}]}, "{'goal': 1}"),
        ({"features": ["gaol"]}, "gaol"),
        ({"frames": 0}, "0"),
        ({"base": "benchmark", "drop": ["agent_indx"]}, "'agent_index'"),
    ],
)
def test_what_is_no_observation(given, shown):
    with pytest.raises(SmartsError) as raised:
        feature_list(given)
    assert shown in str(raised.value)


@pytest.mark.parametrize(
    ("feature", "shown"),
    [
        ({"image": {"sise": 8}}, "sise"),
        ({"image": {"size": -1}}, "size of the feature 'image' is -1"),
        ({"neighbor_rows": {"rows": "8"}}, "rows of the feature 'neighbor_rows' is '8'"),
        ({"neighbor_rows": {"columns": ["ahed"]}}, "ahead"),
    ],
)
def test_options_that_are_none(feature, shown):
    with pytest.raises(SmartsError) as raised:
        ArrayObservation(context_of(made_world(1.0)), {"features": [feature]})
    assert shown in str(raised.value)


@pytest.mark.parametrize("name", FEATURES)
def test_every_feature_alone(name):
    """Numbers within bounds, of those that are asked for alone; nothing is left after a reset."""
    context = context_of(made_world(3.0, 6.0), agents=2)
    for given in ({"frames": 1, "features": [name]}, {"frames": 2, "stacked": [name]}):
        if name == "sensors" and "stacked" in given:
            continue  # fields without axes cannot be stacked
        observation = ArrayObservation(context, given)
        observation.observe(np.array([[True, False]]))
        for field in observation.fields:
            array = observation.arrays[field.name]
            assert ((array >= field.low) & (array <= field.high)).all()
            assert not array[0, 1].any()
        observation.reset(np.array([[True, True]]))
        assert not any(array.any() for array in observation.arrays.values())


@pytest.mark.parametrize("agents", [1, 4])
def test_the_layout_is_where_the_numbers_are(agents):
    made = made_world(*range(3, 3 + agents))
    observation = ArrayObservation(context_of(made, agents), "benchmark")
    layout, seen = feature_list("benchmark").layout(agents), observe(observation)[VECTOR]
    np.testing.assert_allclose(seen[0, :, layout["speed"]].ravel() * 30, np.arange(3, 3 + agents), rtol=1e-6)
    np.testing.assert_array_equal(seen[0, :, layout["agent_index"]], np.eye(agents))
    assert layout["arrival_order"].stop == seen.shape[2]


class Twice(Feature):
    """Half the speed, twice."""

    size = 2

    def __init__(self, context, scale=30.0):
        super().__init__(context)
        self.scale = scale

    def bind(self, *out):
        (numbers,) = out
        world, agent_ids = self.context.scene.world, self.context.agent_ids

        def observe(observe_mask):
            rows = np.arange(world.worlds)[:, None]
            speed = world.vehicles.speed[rows, world.agents.slot[:, agent_ids]]
            numbers[observe_mask] = (0.5 * speed / self.scale)[observe_mask][:, None]

        return observe


@pytest.fixture
def own_module(monkeypatch):
    module = ModuleType("own_features")
    module.Twice, module.NONE, module.__file__ = Twice, 3, __file__
    monkeypatch.setitem(sys.modules, "own_features", module)
    return module


def test_a_feature_of_ones_own(own_module):
    given = {"frames": 2, "stacked": ["speed", {"own_features:Twice": {"scale": 15.0}}]}
    seen = observe(ArrayObservation(context_of(made_world(6.0)), given))[VECTOR]
    np.testing.assert_allclose(seen[0, 0], [0.2] * 6, rtol=1e-6)
    given_class = {"frames": 2, "stacked": ["speed", FeatureChoice(Twice, {"scale": 15.0})]}
    same = observe(ArrayObservation(context_of(made_world(6.0)), given_class))[VECTOR]
    np.testing.assert_array_equal(same, seen)
    assert feature_list(given).layout(1) == {"speed": slice(3, 4), "own_features:Twice": slice(4, 6)}


def test_numbers_of_an_own_feature_that_are_out_of_bounds(own_module):
    observation = ArrayObservation(
        context_of(made_world(6.0)), {"features": [{"own_features:Twice": {"scale": 1.0}}]}
    )
    with pytest.raises(OwnCodeError) as raised:
        observe(observation)
    assert "own_features:Twice" in str(raised.value)
    assert "3.0" in str(raised.value)


class NoKernel(Feature):
    """A function that is not compiled."""

    @staticmethod
    def write(state, roads, routes, b, g, a, out):
        out[0] = 0.0


class Nothing(Feature):
    """Neither a kernel nor `bind`."""


class Misspelt(Feature):
    """A column that vehicles do not have."""

    @staticmethod
    @kernel
    def write(state, roads, routes, b, g, a, out):
        out[0] = state.vehicles.sped[b, 0]


@pytest.mark.parametrize(
    ("kind", "line", "value"),
    [(NoKernel, 1, "NoKernel.write"), (Nothing, None, "Feature.write"), (Misspelt, 4, "'sped'")],
)
def test_mistakes_in_kernels_are_named_by_file_and_line(monkeypatch, kind, line, value):
    name = f"own_{kind.__name__.lower()}"  # one each: the registry keeps what it has imported
    module = ModuleType(name)
    module.Bad = kind
    monkeypatch.setitem(sys.modules, name, module)
    written = inspect.unwrap(getattr(kind.write, "py_func", kind.write)).__code__
    place = f"{written.co_filename}:{written.co_firstlineno + (line - 1 if line else 0)}"
    with raises(OwnCodeError, place, values=[value]):
        observe(ArrayObservation(context_of(made_world(6.0)), {"features": [f"{name}:Bad"]}))
