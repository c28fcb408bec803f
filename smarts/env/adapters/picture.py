"""The grey picture from above that an agent of the benchmark may see: three decisions as its channels."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from smarts.env.adapters.protocol import AdapterContext
from smarts.errors import SmartsError
from smarts.geometry.compiling import kernel
from smarts.sensors.road_raster import CENTRE_LINE, DIVIDER, PATH, ROAD, road_raster
from smarts.sensors.top_down_rgb import paint_scene
from smarts.types.frame import Frame
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Pixels = NDArray[np.uint8]

_GROUND, _WALK, _ROAD, _DIVIDER, _CENTRE_LINE = 0, 32, 64, 96, 112
_TRAFFIC, _AGENT, _OWN = 160, 208, 255
_SMALLEST, _LARGEST = 8, 512


@cache
def _palette() -> Pixels:
    """Return the level of each combination of a cell's bits, shape (16, 1)."""
    layers = ((CENTRE_LINE, _CENTRE_LINE), (DIVIDER, _DIVIDER), (ROAD, _ROAD), (PATH, _WALK))
    levels = [next((level for bit, level in layers if bits & bit), _GROUND) for bits in range(16)]
    return np.array(levels, np.uint8)[:, None]


@cache
def _vehicles() -> Pixels:
    """Return the levels of traffic, of other agents, and of the own vehicle, shape (3, 1)."""
    return np.array([[_TRAFFIC], [_AGENT], [_OWN]], np.uint8)


class Pictures:
    """Pictures of H by H pixels, the own vehicle in the middle, its front towards row 0.

    Levels are chosen so that own vehicle, other agents, traffic, road and ground differ; colours turned grey
    would make the own vehicle as dark as the road.

    Args:
        served: The agents.
        size: H.
        resolution: Side of a pixel [m].
        frames: How many decisions are kept, as channels, the oldest first.

    Raises:
        SmartsError: Size or resolution are not possible.
    """

    def __init__(self, served: AdapterContext, size: int, resolution: float, frames: int) -> None:
        if not (_SMALLEST <= size <= _LARGEST and 0.0 < resolution < np.inf):
            raise SmartsError(
                f"a picture of {size} pixels of {resolution} m",
                place="adapter options image_size, image_resolution",
                remedy=f"give {_SMALLEST} to {_LARGEST} pixels, and a resolution above 0",
            )
        meaning = "from above, of three decisions, oldest first; the own vehicle in the middle"
        self.field = Field("image", (size, size, frames), np.uint8, 0, 255, "", meaning)
        self._served, self._resolution = served, float(resolution)
        self._view = np.zeros((served.scene.world.worlds, len(served.agents), size, size, 1), np.uint8)

    def write(self, frame: Frame, chosen: Bools, is_new: Bools, images: Pixels) -> None:
        """Append what the chosen agents see now to the pictures they hold; see `write_image_stack`."""
        scene, vehicles = self._served.scene, frame.world.vehicles
        paint_scene(
            self._served.agent_ids,
            chosen,
            frame.world.agents.slot,
            frame.world.map,
            vehicles.alive,
            vehicles.owner,
            vehicles.position,
            vehicles.heading,
            vehicles.length,
            vehicles.width,
            road_raster(scene.atlas),
            _palette(),
            _vehicles(),
            self._resolution,
            self._view,
        )
        write_image_stack(self._view, chosen, is_new, images)


@kernel
def write_image_stack(view: Pixels, chosen: Bools, is_new: Bools, images: Pixels) -> None:
    """Append the chosen agents' pictures to those they hold, the oldest of which goes.

    Args:
        view: Shape (B, G, H, W, 1).
        chosen: Whom to write, shape (B, G).
        is_new: Who holds no pictures yet and gets as many of this one, shape (B, G).
        images: Written; the pictures are its channels, the oldest first, shape (B, G, H, W, pictures).
    """
    last = images.shape[4] - 1
    for b in range(chosen.shape[0]):
        for g in range(chosen.shape[1]):
            if not chosen[b, g]:
                continue
            for row in range(images.shape[2]):
                for column in range(images.shape[3]):
                    pixel, now = images[b, g, row, column], view[b, g, row, column, 0]
                    for frame in range(last):
                        pixel[frame] = now if is_new[b, g] else pixel[frame + 1]
                    pixel[last] = now
