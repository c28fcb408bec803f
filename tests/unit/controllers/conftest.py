import pytest

from tests.unit.controllers.rig import Rig


@pytest.fixture
def rig():
    """Return a factory of rigs, all closed after the test."""
    made = []

    def make(*rows, **options):
        made.append(Rig(*rows, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()
