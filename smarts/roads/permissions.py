"""Who may use a lane, from SUMO's `allow` and `disallow` lists."""

from __future__ import annotations

from smarts.roads.lane_graph import LaneKind

# In order of precedence: a lane is of the first kind whose users may all be found on it.
_USERS = (
    (LaneKind.CAR, "passenger"),
    (LaneKind.BUS, "bus"),
    (LaneKind.BICYCLE, "bicycle"),
    (LaneKind.FOOT, "pedestrian"),
    (LaneKind.RAIL, "rail"),
    (LaneKind.RAIL, "tram"),
)
_RAIL = {"rail", "tram", "rail_urban", "rail_electric", "rail_fast", "subway"}


def lane_kind(allow: str, disallow: str, road_type: str = "") -> LaneKind:
    """Return the kind of a lane from SUMO's space-separated vehicle classes and its type of surface."""
    if road_type == "shoulder":
        return LaneKind.SHOULDER
    allowed, disallowed = set(allow.split()), set(disallow.split())

    def may_use(user: str) -> bool:
        if allowed:
            return user in allowed or "all" in allowed
        return user not in disallowed and "all" not in disallowed

    return next((kind for kind, user in _USERS if may_use(user)), LaneKind.CLOSED)
