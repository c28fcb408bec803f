"""Own features in environments: sizes that cannot be had are refused before anything is observed."""

from typing import Any

import numpy as np
import pytest

from smarts.env.adapters import ObservationAndReward
from smarts.errors import OwnCodeError
from smarts.observations.feature import Feature
from smarts.registry import definition_of
from tests.raising import raises
from tests.unit.observations.test_lists import context_of, made_world


class Mine(Feature):
    """Zeros."""

    def bind(self, *out):
        return lambda observe_mask: None


class Others(Mine):
    """A number of each other agent."""

    @classmethod
    def size_for(cls, agents):
        return agents - 1


class Raises(Mine):
    """No number."""

    @classmethod
    def size_for(cls, agents):
        raise KeyError("agents")


def adapter_of(*features, agents=1):
    return ObservationAndReward(context_of(made_world(*[1.0] * agents), agents=agents), [*features])


@pytest.mark.parametrize("size", [2.5, 0, -1, "2", None, True, np.float64(2.0)])
def test_a_size_that_is_no_whole_number_is_refused(size):
    kind: Any = type("Sized", (Mine,), {"size": size, "__module__": __name__})
    with raises(OwnCodeError, values=["'Sized'", repr(size)]):
        adapter_of(kind)


def test_a_size_is_named_with_file_and_line(monkeypatch):
    monkeypatch.setattr(Mine, "size", 2.5)
    with raises(OwnCodeError, definition_of(Mine), values=["2.5"]):
        adapter_of("speed", Mine)
    with raises(OwnCodeError, values=[__file__, "KeyError: 'agents'"]):
        adapter_of(Raises)


@pytest.mark.parametrize(("agents", "numbers"), [(1, 1), (2, 2)])
def test_a_feature_of_the_others_has_no_number_of_a_single_agent(agents, numbers):
    assert adapter_of("speed", Others, agents=agents).fields[0].shape == (numbers,)


def test_numbers_of_numpy_are_sizes(monkeypatch):
    monkeypatch.setattr(Mine, "size", np.int64(3))
    assert adapter_of(Mine).fields[0].shape == (3,)
