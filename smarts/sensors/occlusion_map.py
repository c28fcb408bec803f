"""Grid of the area that other vehicles do not hide from the agent's vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from smarts.agents.options import OcclusionMap
from smarts.arrays import Floats, Ints
from smarts.geometry.boxes import slab
from smarts.geometry.compiling import kernel
from smarts.geometry.raster import place_in_view
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.levels import meets
from smarts.roads.scene import Scene
from smarts.sensors.bounds import LARGEST_BOX, clipped, clipped_above
from smarts.sensors.grid_map import GridOut, PictureSensor, grid_fields, viewer
from smarts.types.interface import Field
from smarts.types.world import State


@dataclass(frozen=True)
class VisibleArea(PictureSensor):
    """A view from above: what can be seen from the middle of the own vehicle, all around.

    Of another vehicle the side that is turned this way is seen, a pixel deep; it hides what is behind.
    """

    option: OcclusionMap = field(default_factory=OcclusionMap)

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        meaning = "1 where the own vehicle can see; it is in the middle, its front towards row 0"
        return grid_fields(self.option.height, self.option.width, 1, 1, meaning)

    def known(self, scene: Scene) -> tuple[Any, ...]:
        """Return what the kernel needs besides the state."""
        ray, distance = _lines_of_sight(self.option)
        return ((float(self.option.resolution), ray, distance, np.empty(_rays(*ray.shape))),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: GridOut, known: Any
    ) -> None:
        """Write an agent's readings; see `KernelSensor`."""
        resolution, ray, distance, reach = known
        rows, columns = ray.shape
        corner = 0.5 * resolution * math.hypot(rows, columns)
        vehicles, position = state.vehicles, state.vehicles.position
        own = state.agents.slot[b, a]
        x, y, heading = viewer(vehicles, b, own)
        reach[:] = np.inf
        for v in range(vehicles.alive.shape[1]):
            if not meets(vehicles, b, own, v):
                continue
            long = clipped_above(vehicles.length[b, v], LARGEST_BOX)
            wide = clipped_above(vehicles.width[b, v], LARGEST_BOX)
            ahead, aside = place_in_view(position[b, v, 0], position[b, v, 1], x, y, heading)
            if math.hypot(ahead, aside) <= corner + 0.5 * math.hypot(long, wide):
                turn = clipped(vehicles.heading[b, v], math.pi) - heading
                _shade(reach, ahead, aside, turn, long, wide)
        for row in range(rows):
            for column in range(columns):
                free = reach[ray[row, column]] + resolution
                out.data[b, g, row, column, 0] = distance[row, column] <= free
        out.resolution[b, g] = resolution


@lru_cache(maxsize=8)
def _lines_of_sight(option: OcclusionMap) -> tuple[Ints, Floats]:
    """Return the ray that leads from the viewer to each pixel, and its length [m], shape (height, width)."""
    ahead = (0.5 * option.height - np.arange(option.height) - 0.5)[:, None] * option.resolution
    aside = (0.5 * option.width - np.arange(option.width) - 0.5)[None, :] * option.resolution
    rays = _rays(option.height, option.width)
    number = (np.arctan2(aside, ahead) + np.pi) / (2 * np.pi) * rays
    return np.minimum(number.astype(np.int32), rays - 1), np.hypot(ahead, aside)


@kernel
def _rays(rows: int, columns: int) -> int:
    """Return how many rays it takes for them to be about a pixel apart at the farthest corner."""
    return 4 * (rows + columns)


@kernel
def _shade(reach: Floats, ahead: float, aside: float, turn: float, length: float, width: float) -> None:
    """Shorten the rays around the viewer that meet a box.

    `reach` [m] is how far each ray goes, at equal angles counter-clockwise from behind.
    """
    cosine, sine = math.cos(turn), math.sin(turn)
    # The viewer in the frame of the box.
    along, across = -(ahead * cosine + aside * sine), ahead * sine - aside * cosine
    if abs(along) <= 0.5 * length and abs(across) <= 0.5 * width:
        return
    rays = len(reach)
    middle = math.atan2(aside, ahead)
    distance = math.hypot(ahead, aside)
    radius = 0.5 * math.hypot(length, width)
    spread = math.pi if distance <= radius else math.asin(radius / distance)
    first = math.floor((middle - spread + math.pi) / (2.0 * math.pi) * rays)
    last = math.ceil((middle + spread + math.pi) / (2.0 * math.pi) * rays)
    for number in range(first, min(last, first + rays - 1) + 1):
        angle = (number + 0.5) * 2.0 * math.pi / rays - math.pi - turn
        dx, dy = math.cos(angle), math.sin(angle)
        near_along, far_along = slab(along, dx, -0.5 * length, 0.5 * length)
        near_across, far_across = slab(across, dy, -0.5 * width, 0.5 * width)
        near = max(0.0, near_along, near_across)
        if near <= min(far_along, far_across):
            ray = number % rays
            reach[ray] = min(reach[ray], near)
