"""The mask of lane actions that agents may take next."""

from __future__ import annotations

from collections.abc import Callable

from smarts.arrays import Bools
from smarts.controllers.lane_changes import write_action_mask
from smarts.geometry.binding import bind
from smarts.roads.scene import Scene


class ActionMasker:
    """Writes `agents.action_mask`; part of the map-matching stage, after vehicles are matched.

    Keeping the lane and slowing down are always allowed. A lane change is allowed outside junctions if the
    lane on that side leads in the same direction, is open to the vehicle and is on the route, and either
    continues on the route or does not end soon. During a lane change only the opposite one is allowed, in
    the first half: it aborts the change. While a mission's task leads the agent out of its lane, none is.
    """

    def __init__(self, scene: Scene) -> None:
        self.write: Callable[[Bools], None] = bind(
            write_action_mask, scene.world.state, scene.atlas.roads, scene.routes.current
        )
        """Write the masks of all agents in the simulations of a mask, shape (B,)."""
