"""The feature `image`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydantic import PositiveFloat, PositiveInt

from smarts.arrays import Bools
from smarts.observations.context import AdapterContext
from smarts.observations.feature import Feature
from smarts.sensors.grid_map import GridOut
from smarts.sensors.protocol import bind_write
from smarts.sensors.road_raster import road_raster
from smarts.sensors.top_down_rgb import FINE, TopDownRgb, road_colours
from smarts.types.interface import Field

_GROUND, _PATH, _ROAD, _DIVIDER, _CENTRE_LINE = 0, 32, 64, 96, 112
_TRAFFIC, _AGENT, _OWN = 160, 208, 255


class Image(Feature):
    """A grey picture from above, the own vehicle in the middle, its front towards row 0.

    Levels are chosen so that own vehicle, other agents, traffic, road and ground differ; colours turned grey
    would make the own vehicle as dark as the road.

    Args:
        context: The agents.
        size: Rows and columns.
        resolution: Side of a pixel [m].
    """

    in_vector = False

    def __init__(
        self, context: AdapterContext, size: PositiveInt = 64, resolution: PositiveFloat = 1.0
    ) -> None:
        super().__init__(context)
        self._size, self._resolution = size, float(resolution)

    def fields(self) -> tuple[Field, ...]:
        """Return the picture."""
        shape, meaning = (self._size, self._size, 1), "from above; the own vehicle in the middle"
        return (Field("image", shape, np.uint8, 0, 255, "", meaning),)

    def bind(self, *out: NDArray) -> Callable[[Bools], object]:
        """Return the function that observes."""
        road = road_colours(
            *([_CENTRE_LINE], [_DIVIDER], [_ROAD], [_PATH], [_GROUND]), lines=self._resolution <= FINE
        )
        boxes = np.array([[_TRAFFIC], [_AGENT], [_OWN]], np.uint8)
        (image,) = out
        arrays = GridOut(image, np.zeros(image.shape[:2], np.float32))
        scene, agent_ids = self.context.scene, self.context.agent_ids
        known = self._resolution, road, boxes, road_raster(scene.atlas)
        return bind_write(TopDownRgb.write, scene, agent_ids, arrays, known)
