"""Whatever a registry lists can be imported and is complete."""

import pytest

from smarts.controllers import CONTROLLERS
from smarts.observations import FEATURES
from smarts.sensors import SENSORS
from smarts.types.actions import ActionSpaceType
from smarts.types.traffic import TRAFFIC_ENGINES

REGISTRIES = (CONTROLLERS, SENSORS, FEATURES, TRAFFIC_ENGINES)


@pytest.mark.parametrize("registry", REGISTRIES, ids=lambda registry: registry.kind)
def test_every_name_leads_to_a_part(registry):
    for name in registry:
        assert isinstance(registry[name], type), name


def test_every_action_type_has_a_controller_of_its_own():
    assert [*CONTROLLERS] == [*ActionSpaceType.__members__]
    assert len({CONTROLLERS[name] for name in CONTROLLERS}) == len(CONTROLLERS)
