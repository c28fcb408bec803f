"""What a sensor is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from types import FunctionType
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Ints
from smarts.errors import OwnCodeError
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.scene import Scene
from smarts.types.interface import Field

Triple = tuple[float, float, float]

Readings = Mapping[str, NDArray]
"""One agent's readings of one sensor, by field."""


class Seen(Protocol):
    """The observation under construction; see `smarts.sensors.observation.Observation`."""

    graph: LaneGraph
    """The map."""
    name: str
    """Name of the agent's vehicle."""
    neighbors: Sequence[str]
    """Names of the vehicles in `neighborhood_vehicle_states`."""

    def lane_ids(self, lane: int) -> tuple[str, str]:
        """Return the ids of a lane's road and of the lane, by its number in the map; empty for -1."""
        ...

    def __getattr__(self, name: str) -> Any:
        """Return another sensor's attribute, None if the agent does not have the sensor."""
        ...


class Sensor(Protocol):
    """Measures something for agents of all simulations at once.

    A sensor is a frozen dataclass, made from its option in the agent's interface; agents with equal options
    share it. It is stateless: earlier state is in `world.before` and in the agents' states. Entries of lists
    (vehicles, paths, points) beyond their count are zero.
    """

    def fields(self) -> tuple[Field, ...]:
        """Return the fields that it writes; values lie within their bounds in every state."""
        ...

    def bind(self, scene: Scene, agent_ids: Ints, out: Readings) -> Callable[[Bools], object]:
        """Return the function that observes: called with `observe_mask`, it writes those agents' readings.

        Entries of agents that are not in the mask stay as they are.

        Args:
            scene: The state that is observed; its arrays are the same in every step.
            agent_ids: The agents that have this sensor, shape (G,).
            out: Array of each field, shape (B, G, *shape). The mask has the shape (B, G); each agent in it
                has a vehicle.
        """
        ...

    @staticmethod
    def as_object(readings: Readings, seen: Seen) -> Any:
        """Return one agent's readings as the attribute of `Observation` that has the sensor's name.

        Args:
            readings: A copy of the agent's entries.
            seen: The observation: names of vehicles and lanes, and the other sensors' attributes.
        """
        ...


class KernelSensor:
    """The `bind` of a sensor with a kernel `write` for one agent; the loop over agents is compiled around it.

    A subclass is a `Sensor`. Its static method `write` is a kernel, called with

    - `state`, `roads`, `routes`: all arrays of the simulations, the maps and the agents' routes,
    - `b`, `g`, `a`: the simulation, the agent's place among those that have the sensor, and its row of
      `state.agents`; `state.agents.slot[b, a]` is its vehicle,
    - `out`: `arrays` of the fields' arrays, shape (B, G, ...); it writes their entries [b, g],
    - what `known` returns.
    """

    arrays: ClassVar[type]
    """A named tuple of arrays with the fields' names, in any order."""
    write: ClassVar[Callable[..., Any]]

    def known(self, scene: Scene) -> tuple[Any, ...]:
        """Return further arguments of `write`: numbers, arrays, among them room to work in, named tuples."""
        return ()

    def bind(self, scene: Scene, agent_ids: Ints, out: Readings) -> Callable[[Bools], object]:
        """Return the function that observes; see `Sensor.bind`."""
        return bind_write(self.write, scene, agent_ids, self.arrays(**out), *self.known(scene))


def bind_write(write: Any, scene: Scene, agent_ids: Ints, out: Any, *known: Any) -> Callable[[Bools], object]:
    """Return the function that calls a kernel for each agent in its mask.

    Args:
        write: The kernel; see `KernelSensor`.
        scene: What is observed.
        agent_ids: The agents, shape (G,).
        out: A named tuple of whole arrays; or an array, of which the kernel gets the agent's entry [b, g].
        known: Further arguments of the kernel.
    """
    state = scene.world.state, scene.atlas.roads, scene.routes.current, agent_ids
    loop = _loop_of_entries if isinstance(out, np.ndarray) else _loop
    return bind(looped(loop, write), *state, (out, *known))


@cache
def looped(loop: FunctionType, write: Any) -> Any:
    """Return a kernel of a loop that calls a kernel.

    Args:
        loop: A function that calls a global `write`.
        write: The kernel that this stands for.

    Raises:
        OwnCodeError: `write` is not a kernel.
    """
    target = getattr(write, "py_func", None)
    if target is None:
        raise OwnCodeError(
            f"{write.__qualname__} is not a kernel",
            place=f"{write.__code__.co_filename}:{write.__code__.co_firstlineno}",
            remedy="give the class a static method `write` with the decorator @kernel, or a method `bind`",
        )
    made = FunctionType(loop.__code__, {"write": write, "range": range, "__name__": target.__module__})
    made.__module__ = target.__module__
    made.__qualname__ = f"each_{target.__qualname__}"
    return kernel(made)


def _loop(state: Any, roads: Any, routes: Any, agent_ids: Any, others: Any, observe_mask: Any) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                write(state, roads, routes, b, g, agent_ids[g], *others)  # type: ignore[name-defined]  # noqa: F821


def _loop_of_entries(
    state: Any, roads: Any, routes: Any, agent_ids: Any, others: Any, observe_mask: Any
) -> None:
    out, known = others[0], others[1:]
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                write(state, roads, routes, b, g, agent_ids[g], out[b, g], *known)  # type: ignore[name-defined]  # noqa: F821


def triple(values: NDArray) -> Triple:
    """Return the components of a vector in the plane or in space."""
    x, y, *rest = values.tolist()
    return x, y, rest[0] if rest else 0.0
