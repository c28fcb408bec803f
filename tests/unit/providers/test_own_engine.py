"""Users' own traffic engines: what they raise, return and write is checked, and named with file and line."""

from typing import Any

import numpy as np
import pytest

from smarts.errors import OwnCodeError, TrafficError
from smarts.providers.traffic_engine import KeepsVehicles
from smarts.providers.traffic_engines import traffic_of
from smarts.registry import import_own
from smarts.types.traffic import TRAFFIC_ENGINES
from smarts.types.transfers import Refusal
from smarts.types.world import World
from tests.raising import raises

ENGINE = """
import numpy as np
from smarts.errors import TrafficError
from smarts.types.vehicles import Owner, VehicleKind

class Mine:
    def __init__(self, world, maps, owner=Owner.TRAFFIC):
        self.failures, self.is_full = {}, np.zeros(world.worlds, np.bool_)
        self.world = world

    def reset(self, starts):
        for row in starts:
            self.world.registry.admit(row, "car", Owner.TRAFFIC, VehicleKind.PASSENGER, length=5.0, width=1.8)

    def step(self, env_mask):
        pass

    def can_accept(self, rows, slots):
        return np.full(len(rows), 1, np.int8)

    def close(self):
        pass

class Made(Mine):
    def __init__(self, world, maps):
        raise KeyError("flow")

class Infinite(Mine):
    def step(self, env_mask):
        self.world.vehicles.position[1, 0, 1] = np.inf

class Fails(Mine):
    def step(self, env_mask):
        self.world.vehicles.speed[0] = np.nan
        self.failures = {0: TrafficError("the traffic failed")}

class Releases(Mine):
    def can_release(self, rows, slots):
        raise KeyError("slot")
"""


@pytest.fixture
def make(tmp_path, monkeypatch):
    """Return the traffic of a class, its file, and the world."""
    file = tmp_path / f"{tmp_path.name}.py"
    file.write_text(ENGINE)
    import_own([file])
    monkeypatch.setattr(TRAFFIC_ENGINES, "_own", {})

    def make(name) -> tuple[Any, World]:
        world = World(worlds=2, capacity=4, agents=1, lanes=1)
        return traffic_of([f"{file.stem}:{name}"], world, []), world

    make.file = file  # type: ignore[attr-defined]
    return make


def play(engine, world):
    """Reset, step and ask an engine."""
    starts: Any = {0: None, 1: None}
    engine.reset(starts)
    engine.step(np.ones(world.worlds, np.bool_))
    engine.can_accept(np.array([0]), np.array([0]))
    if isinstance(engine, KeepsVehicles):
        engine.can_release(np.array([0]), np.array([0]))


@pytest.mark.parametrize(
    ("name", "line", "said"),
    [
        ("Made", "raise KeyError", "KeyError: 'flow'"),
        ("Infinite", "class Infinite", "speed of a vehicle are [0.0, inf, 0.0, 0.0]"),
        ("Releases", "class Releases", "KeyError: 'slot'"),
    ],
)
def test_mistakes_are_errors_with_engine_key_file_and_line(make, name, line, said):
    lines = ENGINE.splitlines()
    number = next(number for number, each in enumerate(lines, 1) if line in each)
    number += {"Infinite": 1, "Releases": 2}.get(name, 0)
    values = [f"'{make.file.stem}:{name}'", "traffic_engine", said]
    with raises(OwnCodeError, f"{make.file}:{number}", values=values):
        play(*make(name))


def test_an_engine_that_keeps_the_protocol_is_taken(make):
    engine, world = make("Mine")
    play(engine, world)
    assert not isinstance(engine, KeepsVehicles)
    assert engine.can_accept(np.zeros(3, int), np.zeros(3, int)).tolist() == [Refusal.OFF_LANES] * 3
    assert world.vehicles.alive.sum(axis=1).tolist() == [1, 1]
    engine.close()


def test_failures_of_an_engine_are_the_simulations(make):
    engine, world = make("Fails")
    play(engine, world)
    assert [*engine.failures] == [0]
    assert isinstance(engine.failures[0], TrafficError)
