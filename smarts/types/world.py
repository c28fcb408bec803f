"""The world: the state of B simulations as arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Floats, Ints, Longs
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.types.agent_states import AgentStates
from smarts.types.guidance import Guidance
from smarts.types.mission import Missions
from smarts.types.planned_routes import PlannedRoutes
from smarts.types.vehicle_registry import VehicleRegistry
from smarts.types.vehicles import VehicleStates

Columns = tuple[NDArray[np.uint8], ...]


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
    used: Ints
    """How many slots, the first ones, have held a vehicle in the episode, shape (B,)."""
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
        self.vehicles = VehicleStates.allocate(worlds, capacity)
        self.before = VehicleStates.allocate(worlds, capacity)
        self.registry = VehicleRegistry(self.vehicles)
        """Issues slots and names."""
        self.state = State(
            dt=dt,
            step=np.zeros(worlds, np.int32),
            episode=np.zeros(worlds, np.int32),
            map=np.zeros(worlds, np.int32),
            used=self.registry.used,
            vehicles=self.vehicles,
            before=self.before,
            agents=AgentStates.allocate(worlds, agents, vias),
            missions=Missions.allocate(worlds, agents, vias),
            guidance=Guidance.allocate(worlds, agents),
            signals=np.zeros((worlds, lanes), np.int8),
        )
        self.dt, self.step, self.episode, self.map = dt, self.state.step, self.state.episode, self.state.map
        self.agents = self.state.agents
        self.missions, self.guidance, self.signals = (
            self.state.missions,
            self.state.guidance,
            self.state.signals,
        )
        self.routes = PlannedRoutes(worlds)
        """The routes that `vehicles.route` and `missions.route` number."""
        self.route_place = np.zeros((worlds, capacity), np.int32)
        """Where `vehicles.next_edge` is on each vehicle's route, its length at its end: a route may use an
        edge twice. Not for vehicles without a route. Shape (B, V)."""
        self.placed = np.zeros((worlds, capacity), np.bool_)
        """Vehicles whose lane, and places along and beside it, their provider has written in this step: they
        are not searched for. Map matching clears it. Shape (B, V)."""
        self.paths: list[dict[tuple[int, int], Floats]] = [{} for _ in range(worlds)]
        """Points x, y, heading, arc length of the paths that vehicles were recorded on, shape (n, 4), of each
        simulation by slot and generation."""
        self.traffic_overlaps = np.zeros(worlds, np.int32)
        """Pairs of vehicles of traffic that have come to overlap in the episode, shape (B,)."""
        sizes = np.array([column[:1, :1].nbytes for column in self.vehicles])
        now, before = (
            tuple(column.view(np.uint8).reshape(worlds, -1) for column in states)
            for states in (self.vehicles, self.before)
        )
        self._keep = bind(keep_past, now, before, sizes, self.registry.used)

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
        self._keep(env_mask)
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
        self.paths[row].clear()

    def settle(self, row: int) -> None:
        """End the reset of one simulation: nothing has moved before its first step."""
        for now, before in zip(self.vehicles, self.before, strict=True):
            before[row] = now[row]


@kernel
def keep_past(now: Columns, before: Columns, sizes: Longs, used: Ints, env_mask: Bools) -> None:
    """Copy the used slots of some simulations.

    Args:
        now: The columns of K quantities, shape (B, bytes) each.
        before: The same, written.
        sizes: Bytes of a slot, shape (K,).
        used: Slots that are in use, shape (B,).
        env_mask: The simulations, shape (B,).
    """
    for b in np.flatnonzero(env_mask):
        for column in range(len(sizes)):
            source, target = now[column], before[column]
            for place in range(used[b] * sizes[column]):
                target[b, place] = source[b, place]
