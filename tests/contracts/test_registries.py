"""Every registered name can be imported."""

import pytest

from smarts.controllers import CONTROLLERS
from smarts.observations import FEATURES
from smarts.planners import PLANNERS
from smarts.sensors import SENSORS
from smarts.types.actions import ActionSpaceType
from smarts.types.traffic import TRAFFIC_ENGINES

REGISTRIES = (CONTROLLERS, SENSORS, FEATURES, TRAFFIC_ENGINES, PLANNERS)


@pytest.mark.parametrize("registry", REGISTRIES, ids=lambda registry: registry.kind)
def test_every_name_is_a_class(registry):
    for name in registry:
        assert isinstance(registry[name], type), name


def test_every_action_type_has_its_own_controller():
    assert [*CONTROLLERS] == [*ActionSpaceType.__members__]
    assert len({CONTROLLERS[name] for name in CONTROLLERS}) == len(CONTROLLERS)
