"""Every stage of the step: writes only what is its own, and only in simulations that make the step."""

import dataclasses
import inspect

import numpy as np
import pytest

from smarts.agents import AgentInterface
from smarts.sim.assembly import assemble
from smarts.sim.simulation import Simulation
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.guidance import Guidance
from smarts.types.vehicles import Owner

LOCATION = {"lane", "lane_position", "lane_offset"}
IDENTITY = {"alive", "generation", "owner", "kind", "length", "width", "home"}

ACTUATORS = {f"agents.{name}" for name in ("steering", "throttle", "brake", "distance_travelled")}


def tables(world):
    """Return every array of the world by name."""
    found = {
        f"{name}.{column}": array
        for name in ("vehicles", "before", "agents")
        for column, array in getattr(world, name)._asdict().items()
    }
    guidance = {f"guidance.{name}": array for name, array in world.guidance._asdict().items()}
    return found | guidance | {"signals": world.signals, "step": world.step}


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
        if name == "reset" or "world" not in parameters or not {"rows", "wanted"} & set(parameters):
            return method

        def watched(*arguments):
            given = dict(zip(parameters, arguments, strict=True))
            world = given["world"]
            rows = given["rows"] if "rows" in given else given["wanted"].any(axis=1)
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
    """Allow motion of agents' vehicles, and the actuators of their agents."""
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
        *("agents.target_lane", "agents.change_phase", "agents.effective", "vehicles.desired_speed")
    ),
    "vehicles": driving,
    "traffic": engine,
    "matcher": columns(
        *(f"vehicles.{name}" for name in LOCATION),
        *(
            f"agents.{name}"
            for name in ("route_progress", "remaining", "on_road", "corners_on_road", "on_route")
        ),
        *("agents.action_mask", "agents.lap", "agents.lane_changes"),
        *(f"guidance.{name}" for name in Guidance._fields),
    ),
    "contacts": nothing,
    "events": columns(
        *(f"agents.{name}" for name in ("state", "outcome", "last_moved_position", "last_moved_step")),
        *(f"agents.{name}" for name in ("off_route_since", "via_hit", "arrival_number", "arrival_junction")),
    ),
    "transfer_rules": nothing,
    "sensors": nothing,
}


INTERFACES = [
    AgentInterface(
        waypoint_paths=True,
        neighborhood_vehicle_states=True,
        road_waypoints=True,
        occupancy_grid_map=True,
        action=action,
        vehicle_model=model,
        max_episode_steps=40,
    )
    for action, model in (
        (ActionSpaceType.Lane, "bullet"),
        (ActionSpaceType.Continuous, "kinematic"),
        (ActionSpaceType.LaneWithContinuousSpeed, "dynamic"),
    )
]


@pytest.fixture
def watched():
    parts = assemble([build_scenario("intersection")], INTERFACES, worlds=2)
    stages = parts.simulation._stages
    guards = {name: Guard(getattr(stages, name), allowed) for name, allowed in ALLOWED.items()}
    guarded = Simulation(parts.simulation.world, dataclasses.replace(stages, **guards))
    guarded.reset({row: parts.schedule.start(row, row) for row in range(2)})
    yield guarded, parts
    guarded.close()


def test_stages_write_what_is_theirs(watched):
    simulation, parts = watched
    actions, world, number = parts.actions, simulation.world, 0
    steps = [0, 0]
    for step in range(90):
        rows = np.array([True, step % 3 != 1])
        actions.given[:] = step > 2
        actions.fresh[:] = step % 5 == 0
        actions.action_mask[:] = world.agents.action_mask
        actions.values[:, 0, 0] = step // 5 % 4
        actions.values[:, 1, :3] = 0.4, 0.0, 0.1 * (step % 3 - 1)
        actions.values[:, 2, :2] = 6.0, step // 5 % 3 - 1
        frame = simulation.step(actions, rows, np.ones((2, 3), np.bool_))
        steps = [count + int(here) for count, here in zip(steps, rows, strict=True)]
        assert world.step.tolist() == steps
        for row in np.flatnonzero(frame.events.finished).tolist():
            number += 1
            steps[row] = 0
            simulation.reset({row: parts.schedule.start(row, number + 1)})
    assert number >= 2
