"""The other vehicles around the agent's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.agents.options import NeighborhoodVehicles
from smarts.geometry.compiling import kernel
from smarts.roads.scene import Scene
from smarts.sensors.bounds import FARTHEST, FASTEST, LARGEST_BOX, MOST, clipped, clipped_above
from smarts.sensors.heights import vehicle_height
from smarts.types.interface import Field

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]
Singles = NDArray[np.float32]


class _Entries(NamedTuple):
    """The arrays to be filled, shape (B, G, ...), K vehicles each."""

    slot: Ints
    generation: Ints
    position: Floats
    bounding_box: Singles
    heading: Singles
    speed: Singles
    lane: Ints
    lane_index: Ints
    lane_position: Singles


@dataclass(frozen=True)
class NeighborhoodVehicleStates:
    """The nearest other vehicles, nearest first; of vehicles equally far the one of the lower slot."""

    option: NeighborhoodVehicles = field(default_factory=NeighborhoodVehicles)

    def fields(self) -> tuple[Field, ...]:
        """Return what is reported."""
        k = self.option.most
        return (
            Field("count", (), np.int32, 0, k, "", "how many vehicles follow; the entries after them are 0"),
            Field("slot", (k,), np.int32, 0, MOST, "", "the vehicle's place in the world's arrays"),
            Field("generation", (k,), np.int32, 0, MOST, "", "with the slot, the vehicle's identity"),
            Field("position", (k, 3), np.float64, -FARTHEST, FARTHEST, "m", "centre of the footprint"),
            Field("bounding_box", (k, 3), np.float32, 0, LARGEST_BOX, "m", "length, width, height"),
            Field("heading", (k,), np.float32, -np.pi, np.pi, "rad", "counter-clockwise from +x"),
            Field("speed", (k,), np.float32, -FASTEST, FASTEST, "m/s", "along the heading"),
            Field("lane", (k,), np.int32, -1, MOST, "", "number in the map, -1 if there is none"),
            Field("lane_index", (k,), np.int32, 0, MOST, "", "place across the road, 0 is the rightmost"),
            Field("lane_position", (k, 3), np.float32, -FARTHEST, FARTHEST, "m", "along, left of, above it"),
        )

    def observe(self, scene: Scene, agent_ids: Ints, observe_mask: Bools, out: Mapping[str, NDArray]) -> None:
        """Write the readings of the wanted agents."""
        vehicles, roads = scene.world.vehicles, scene.atlas.roads
        radius = self.option.radius
        _observe(
            agent_ids,
            observe_mask,
            scene.world.agents.slot,
            scene.world.map,
            math.inf if radius is None else float(radius),
            vehicles.alive,
            vehicles.generation,
            vehicles.kind,
            vehicles.position,
            vehicles.heading,
            vehicles.speed,
            vehicles.length,
            vehicles.width,
            vehicles.lane,
            vehicles.lane_position,
            vehicles.lane_offset,
            roads.lane_base,
            roads.lane_index,
            out["count"],
            _Entries(**{name: out[name] for name in _Entries._fields}),
        )


@kernel
def _nearest(alive: Bools, position: Floats, self_slot: int, radius: float, found: Ints, far: Floats) -> int:
    """List the slots of the nearest vehicles of one simulation, as many as there is room; return how many."""
    count = 0
    x, y = position[self_slot, 0], position[self_slot, 1]
    for v in range(len(alive)):
        if not alive[v] or v == self_slot:
            continue
        dx, dy = position[v, 0] - x, position[v, 1] - y
        square = dx * dx + dy * dy
        # Also false for what is not a number.
        if not square <= radius * radius or (count == len(found) and square >= far[count - 1]):
            continue
        place = min(count, len(found) - 1)
        while place > 0 and far[place - 1] > square:
            found[place], far[place] = found[place - 1], far[place - 1]
            place -= 1
        found[place], far[place] = v, square
        count = min(count + 1, len(found))
    return count


@kernel
def _clear(entries: _Entries, b: int, g: int, first: int) -> None:
    for k in range(first, entries.slot.shape[2]):
        entries.slot[b, g, k] = 0
        entries.generation[b, g, k] = 0
        entries.heading[b, g, k] = 0.0
        entries.speed[b, g, k] = 0.0
        entries.lane[b, g, k] = 0
        entries.lane_index[b, g, k] = 0
        for axis in range(3):
            entries.position[b, g, k, axis] = 0.0
            entries.bounding_box[b, g, k, axis] = 0.0
            entries.lane_position[b, g, k, axis] = 0.0


@kernel
def _observe(
    agent_ids: Ints,
    observe_mask: Bools,
    slots: Ints,
    maps: Ints,
    radius: float,
    alive: Bools,
    generation: Ints,
    kind: Bytes,
    position: Floats,
    heading: Floats,
    speed: Floats,
    length: Floats,
    width: Floats,
    lane: Ints,
    s: Floats,
    t: Floats,
    lane_base: Ints,
    lane_index: Ints,
    counts: Ints,
    entries: _Entries,
) -> None:
    most = entries.slot.shape[2]
    found, far = np.empty(most, np.int32), np.empty(most)
    for b in range(observe_mask.shape[0]):
        for g in range(observe_mask.shape[1]):
            if not observe_mask[b, g]:
                continue
            count = _nearest(alive[b], position[b], slots[b, agent_ids[g]], radius, found, far)
            counts[b, g] = count
            _clear(entries, b, g, count)
            for k in range(count):
                v = found[k]
                entries.slot[b, g, k] = v
                entries.generation[b, g, k] = generation[b, v]
                entries.position[b, g, k, 0] = clipped(position[b, v, 0], FARTHEST)
                entries.position[b, g, k, 1] = clipped(position[b, v, 1], FARTHEST)
                entries.position[b, g, k, 2] = 0.0
                entries.bounding_box[b, g, k, 0] = clipped_above(length[b, v], LARGEST_BOX)
                entries.bounding_box[b, g, k, 1] = clipped_above(width[b, v], LARGEST_BOX)
                entries.bounding_box[b, g, k, 2] = vehicle_height(kind[b, v])
                entries.heading[b, g, k] = clipped(heading[b, v], math.pi)
                entries.speed[b, g, k] = clipped(speed[b, v], FASTEST)
                number = lane[b, v]
                entries.lane[b, g, k] = number
                entries.lane_index[b, g, k] = lane_index[lane_base[maps[b]] + number] if number >= 0 else 0
                entries.lane_position[b, g, k, 0] = clipped(s[b, v], FARTHEST)
                entries.lane_position[b, g, k, 1] = clipped(t[b, v], FARTHEST)
                entries.lane_position[b, g, k, 2] = 0.0
