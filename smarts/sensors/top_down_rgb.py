"""The scene around the agent's vehicle in colour, from above."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import RGB
from smarts.geometry.compiling import kernel
from smarts.geometry.raster import cut_view, paint_box, place_in_view
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, LARGEST_BOX, clipped, clipped_above
from smarts.sensors.road_raster import CENTRE_LINE, DIVIDER, PATH, ROAD, RoadRaster, road_raster
from smarts.types.colors import SceneColors
from smarts.types.interface import Field
from smarts.types.vehicles import Owner

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]

_AGENT = int(Owner.AGENT)
_GROUND = (26, 32, 26)
_WALK = (52, 52, 48)
_FINE = 0.4
"""Side of the largest pixels that show lines [m]."""


def _levels(colour: SceneColors) -> list[int]:
    return [round(255 * channel) for channel in colour.value[:3]]


@cache
def _palette() -> Pixels:
    """Return the colour of each combination of a cell's bits, shape (16, 3)."""
    colours = np.zeros((16, 3), np.uint8)
    for bits in range(16):
        layers = (
            (CENTRE_LINE, _levels(SceneColors.EdgeDivider)),
            (DIVIDER, _levels(SceneColors.LaneDivider)),
            (ROAD, _levels(SceneColors.Road)),
            (PATH, _WALK),
        )
        colours[bits] = next((colour for bit, colour in layers if bits & bit), _GROUND)
    return colours


@cache
def _vehicle_colours() -> Pixels:
    """Return the colours of traffic, of other agents, and of the own vehicle, shape (3, 3)."""
    kinds = (SceneColors.SocialVehicle, SceneColors.SocialAgent, SceneColors.Agent)
    return np.array([_levels(kind) for kind in kinds], np.uint8)


@dataclass(frozen=True)
class TopDownRgb:
    """A view from above: road with its markings, traffic, agents, and the own vehicle in red."""

    option: RGB = field(default_factory=RGB)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        shape = (self.option.height, self.option.width, 3)
        meaning = "red, green, blue; the own vehicle in the middle, its front towards row 0"
        return (
            Field("data", shape, np.uint8, 0, 255, "", meaning),
            Field("resolution", (), np.float32, 0, FARTHEST, "m", "side of a pixel"),
        )

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents."""
        world, vehicles = scene.world, scene.world.vehicles
        paint_scene(
            agent_ids,
            observe_mask,
            world.agents.slot,
            world.map,
            vehicles.alive,
            vehicles.owner,
            vehicles.position,
            vehicles.heading,
            vehicles.length,
            vehicles.width,
            road_raster(scene.atlas),
            _palette(),
            _vehicle_colours(),
            self.option.resolution,
            out["data"],
        )
        out["resolution"][observe_mask] = self.option.resolution


@kernel
def _paint_road(
    raster: RoadRaster,
    m: int,
    x: float,
    y: float,
    heading: float,
    resolution: float,
    palette: Pixels,
    bits: Pixels,
    view: Pixels,
) -> None:
    cut_view(
        raster.cells,
        raster.first[m],
        raster.shape[m, 0],
        raster.shape[m, 1],
        raster.origin[m, 0],
        raster.origin[m, 1],
        raster.size[m],
        x,
        y,
        heading,
        resolution,
        # Of lines finer than a pixel only specks would be left.
        ROAD | PATH | (DIVIDER | CENTRE_LINE if resolution <= _FINE else 0),
        bits,
    )
    for row in range(view.shape[0]):
        for column in range(view.shape[1]):
            for channel in range(view.shape[2]):
                view[row, column, channel] = palette[bits[row, column], channel]


@kernel
def paint_scene(
    agent_ids: Ints,
    observe_mask: Bools,
    slots: Ints,
    maps: Ints,
    alive: Bools,
    owner: Bytes,
    position: Floats,
    heading: Floats,
    length: Floats,
    width: Floats,
    raster: RoadRaster,
    palette: Pixels,
    colours: Pixels,
    resolution: float,
    views: Pixels,
) -> None:
    """Paint what is around the wanted agents' vehicles.

    Args:
        agent_ids: The agents, shape (G,).
        observe_mask: Whose views to paint, shape (B, G).
        slots: Of each agent's vehicle, shape (B, A).
        maps: Map of each simulation, shape (B,).
        alive: Shape (B, V), as the columns of `VehicleStates` that follow.
        owner: An `Owner`.
        position: [m], shape (B, V, 2).
        heading: [rad]
        length: [m]
        width: [m]
        raster: The maps.
        palette: Colour of each combination of a cell's bits, shape (16, channels).
        colours: Of traffic, of other agents, and of the own vehicle, shape (3, channels).
        resolution: Side of a pixel [m].
        views: Written, shape (B, G, height, width, channels).
    """
    bits = np.empty((views.shape[2], views.shape[3], 1), np.uint8)
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            own = slots[b, agent_ids[g]]
            x, y = clipped(position[b, own, 0], FARTHEST), clipped(position[b, own, 1], FARTHEST)
            direction = clipped(heading[b, own], math.pi)
            _paint_road(raster, maps[b], x, y, direction, resolution, palette, bits[:, :, 0], views[b, g])
            for v in range(alive.shape[1]):
                if not alive[b, v]:
                    continue
                ahead, aside = place_in_view(position[b, v, 0], position[b, v, 1], x, y, direction)
                paint_box(
                    views[b, g],
                    resolution,
                    ahead,
                    aside,
                    clipped(heading[b, v], math.pi) - direction,
                    clipped_above(length[b, v], LARGEST_BOX),
                    clipped_above(width[b, v], LARGEST_BOX),
                    colours[2 if v == own else 1 if owner[b, v] == _AGENT else 0],
                )
