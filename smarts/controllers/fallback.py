"""The controller of agents that have not acted yet, and of vehicles whose agent is leaving."""

from __future__ import annotations

from typing import ClassVar

from smarts.controllers.lane_following import FALLBACK, LaneFollowing


class FallbackController(LaneFollowing):
    """Keeps the lane within the speed limit, and the distance to the vehicle ahead.

    A vehicle whose agent is leaving stops at red lights, too; it brakes and stands if it has collided or is
    on no lane.
    """

    command_type: ClassVar[int] = FALLBACK
