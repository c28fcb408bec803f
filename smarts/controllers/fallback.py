"""The controller of agents that have not acted yet, and of vehicles whose agent is leaving."""

from __future__ import annotations

from typing import ClassVar

from smarts.controllers.lane_following import FALLBACK, LaneFollowing


class FallbackController(LaneFollowing):
    """Keeps the lane within the speed limit, and the distance to the vehicle ahead.

    A vehicle that comes from traffic stops at red lights, too. If its agent is leaving, it brakes and stands
    after a collision, and beside all lanes.
    """

    command_type: ClassVar[int] = FALLBACK
