"""Every stage of the step writes only its own arrays, and only in simulations that are stepped."""

import dataclasses

import numpy as np
import pytest

from smarts.agents import AgentInterface
from smarts.sim.assembly import assemble
from smarts.sim.simulation import Simulation
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.guidance import Guidance
from smarts.types.vehicles import Owner

LOCATION = {"lane", "lane_position", "lane_offset", "next_edge", "standing_since"}
IDENTITY = {"alive", "generation", "owner", "kind", "length", "width", "home"}

ACTUATORS = {f"agents.{name}" for name in ("steering", "throttle", "brake", "distance_travelled")}

METHODS = {"command", "step", "match", "find", "detect", "propose", "observe"}
"""Methods of stages whose last argument is a mask of simulations, or of agents to observe."""


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
    """A stage whose calls with a mask of simulations are checked."""

    def __init__(self, world, part, allowed):
        self._world = world
        self._part = part
        self._allowed = allowed
        self.calls = 0

    def __getattr__(self, name):
        method = getattr(self._part, name)
        if not callable(method):
            return method
        if name not in METHODS:
            return method

        def checked(*arguments):
            self.calls += 1
            world, mask = self._world, arguments[-1]
            rows = mask if mask.ndim == 1 else mask.any(axis=1)
            before = {table: array.copy() for table, array in tables(world).items()}
            result = method(*arguments)
            for table, array in tables(world).items():
                changed = array != before[table]
                assert not changed[~rows].any(), f"{name} wrote {table} of a simulation that is not stepped"
                assert not (changed & ~self._allowed(world, table, changed)).any(), f"{name} wrote {table}"
            return result

        return checked


def nothing(world, table, changed):
    return np.zeros_like(changed)


def driving(world, table, changed):
    """Allow the motion of agents' vehicles, and the agents' actuators."""
    kind, _, column = table.partition(".")
    if kind == "vehicles" and column not in LOCATION | IDENTITY:
        return spread(world.vehicles.owner == Owner.AGENT, changed)
    return np.full_like(changed, table in ACTUATORS)


def engine(world, table, changed):
    """Allow all columns of traffic vehicles, including vehicles that have just left, and signals."""
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
def guarded():
    parts = assemble([build_scenario("intersection")], INTERFACES, worlds=2)
    stages = parts.simulation._stages
    world = parts.simulation.world
    guards = {name: Guard(world, getattr(stages, name), allowed) for name, allowed in ALLOWED.items()}
    simulation = Simulation(world, dataclasses.replace(stages, **guards))
    simulation.reset({row: parts.schedule.start(row, row) for row in range(2)})
    yield simulation, parts, guards
    simulation.close()


def test_stages_write_only_their_own_arrays(guarded):
    simulation, parts, guards = guarded
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
    assert all(guard.calls >= 90 for guard in guards.values())
