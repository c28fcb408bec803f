"""Roads with oncoming traffic and slow leaders, one or two lanes a direction, straight or in an S."""

import math
from pathlib import Path

from numpy.random import Generator

from scenarios.drivers import START_IN_TOWN, Drivers, flow, placed, slowly, traffic
from scenarios.families import PlainMap, Point, from_none_to_dense
from smarts.sstudio import gen_family
from smarts.sstudio import types as t

WARM_UP = 10.0
OUTER = 120.0
"""Length of the roads on which traffic arrives and leaves [m]."""
WAYS = ("eastbound", "westbound")


def road_map(length: float, lanes: int, width: float, speed: float, bend: float) -> t.MapSpec:
    """Return the map: a road of three parts along a sine of one period and `bend` metres to each side."""
    whole = length + 2 * OUTER

    def line(begin: float, end: float) -> list[Point]:
        count = 1 + math.ceil(abs(end - begin) / 8.0)
        places = [begin + (end - begin) * i / count for i in range(count + 1)]
        return [(x, bend * math.sin(2 * math.pi * x / whole)) for x in places]

    drawn = PlainMap(width)
    ends = {"west_end": 0.0, "west": OUTER, "east": OUTER + length, "east_end": whole}
    for name, x in ends.items():
        drawn.node(name, line(x, x)[0], "dead_end" if name.endswith("end") else "priority")
    for way, nodes in zip(WAYS, ([*ends], [*reversed(ends)]), strict=True):
        for part, begin, end in zip(("_approach", "", "_exit"), nodes, nodes[1:], strict=False):
            drawn.road(f"{way}{part}", (begin, end), lanes, speed, line(ends[begin], ends[end]))
    return drawn.spec()


def social(lanes: int, length: float, slow: float, density: float, drivers: Drivers) -> dict[str, t.Traffic]:
    """Return a slow leader ahead of each start, others between, and more behind.

    Args:
        lanes: Number of lanes a direction.
        length: Length of the middle part [m].
        slow: Speed of a normal slow vehicle [m/s].
        density: Multiple of the usual rate.
        drivers: Weight of each kind of driver.
    """
    flows, moment = [], WARM_UP - 0.2
    for way in WAYS:
        for lane in range(lanes):
            goal = f"{way}_exit", lane
            leaders = [(way, lane, 26), (f"{way}_approach", lane, 102.5)]
            flows += placed(leaders, goal, moment, slowly(drivers, slow))
            others = [(way, lane, 50), (f"{way}_approach", lane, 55), (f"{way}_approach", lane, 30)]
            others += [(way, lane, 75)] if length > 85 else []
            flows += placed(others, goal, moment, drivers)
            flows.append(flow((f"{way}_approach", lane), goal, 700 * density, drivers, begin=moment))
    return traffic(flows, WARM_UP)


def draw(generator: Generator) -> t.Scenario:
    """Return a road; below 3.4 m/s a way of 202 m takes longer than a minute."""
    length, lanes = generator.uniform(60, 130), int(generator.integers(1, 3))
    width, speed = generator.uniform(3.0, 3.6), generator.choice([11.11, 13.89, 16.67])
    bend, slow = generator.choice([-1.0, 0.0, 1.0]) * generator.uniform(5, 20), generator.uniform(4, 8)
    starts = [
        (f"{way}{part}", lane, at)
        for way in WAYS
        for lane in range(lanes)
        for part, at in (("", 5), ("_approach", 80))
    ]
    goals = [(f"{way}_exit", lane, at) for way in WAYS for lane in range(lanes) for at in (60, 100)]
    return t.Scenario(
        map_spec=road_map(length, lanes, width, speed, bend),
        traffic=from_none_to_dense(lambda density, drivers: social(lanes, length, slow, density, drivers)),
        ego_missions=[t.DrawnMission(starts, goals, conflicts=0.0)],
        start_variation=START_IN_TOWN,
    )


gen_family(draw, output_dir=Path(__file__).parent)
