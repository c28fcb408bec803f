"""The controller of agents that have not acted yet."""

from __future__ import annotations

from typing import ClassVar

from smarts.controllers.lane_following import FALLBACK, LaneFollowing


class FallbackController(LaneFollowing):
    """Keeps the lane within the speed limit, and the distance to the vehicle ahead."""

    command_type: ClassVar[int] = FALLBACK
