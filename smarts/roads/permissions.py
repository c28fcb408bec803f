"""Lane kinds from SUMO's `allow` and `disallow` lists."""

from __future__ import annotations

from smarts.roads.lane_graph import LaneKind

_RAIL = {"rail", "tram", "rail_urban", "rail_electric", "rail_fast", "subway", "cable_car"}
# In order of precedence: a lane is of the first kind of which it is open to some user.
_USERS = (
    (LaneKind.CAR, {"passenger"}),
    (LaneKind.BUS, {"bus", "coach"}),
    (LaneKind.BICYCLE, {"bicycle"}),
    (LaneKind.FOOT, {"pedestrian"}),
    (LaneKind.RAIL, _RAIL),
)


def lane_kind(allow: str, disallow: str, road_type: str = "") -> LaneKind:
    """Return the kind of a lane from SUMO's space-separated vehicle classes and its type of surface."""
    if road_type == "shoulder":
        return LaneKind.SHOULDER
    allowed, disallowed = set(allow.split()), set(disallow.split())

    def is_open(users: set[str]) -> bool:
        if allowed:
            return "all" in allowed or bool(users & allowed)
        return "all" not in disallowed and bool(users - disallowed)

    return next((kind for kind, users in _USERS if is_open(users)), LaneKind.CLOSED)
