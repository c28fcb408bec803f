"""Action masks of the discrete lane actions."""

from __future__ import annotations

from collections.abc import Callable

from smarts.arrays import Bools
from smarts.controllers.lane_changes import write_action_mask
from smarts.geometry.binding import bind
from smarts.roads.scene import Scene


class ActionMasker:
    """Writes `agents.action_mask`; part of the map-matching stage, after vehicles are matched.

    `keep_lane` and `slow_down` are always allowed. A lane change is allowed outside junctions, to a lane of
    the same direction that is open to the vehicle, on its route, and either continues along the route or does
    not end soon. During the first half of a lane change, the opposite lane change is allowed and aborts it.
    No lane change is allowed while a mission's task executes its manoeuvre.
    """

    def __init__(self, scene: Scene) -> None:
        self.write: Callable[[Bools], None] = bind(
            write_action_mask, scene.world.state, scene.atlas.roads, scene.routes.current
        )
        """Writes the masks of all agents in the simulations of `env_mask`, shape (B,)."""
