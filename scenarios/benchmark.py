"""Traffic and missions that the paper's benchmark scenarios share with the tasks of benchmark version 1."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType

from scenarios.drivers import MIXED, Drivers, flow, placed, slowly, traffic
from smarts.sstudio import types as t

OPPOSITE = {"north": "south", "south": "north", "west": "east", "east": "west"}
LEFT = {"north": "east", "south": "west", "west": "north", "east": "south"}
RIGHT = {"north": "west", "south": "east", "west": "south", "east": "north"}
ARM_RATE = 680.0
"""Rate of vehicles that enter the intersection from each arm [vehicles/h]."""


WEAVING_WARM_UP = 25.0
"""Warm-up of double merge [s]."""


def weaving(
    density: float = 1.0, drivers: Drivers = MIXED, crossing: float = 0.6, slow: float = 0.0
) -> dict[str, t.Traffic]:
    """Return the traffic of double merge.

    Args:
        density: Multiple of the usual rate.
        drivers: Weight of each kind of driver.
        crossing: Share of the vehicles that leave on the other side.
        slow: Speed of a vehicle on either lane ahead of the agents [m/s]; 0: there are none.
    """
    rates = {
        ("top_left", "down_right"): crossing,
        ("top_left", "top_right"): 1 - crossing,
        ("down_left", "top_right"): crossing,
        ("down_left", "down_right"): 1 - crossing,
    }
    flows = [
        flow((f"{begin}_approach", 0), (end, 0), 1000 * share * density, drivers)
        for (begin, end), share in rates.items()
    ]
    for lane, goal in ((0, "down_right"), (1, "top_right")) if slow else ():
        leader = [("merge", lane, 25.0)]
        flows += placed(leader, (goal, 0), WEAVING_WARM_UP - 0.2, slowly(drivers, slow))
    return traffic(flows, WEAVING_WARM_UP, {"top_left_approach": 115, "down_left_approach": 115})


def crossing_trades() -> list[t.Mission]:
    """Return the missions of double merge: from the top to the bottom and the reverse."""
    return [
        t.Mission(t.Route(begin=(begin, 0, offset), end=(end, 0, 10)))
        for offset in (10, 25)
        for begin, end in (("top_left", "down_right"), ("down_left", "top_right"))
    ]


def four_arms(density: float = 1.0, drivers: Drivers = MIXED, lanes: int = 2) -> dict[str, t.Traffic]:
    """Return the traffic of the intersection; arguments as of `weaving`, with so many lanes a direction."""
    leftmost, rate = lanes - 1, ARM_RATE * density
    flows = []
    for arm in OPPOSITE:
        begin = f"{arm}_approach"
        for lane in range(lanes):
            flows.append(flow((begin, lane), (f"{OPPOSITE[arm]}_exit", lane), 0.55 * rate / lanes, drivers))
        flows.append(flow((begin, leftmost), (f"{LEFT[arm]}_exit", leftmost), 0.12 * rate, drivers))
        flows.append(flow((begin, 0), (f"{RIGHT[arm]}_exit", 0), 0.33 * rate, drivers))
    return traffic(flows, 30.0, {f"{arm}_approach": 95 for arm in OPPOSITE})


FROM_ALL_SIDES = [
    t.Mission(t.Route(begin=("south_in", 1, 40), end=("west_out", 0, 60))),
    t.Mission(t.Route(begin=("west_in", 1, 50), end=("east_out", 0, 60))),
    t.Mission(t.Route(begin=("north_in", 0, 40), end=("south_out", 1, 40))),
    t.Mission(t.Route(begin=("east_in", 0, 50), end=("west_out", 1, 40))),
]
"""Missions of the intersection."""
MIRRORED = [
    t.Mission(t.Route(begin=("north_in", 1, 40), end=("east_out", 0, 60))),
    t.Mission(t.Route(begin=("east_in", 1, 50), end=("west_out", 0, 60))),
    t.Mission(t.Route(begin=("south_in", 0, 40), end=("north_out", 1, 40))),
    t.Mission(t.Route(begin=("west_in", 0, 50), end=("east_out", 1, 40))),
]
"""The same, turned by 180 degrees."""
LEFT_TURNS = [
    t.Mission(t.Route(begin=(f"{arm}_in", 1, 40), end=(f"{goal}_out", 1, 40))) for arm, goal in LEFT.items()
]
"""Every agent turns left."""
ON_THREE_LANES = [
    t.Mission(t.Route(begin=("south_in", 2, 40), end=("west_out", 1, 60))),
    t.Mission(t.Route(begin=("west_in", 1, 50), end=("east_out", 0, 60))),
    t.Mission(t.Route(begin=("north_in", 0, 40), end=("south_out", 1, 40))),
    t.Mission(t.Route(begin=("east_in", 1, 50), end=("west_out", 2, 40))),
]
"""The same on three lanes a direction."""


def farther(
    missions: Iterable[t.Mission],
    goal: float = 80.0,
    starts: Mapping[str, float] = MappingProxyType({}),
) -> list[t.Mission]:
    """Return the missions with goals on the road behind the one on which they were, and perhaps other starts.

    Args:
        missions: As above.
        goal: Offset on the road behind [m].
        starts: Road on which a mission begins -> offset [m] at which it begins instead.
    """
    found = []
    for mission in missions:
        route = mission.route
        assert isinstance(route, t.Route)
        (start_road, start_lane, offset), (road, lane, _) = route.begin, route.end
        begin = (start_road, start_lane, starts.get(start_road, offset))
        end = (f"{road.removesuffix('_out')}_exit", lane, goal)
        found.append(replace(mission, route=replace(route, begin=begin, end=end)))
    return found
