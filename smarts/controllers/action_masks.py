"""Which lane actions agents may take next."""

from __future__ import annotations

from collections.abc import Callable

from smarts.arrays import Bools
from smarts.controllers.lane_changes import write_legal
from smarts.geometry.binding import bind
from smarts.roads.scene import Scene


class ActionMasker:
    """Writes `agents.action_mask`; part of the map-matching stage, after vehicles are matched.

    To keep the lane and to slow down are always legal. A lane change is if there is a lane on that side in
    the same direction that is open to the vehicle, outside junctions, and if that lane is on the route and
    goes on along it or does not end soon. During a lane change only the opposite one is legal, up to
    half-way: it takes the change back. While a mission's task leads the agent out of its lane, none is.
    """

    def __init__(self, scene: Scene) -> None:
        self.write: Callable[[Bools], None] = bind(
            write_legal, scene.world.state, scene.atlas.roads, scene.routes.current
        )
        """Write the masks of all agents in the simulations of a mask, shape (B,)."""
