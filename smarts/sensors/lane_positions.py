"""Where along and across its lane the agent's vehicle is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import LanePositions
from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, clipped
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


@dataclass(frozen=True)
class LanePosition:
    """The place in the lane as s, t, h: along the centreline, to its left, above the surface."""

    option: LanePositions = field(default_factory=LanePositions)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        meaning = "along the lane from its begin, to the left of its centreline, above it (always 0)"
        return (Field("lane_position", (3,), np.float32, -FARTHEST, FARTHEST, "m", meaning),)

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents."""
        vehicles = scene.world.vehicles
        _observe(
            agent_ids,
            observe_mask,
            scene.world.agents.slot,
            vehicles.lane_position,
            vehicles.lane_offset,
            out["lane_position"],
        )


@kernel
def _observe(
    agent_ids: Ints, observe_mask: Bools, slots: Ints, s: Floats, t: Floats, result: Singles
) -> None:
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if observe_mask[b, g]:
                v = slots[b, agent_ids[g]]
                result[b, g, 0] = clipped(s[b, v], FARTHEST)
                result[b, g, 1] = clipped(t[b, v], FARTHEST)
                result[b, g, 2] = 0.0
