"""The scene around the agent's vehicle in colour, from above."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from smarts.agents.options import RGB
from smarts.arrays import Pixels
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.levels import meets
from smarts.roads.scene import Scene
from smarts.sensors.grid_map import GridOut, PictureSensor, grid_fields, paint_vehicle, viewer
from smarts.sensors.road_raster import CENTRE_LINE, DIVIDER, PATH, ROAD, paint_road, road_raster
from smarts.types.colors import SceneColors
from smarts.types.interface import Field
from smarts.types.vehicles import Owner
from smarts.types.world import State

_AGENT = int(Owner.AGENT)
_GROUND = (26, 32, 26)
_WALK = (52, 52, 48)
FINE = 0.4
"""Side of the largest pixels that show lines [m]: of lines finer than a pixel only specks would be left."""


def _levels(colour: SceneColors) -> list[int]:
    return [round(255 * channel) for channel in colour.value[:3]]


def road_colours(
    centre_line: object, divider: object, road: object, path: object, ground: object, *, lines: bool
) -> Pixels:
    """Return the colour of each combination of a cell's bits, shape (16, channels).

    Args:
        centre_line: Its levels, one for each channel.
        divider: Of the line between lanes.
        road: Of lanes and junctions.
        path: Of sidewalks, bicycle lanes and shoulders.
        ground: Of everything else.
        lines: Whether lines are drawn.
    """
    layers = [(CENTRE_LINE, centre_line), (DIVIDER, divider), (ROAD, road), (PATH, path)]
    drawn = layers if lines else layers[2:]
    levels = [next((level for bit, level in drawn if bits & bit), ground) for bits in range(16)]
    return np.array(levels, np.uint8)


@cache
def _colours(*, lines: bool) -> Pixels:
    line, divider = _levels(SceneColors.EdgeDivider), _levels(SceneColors.LaneDivider)
    return road_colours(line, divider, _levels(SceneColors.Road), _WALK, _GROUND, lines=lines)


@cache
def _vehicle_colours() -> Pixels:
    """Return the colours of traffic, of other agents, and of the own vehicle, shape (3, 3)."""
    kinds = (SceneColors.SocialVehicle, SceneColors.SocialAgent, SceneColors.Agent)
    return np.array([_levels(kind) for kind in kinds], np.uint8)


@dataclass(frozen=True)
class TopDownRgb(PictureSensor):
    """A view from above: road with its markings, traffic, agents, and the own vehicle in red."""

    option: RGB = field(default_factory=RGB)

    def fields(self) -> tuple[Field, ...]:
        """Return the fields."""
        meaning = "red, green, blue; the own vehicle in the middle, its front towards row 0"
        return grid_fields(self.option.height, self.option.width, 3, 255, meaning)

    def known(self, scene: Scene) -> tuple[Any, ...]:
        """Return what the kernel needs besides the state."""
        resolution = float(self.option.resolution)
        colours = _colours(lines=resolution <= FINE), _vehicle_colours()
        return ((resolution, *colours, road_raster(scene.atlas)),)

    @staticmethod
    @kernel
    def write(
        state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: GridOut, known: Any
    ) -> None:
        """Paint road and vehicles around an agent; see `KernelSensor`.

        `road` is the result of `road_colours`; `boxes` are the colours of traffic, of other agents, and of
        the own vehicle, shape (3, channels).
        """
        resolution, road, boxes, raster = known
        vehicles, own = state.vehicles, state.agents.slot[b, a]
        x, y, heading = viewer(vehicles, b, own)
        view = out.data[b, g]
        paint_road(raster, state.map[b], x, y, heading, resolution, road, view)
        for v in range(vehicles.alive.shape[1]):
            if v == own or meets(vehicles, b, own, v):
                kind = 2 if v == own else 1 if vehicles.owner[b, v] == _AGENT else 0
                paint_vehicle(vehicles, b, v, x, y, heading, resolution, boxes[kind], view)
        out.resolution[b, g] = resolution
