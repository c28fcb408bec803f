"""The world: the state of B simulations as arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.types.agent_states import AgentStates
from smarts.types.guidance import Guidance
from smarts.types.mission import Missions
from smarts.types.planned_routes import PlannedRoutes
from smarts.types.vehicle_registry import VehicleRegistry
from smarts.types.vehicles import VehicleStates


class State(NamedTuple):
    """All arrays of B simulations, for kernels: `bind(function, world.state, ...)`."""

    dt: float
    """Length of a step [s]."""
    step: Ints
    """Steps since the episode began, shape (B,)."""
    episode: Ints
    """Number of the episode, shape (B,)."""
    map: Ints
    """Number of the map in the atlas, shape (B,)."""
    vehicles: VehicleStates
    """The vehicles now, shape (B, V)."""
    before: VehicleStates
    """The vehicles one step ago; a row whose generation differs from now was another vehicle."""
    agents: AgentStates
    """Shape (B, A)."""
    missions: Missions
    """Shape (B, A)."""
    guidance: Guidance
    """Guidance of the missions' tasks, shape (B, A)."""
    signals: Bytes
    """What each lane's light shows, a `Signal`, shape (B, L)."""


class World:
    """B simulations side by side. Row b of every array is simulation b, independent of the others.

    The arrays are written in place by the stages of the step and never replaced, so views of them stay
    valid. A part that needs more of the past than one step keeps it itself. `state` holds all arrays, for
    kernels; each is an attribute of the world, too.

    Args:
        worlds: B.
        capacity: V, the slots for vehicles of each simulation.
        agents: A, the agents of each simulation.
        lanes: The lanes of the largest map.
        egos: How many of the agents, the first ones, are the learning agents'.
        vias: W, the most via points of a mission.
        dt: Length of a step [s].
    """

    def __init__(
        self,
        *,
        worlds: int,
        capacity: int,
        agents: int,
        lanes: int,
        egos: int | None = None,
        vias: int = 0,
        dt: float = 0.1,
    ) -> None:
        self.egos = agents if egos is None else egos
        self._now, vehicles = _in_one_block(VehicleStates.allocate(worlds, capacity))
        self._before, before = _in_one_block(VehicleStates.allocate(worlds, capacity))
        self.state = State(
            dt=dt,
            step=np.zeros(worlds, np.int32),
            episode=np.zeros(worlds, np.int32),
            map=np.zeros(worlds, np.int32),
            vehicles=vehicles,
            before=before,
            agents=AgentStates.allocate(worlds, agents, vias),
            missions=Missions.allocate(worlds, agents, vias),
            guidance=Guidance.allocate(worlds, agents),
            signals=np.zeros((worlds, lanes), np.int8),
        )
        self.dt, self.step, self.episode, self.map = dt, self.state.step, self.state.episode, self.state.map
        self.vehicles, self.before, self.agents = vehicles, before, self.state.agents
        self.missions, self.guidance, self.signals = (
            self.state.missions,
            self.state.guidance,
            self.state.signals,
        )
        self.registry = VehicleRegistry(self.vehicles)
        """Issues slots and names."""
        self.routes = PlannedRoutes(worlds)
        """The routes that `vehicles.route` and `missions.route` number."""
        self.route_place = np.zeros((worlds, capacity), np.int32)
        """Where `vehicles.next_edge` is on each vehicle's route, its length at its end: a route may use an
        edge twice. Not for vehicles without a route. Shape (B, V)."""
        self.traffic_overlaps = np.zeros(worlds, np.int32)
        """Pairs of vehicles of traffic that have come to overlap in the episode, shape (B,)."""
        self._pairs = list(zip(self.vehicles, self.before, strict=True))

    @property
    def worlds(self) -> int:
        """B."""
        return len(self.step)

    @property
    def time(self) -> Floats:
        """Time of each episode [s], shape (B,)."""
        return np.multiply(self.step, self.dt, dtype=np.float64)

    def advance(self, env_mask: Bools) -> None:
        """Begin a step of some simulations: what is now becomes what was, and stays until written."""
        if np.count_nonzero(env_mask) == len(env_mask):
            self._before[:] = self._now
        else:
            for now, before in self._pairs:
                before[env_mask] = now[env_mask]
        self.step += env_mask

    def clear(self, row: int) -> None:
        """Empty one simulation for an episode, down to the generations."""
        self.registry.reset(row)
        self.routes.reset(row)
        self.before.clear((row, slice(None)))
        self.before.generation[row] = 0
        self.agents.clear(row)
        self.missions.clear(row)
        self.guidance.clear(row)
        self.signals[row] = 0
        self.step[row] = 0
        self.traffic_overlaps[row] = 0

    def settle(self, row: int) -> None:
        """End the reset of one simulation: nothing has moved before its first step."""
        for now, before in self._pairs:
            before[row] = now[row]


def _in_one_block(states: VehicleStates) -> tuple[NDArray[np.uint8], VehicleStates]:
    """Return a block of memory and the same states in it: one copy is cheaper than twenty."""
    # Each column begins on a cache line of its own.
    ends = np.cumsum([-(-column.nbytes // 64) * 64 for column in states]).tolist()
    block = np.zeros(ends[-1], np.uint8)
    moved = []
    for column, begin in zip(states, [0, *ends], strict=False):
        moved.append(block[begin : begin + column.nbytes].view(column.dtype).reshape(column.shape))
        moved[-1][...] = column
    return block, VehicleStates._make(moved)
