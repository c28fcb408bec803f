import pytest

from tests.unit.controllers.rig import Rig


@pytest.fixture
def rig(closing):
    """Return a factory of rigs, all closed after the test."""
    return lambda *rows, **options: closing(Rig(*rows, **options))
