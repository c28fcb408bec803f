"""What the tests of environments share."""

import pytest

from tests.unit.env.social_stage import Played


@pytest.fixture
def play(closing):
    def make(*arguments, **options):
        made = Played(*arguments, **options)
        return closing(made, made.runner)

    return make
