"""Every stage of the step: writes only what is its own, and only in simulations that make the step."""

import dataclasses
import inspect

import numpy as np
import pytest

from smarts.sim.simulation import Simulation
from smarts.sstudio.build import build_scenario
from smarts.types.vehicles import Owner
from tests.parts import episode, simulation_of

LOCATION = {"lane", "lane_position", "lane_offset"}
IDENTITY = {"alive", "generation", "owner", "kind", "length", "width", "home"}

ACTUATORS = {f"seats.{name}" for name in ("steering", "throttle", "brake", "travelled")}


def tables(world):
    """Return every array of the world by name."""
    found = {
        f"{name}.{column}": array
        for name in ("vehicles", "before", "seats")
        for column, array in getattr(world, name).columns()
    }
    return found | {"signals": world.signals, "step": world.step}


class Guard:
    """A stage whose every call with `rows` is watched."""

    def __init__(self, part, allowed):
        self._part = part
        self._allowed = allowed

    def __getattr__(self, name):
        method = getattr(self._part, name)
        if not callable(method):
            return method
        parameters = list(inspect.signature(method).parameters)
        if name == "reset" or not {"world", "rows"} <= set(parameters):
            return method

        def watched(*arguments):
            given = dict(zip(parameters, arguments, strict=True))
            world, rows = given["world"], given["rows"]
            before = {table: array.copy() for table, array in tables(world).items()}
            result = method(*arguments)
            for table, array in tables(world).items():
                changed = array != before[table]
                assert not changed[~rows].any(), f"{name} wrote {table} of a simulation that rests"
                assert not (changed & ~self._allowed(world, table, changed)).any(), f"{name} wrote {table}"
            return result

        return watched


def nothing(world, table, changed):
    return np.zeros_like(changed)


def driving(world, table, changed):
    """Allow motion of agents' vehicles, and the actuators of their seats."""
    kind, _, column = table.partition(".")
    if kind == "vehicles" and column not in LOCATION | IDENTITY:
        return spread(world.vehicles.owner == Owner.AGENT, changed)
    return np.full_like(changed, table in ACTUATORS)


def engine(world, table, changed):
    """Allow whatever concerns vehicles of traffic, those that have just left included, and signals."""
    if table.startswith("vehicles."):
        return spread((world.vehicles.owner == Owner.TRAFFIC) | ~world.vehicles.alive, changed)
    return np.full_like(changed, table == "signals")


def spread(rows, changed):
    return np.broadcast_to(rows.reshape(*rows.shape, *[1] * (changed.ndim - 2)), changed.shape)


def columns(*names):
    return lambda world, table, changed: np.full_like(changed, table in names)


ALLOWED = {
    "controllers": columns(
        *("seats.target_lane", "seats.change_phase", "seats.effective", "vehicles.desired_speed")
    ),
    "vehicles": driving,
    "traffic": engine,
    "locator": columns(
        *(f"vehicles.{name}" for name in LOCATION),
        *(f"seats.{name}" for name in ("route_done", "remaining", "on_road", "corners_on_road", "on_route")),
        *("seats.legal", "seats.lap"),
    ),
    "contacts": nothing,
    "events": columns(
        *(f"seats.{name}" for name in ("state", "outcome", "rest_position", "rest_step")),
        *(f"seats.{name}" for name in ("off_route_since", "via_hit", "ticket", "ticket_junction")),
    ),
    "transfer_rules": nothing,
    "sensors": nothing,
}


@pytest.fixture
def watched():
    scenarios = [build_scenario("intersection")]
    simulation, actions = simulation_of(scenarios, worlds=2, egos=2)
    stages = simulation._stages
    guards = {name: Guard(getattr(stages, name), allowed) for name, allowed in ALLOWED.items()}
    guarded = Simulation(simulation.world, dataclasses.replace(stages, **guards))
    guarded.reset({row: episode(scenarios, 0, egos=2, world=row) for row in range(2)})
    yield guarded, actions
    guarded.close()


def test_stages_write_what_is_theirs(watched):
    simulation, actions = watched
    actions.values[:, :, 0] = 0.3
    for step in range(60):
        rows = np.array([True, step % 3 != 1])
        simulation.step(actions, rows, np.ones((2, 2), np.bool_))
    assert simulation.world.step.tolist() == [60, 40]
