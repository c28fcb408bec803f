"""What the tests of environments share."""

import pytest


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
