"""Control of vehicles whose agent has not acted yet."""

from __future__ import annotations

from typing import ClassVar

from smarts.controllers.lane_following import FALLBACK, LaneFollowing


class FallbackController(LaneFollowing):
    """Keeps its lane within the limit, and does not drive into the vehicle ahead."""

    manner: ClassVar[int] = FALLBACK
