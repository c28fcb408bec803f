"""The via points of the agent's mission."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import Vias
from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, FASTEST, MOST, clipped, clipped_above
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


@dataclass(frozen=True)
class ViaPoints:
    """The via points near the vehicle, nearest first, those that it has passed included."""

    option: Vias = field(default_factory=Vias)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        k = self.option.most
        return (
            Field("count", (), np.int32, 0, k, "", "how many points follow; the entries after them are 0"),
            Field("position", (k, 2), np.float64, -FARTHEST, FARTHEST, "m", ""),
            Field("lane", (k,), np.int32, -1, MOST, "", "number in the map"),
            Field("lane_index", (k,), np.int32, 0, MOST, "", "place across the road, 0 is the rightmost"),
            Field("required_speed", (k,), np.float32, 0, FASTEST, "m/s", "to pass it at"),
            Field("hit", (k,), np.int8, 0, 1, "", "1 if it has been passed, in laps in this one"),
        )

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents."""
        world, roads = scene.world, scene.atlas.roads
        missions = world.missions
        _observe(
            agent_ids,
            observe_mask,
            world.agents.slot,
            world.map,
            world.vehicles.position,
            missions.via_count,
            missions.via_position,
            missions.via_lane,
            missions.via_speed,
            world.agents.via_hit,
            roads.lane_base,
            roads.lane_index,
            self.option.acquisition_range,
            out["count"],
            out["position"],
            out["lane"],
            out["lane_index"],
            out["required_speed"],
            out["hit"],
        )


@kernel
def _nearest(vias: Floats, count: int, x: float, y: float, reach: float, order: Ints, far: Floats) -> int:
    """List the points within reach, nearest first, as many as there is room; return how many."""
    found = 0
    for via in range(count):
        dx, dy = vias[via, 0] - x, vias[via, 1] - y
        square = dx * dx + dy * dy
        if not square <= reach * reach or (found == len(order) and square >= far[found - 1]):
            continue
        place = min(found, len(order) - 1)
        while place > 0 and far[place - 1] > square:
            order[place], far[place] = order[place - 1], far[place - 1]
            place -= 1
        order[place], far[place] = via, square
        found = min(found + 1, len(order))
    return found


@kernel
def _observe(
    agent_ids: Ints,
    observe_mask: Bools,
    slots: Ints,
    maps: Ints,
    position: Floats,
    via_count: Bytes,
    via_position: Floats,
    via_lane: Ints,
    via_speed: Floats,
    via_hit: Bools,
    lane_base: Ints,
    lane_index: Ints,
    reach: float,
    count_out: Ints,
    position_out: Floats,
    lane_out: Ints,
    lane_index_out: Ints,
    speed_out: Singles,
    hit_out: Bytes,
) -> None:
    most = lane_out.shape[2]
    order, far = np.empty(most, np.int32), np.empty(most)
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            a = agent_ids[g]
            x, y = position[b, slots[b, a], 0], position[b, slots[b, a], 1]
            count = _nearest(via_position[b, a], via_count[b, a], x, y, reach, order, far)
            count_out[b, g] = count
            for k in range(count):
                via = order[k]
                position_out[b, g, k, 0] = clipped(via_position[b, a, via, 0], FARTHEST)
                position_out[b, g, k, 1] = clipped(via_position[b, a, via, 1], FARTHEST)
                lane = via_lane[b, a, via]
                lane_out[b, g, k] = lane
                lane_index_out[b, g, k] = lane_index[lane_base[maps[b]] + lane] if lane >= 0 else 0
                speed_out[b, g, k] = clipped_above(via_speed[b, a, via], FASTEST)
                hit_out[b, g, k] = via_hit[b, a, via]
            position_out[b, g, count:] = 0.0
            lane_out[b, g, count:] = 0
            lane_index_out[b, g, count:] = 0
            speed_out[b, g, count:] = 0.0
            hit_out[b, g, count:] = 0
