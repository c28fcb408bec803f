"""What the tests of environments share."""

import pytest

from tests.unit.env.social_stage import Played


@pytest.fixture
def closing():
    """Return a function that closes its environment when the test ends."""
    made = []

    def keep(env):
        made.append(env)
        return env

    yield keep
    for env in made:
        env.close()


@pytest.fixture
def play():
    made = []

    def make(*arguments, **options):
        made.append(Played(*arguments, **options))
        return made[-1]

    yield make
    for one in made:
        one.runner.close()
