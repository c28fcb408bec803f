"""Road friction patches: areas and periods with another friction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smarts.arrays import Bools
from smarts.dynamics import Fleet
from smarts.dynamics.fleet import DRY_ASPHALT as DRY
from smarts.geometry.binding import LateBound
from smarts.geometry.rings import rings_of, starts_of
from smarts.providers.vehicle_kernels import FrictionPatches, look_up_friction
from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio.sstypes.drawing import fresh_drawing
from smarts.sstudio.sstypes.zone import RoadSurfacePatch
from smarts.types.world import World

__all__ = ["DRY", "RoadSurfaces"]


class RoadSurfaces:
    """The friction patches of all maps; where patches overlap, the last in the list applies.

    Args:
        patches: The patches of each map, in the order of the atlas.
        maps: The maps.
        friction: Friction outside patches.
    """

    def __init__(
        self, patches: Sequence[Sequence[RoadSurfacePatch]], maps: Sequence[LaneGraph], friction: float = DRY
    ) -> None:
        rows: list[tuple[float, float, float]] = []
        counts, ring_counts, rings = [], [], []
        for of_map, graph in zip(patches, maps, strict=True):
            counts.append(len(of_map))
            # Random offsets of zones are the same in every run, whatever the other maps.
            with fresh_drawing():
                for patch in of_map:
                    rows.append((patch.begin_time, patch.end_time, patch.friction_coefficient))
                    outlines = rings_of(patch.zone.to_geometry(graph))
                    ring_counts.append(len(outlines))
                    rings += outlines
        self._patches = FrictionPatches(
            usual=float(friction),
            start=starts_of(counts),
            patch=np.array(rows, np.float64).reshape(-1, 3),
            ring_start=starts_of(ring_counts),
            vertex_start=starts_of([len(ring) for ring in rings]),
            vertex=np.concatenate([np.zeros((0, 2)), *rings]),
        )
        self._look_up = LateBound(look_up_friction)

    def look_up(self, world: World, driven: Bools, fleet: Fleet) -> None:
        """Write the friction under the wheels of driven vehicles into `fleet.road`.

        Args:
            world: The world.
            driven: Agents whose vehicles are in the fleet, shape (B, A).
            fleet: The fleet.
        """
        given = world.state, self._patches, driven, fleet.wheels.position, fleet.road.friction
        self._look_up.to(*given)()
