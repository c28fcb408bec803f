"""What around the agent's vehicle other vehicles do not hide from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import OcclusionMap
from smarts.geometry.compiling import kernel
from smarts.geometry.raster import place_in_view
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, LARGEST_BOX, clipped, clipped_above
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]


@dataclass(frozen=True)
class VisibleArea:
    """A view from above: what can be seen from the middle of the own vehicle, all around.

    Of another vehicle the side that is turned this way is seen, a pixel deep; it hides what is behind.
    """

    option: OcclusionMap = field(default_factory=OcclusionMap)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        shape = (self.option.height, self.option.width, 1)
        meaning = "1 where the own vehicle can see; it is in the middle, its front towards row 0"
        return (
            Field("data", shape, np.uint8, 0, 1, "", meaning),
            Field("resolution", (), np.float32, 0, FARTHEST, "m", "side of a pixel"),
        )

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents."""
        vehicles = scene.world.vehicles
        _observe(
            agent_ids,
            observe_mask,
            scene.world.agents.slot,
            vehicles.alive,
            vehicles.position,
            vehicles.heading,
            vehicles.length,
            vehicles.width,
            self.option.resolution,
            *_lines_of_sight(self.option),
            out["data"],
        )
        out["resolution"][observe_mask] = self.option.resolution


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
        near, far = 0.0, np.inf
        for begin, step, half in ((along, dx, 0.5 * length), (across, dy, 0.5 * width)):
            if step == 0.0:
                if abs(begin) > half:
                    far = -1.0
            else:
                one, other = (-half - begin) / step, (half - begin) / step
                near, far = max(near, min(one, other)), min(far, max(one, other))
        if near <= far:
            ray = number % rays
            reach[ray] = min(reach[ray], near)


@kernel
def _observe(
    agent_ids: Ints,
    observe_mask: Bools,
    slots: Ints,
    alive: Bools,
    position: Floats,
    heading: Floats,
    length: Floats,
    width: Floats,
    resolution: float,
    ray: Ints,
    distance: Floats,
    views: Pixels,
) -> None:
    rows, columns = ray.shape
    reach = np.empty(_rays(rows, columns))
    corner = 0.5 * resolution * math.hypot(rows, columns)
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            own = slots[b, agent_ids[g]]
            x, y = clipped(position[b, own, 0], FARTHEST), clipped(position[b, own, 1], FARTHEST)
            direction = clipped(heading[b, own], math.pi)
            reach[:] = np.inf
            for v in range(alive.shape[1]):
                if not alive[b, v] or v == own:
                    continue
                long = clipped_above(length[b, v], LARGEST_BOX)
                wide = clipped_above(width[b, v], LARGEST_BOX)
                ahead, aside = place_in_view(position[b, v, 0], position[b, v, 1], x, y, direction)
                if math.hypot(ahead, aside) <= corner + 0.5 * math.hypot(long, wide):
                    _shade(reach, ahead, aside, clipped(heading[b, v], math.pi) - direction, long, wide)
            for row in range(rows):
                for column in range(columns):
                    free = reach[ray[row, column]] + resolution
                    views[b, g, row, column, 0] = distance[row, column] <= free
