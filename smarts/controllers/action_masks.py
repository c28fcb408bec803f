"""Which lane actions agents may take next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.controllers.lane_changes import write_legal
from smarts.controllers.lane_state import LaneState
from smarts.geometry.binding import bind
from smarts.roads.scene import Scene
from smarts.types.world import World

Bools = NDArray[np.bool_]


class ActionMasker:
    """Writes `agents.legal`; a part of the locator stage, which has just said where everybody is.

    To keep the lane and to slow down are always legal. A lane change is if there is a lane on that side in
    the same direction that is open to the vehicle, outside junctions, and if that lane is on the route and
    goes on along it or does not end soon. During a lane change only the opposite one is legal, up to
    half-way: it takes the change back. While a mission's task leads the agent out of its lane, none is.
    """

    def __init__(self, scene: Scene) -> None:
        world = scene.world
        arrays = scene.atlas.roads, scene.routes.current, LaneState.of(scene)
        agents = world.agents
        self._write = bind(write_legal, *arrays, agents.state, world.guidance.phase, agents.action_mask)

    def write(self, world: World, env_mask: Bools) -> None:
        """Say what is legal in all occupied agents of some simulations."""
        self._write(env_mask)
