"""What the judges of events read and write, as tuples of arrays for their kernels.

Axis letters: B simulations, A agents, V vehicle slots, W via points, L lanes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import find_row
from smarts.roads.scene import Scene
from smarts.sim.columns import columns_of
from smarts.sim.lane_facts import LaneFacts, lane_facts

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]

STANDING = 0.5
"""Below this a vehicle stands [m/s]."""


class Places(NamedTuple):
    """Where vehicles are: columns of `VehicleStates`, shape (B, V)."""

    alive: Bools
    generation: Ints
    position: Floats
    heading: Floats
    speed: Floats
    length: Floats
    width: Floats
    lane: Ints
    lane_position: Floats
    lane_offset: Floats


class Memory(NamedTuple):
    """What is known of agents: columns of `AgentStates`, shape (B, A)."""

    state: Bytes
    slot: Ints
    entry_step: Ints
    outcome: Bytes
    route_progress: Floats
    lap: NDArray[np.int16]
    on_road: Bools
    corners_on_road: Bytes
    on_route: Bools
    last_moved_position: Floats
    last_moved_step: Ints
    off_route_since: Ints
    via_hit: Bools
    arrival_number: Ints
    arrival_junction: Ints


class Goals(NamedTuple):
    """What agents are to do: columns of `Missions`, shape (B, A)."""

    goal: Bytes
    goal_position: Floats
    goal_radius: Floats
    goal_lane: Ints
    goal_s: Floats
    laps: NDArray[np.int16]
    via_count: Bytes
    via_position: Floats
    via_radius: Floats


class State(NamedTuple):
    """All that is judged by, but for the table of routes, which changes."""

    step: Ints
    """Shape (B,)."""
    map: Ints
    """Shape (B,)."""
    signals: Bytes
    """Shape (B, L)."""
    now: Places
    before: Places
    agents: Memory
    goals: Goals
    laps_before: NDArray[np.int16]
    """`AgentStates.lap` one step ago, shape (B, A)."""
    route: Ints
    """Number in the table of routes, shape (B, A)."""
    roads: Roads
    lanes: LaneFacts


def state_of(scene: Scene) -> State:
    """Return the arrays of a scene; they hold for good."""
    world = scene.world
    return State(
        step=world.step,
        map=world.map,
        signals=world.signals,
        now=columns_of(world.vehicles, Places),
        before=columns_of(world.before, Places),
        agents=columns_of(world.agents, Memory),
        goals=columns_of(world.missions, Goals),
        laps_before=world.agents.lap.copy(),
        route=scene.routes.number,
        roads=scene.atlas.roads,
        lanes=lane_facts(scene.atlas),
    )


@kernel
def lane_of(state: State, places: Places, row: int, slot: int) -> int:
    """Return the vehicle's lane, numbered across all maps; -1 without one."""
    lane = places.lane[row, slot]
    return state.roads.lane_base[state.map[row]] + lane if lane >= 0 else -1


@kernel
def corridor_row(state: State, table: RouteTable, row: int, agent_id: int, lane: int) -> int:
    """Return the row of a lane in the agent's route, where the agent is along it; -1 off the route."""
    if lane < 0 or state.route[row, agent_id] < 0:
        return -1
    corridor = table.free + state.route[row, agent_id]
    return find_row(table, corridor, lane, state.agents.route_progress[row, agent_id])
