"""`envision=`, `headless=` and SMARTS_ENVISION: where each environment is shown, or that nothing is made."""

import pytest

from smarts.env import (
    RLlibHiWayEnv,
    VectorHiWayEnv,
)
from smarts.sim.options import ENVISION, VIEWER, Options
from smarts.sim.outlet import Address

HERE, THERE = Address.parse(VIEWER, ""), Address("127.0.0.1", 9)


@pytest.fixture
def address_of(monkeypatch):
    """Return a function that makes an environment and returns where it is shown, None for nowhere."""
    monkeypatch.delenv(ENVISION, raising=False)

    def address_of(**options):
        env = VectorHiWayEnv(2, ["loop"], 1, **options)
        runner = env._runner
        env.close()
        # Without a recorder, no notes are taken.
        assert (runner.recorder is not None) == bool(runner._notes)
        return runner.recorder._parts[0]._address if runner.recorder else None

    return address_of


def test_an_environment_is_shown_where_it_is_said(address_of, monkeypatch):
    assert address_of() is None
    assert address_of(envision=True) == HERE
    assert address_of(envision="127.0.0.1:9") == THERE
    assert address_of(envision=True, simulation=Options(envision="127.0.0.1:9")) == THERE
    monkeypatch.setenv(ENVISION, "127.0.0.1:9")
    assert address_of() == address_of(envision=True) == THERE
    assert address_of(envision=False) is None


def test_headless_false_shows_it():
    env = RLlibHiWayEnv({"scenarios": ["loop"], "agent_specs": 1, "headless": False})
    (publisher,) = env._env.runner.recorder._parts
    env.close()
    assert publisher._address == HERE
