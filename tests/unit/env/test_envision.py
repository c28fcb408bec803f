"""`envision=`, `headless=` and SMARTS_ENVISION: where each environment is shown, or that nothing is made."""

import pytest

from smarts.agents.benchmark import benchmark_interface
from smarts.env import (
    HiWayEnv,
    PyMARLEnv,
    RLlibHiWayEnv,
    SingleHiWayEnv,
    SingleHiWayVectorEnv,
    VectorHiWayEnv,
    hiway_parallel_env,
)
from smarts.env.runner import SimulationRunner
from smarts.sim.options import ENVISION, VIEWER, Options
from smarts.sim.outlet import Address

HERE, THERE = Address.parse(VIEWER, ""), Address("127.0.0.1", 9)
LOOP = ["loop"]
ENVIRONMENTS = {
    "HiWayEnv": lambda **options: HiWayEnv(LOOP, {"a": benchmark_interface()}, **options),
    "SingleHiWayEnv": lambda **options: SingleHiWayEnv(LOOP, **options),
    "SingleHiWayVectorEnv": lambda **options: SingleHiWayVectorEnv(2, LOOP, **options),
    "VectorHiWayEnv": lambda **options: VectorHiWayEnv(2, LOOP, 1, **options),
    "hiway_parallel_env": lambda **options: hiway_parallel_env(LOOP, 1, **options),
    "RLlibHiWayEnv": lambda **options: RLlibHiWayEnv({"scenarios": LOOP, "agent_specs": 1, **options}),
    "PyMARLEnv": lambda **options: PyMARLEnv(LOOP, 1, **options),
}


ALWAYS = "VectorHiWayEnv", "RLlibHiWayEnv"


@pytest.fixture
def address_of(monkeypatch):
    """Return a function that makes an environment and returns where it is shown, None for nowhere."""
    made = []
    begin = SimulationRunner.__init__

    def keep(self, *args, **kwargs):
        begin(self, *args, **kwargs)
        made.append(self)

    monkeypatch.setattr(SimulationRunner, "__init__", keep)
    monkeypatch.delenv(ENVISION, raising=False)

    def address_of(name, **options):
        env = ENVIRONMENTS[name](**options)
        runner = made[-1]
        recorder = runner._recorder
        if recorder is None:
            # Without a recorder, no notes are taken.
            assert not runner.is_recorded
            assert not runner._notes
        env.close()
        return None if recorder is None else recorder._address

    return address_of


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in ALWAYS else pytest.mark.nightly) for name in ENVIRONMENTS]
)
def test_an_environment_is_shown_where_it_is_said(name, address_of, monkeypatch):
    assert address_of(name) is None
    assert address_of(name, envision=True) == HERE
    assert address_of(name, envision="127.0.0.1:9") == THERE
    assert address_of(name, envision=True, simulation=Options(envision="127.0.0.1:9")) == THERE
    monkeypatch.setenv(ENVISION, "127.0.0.1:9")
    assert address_of(name) == address_of(name, envision=True) == THERE
    assert address_of(name, envision=False) is None


@pytest.mark.parametrize("name", ["HiWayEnv", "RLlibHiWayEnv"])
def test_headless_false_shows_it(name, address_of):
    assert address_of(name, headless=False) == HERE
    assert address_of(name, headless=True) is None
    assert address_of(name, headless=False, envision="127.0.0.1:9") == THERE
