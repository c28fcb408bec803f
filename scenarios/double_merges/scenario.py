"""Two ramps that join in a weaving section of two to four lanes and part again."""

from math import radians
from pathlib import Path

from numpy.random import Generator

from scenarios.drivers import START_IN_TOWN, Drivers, flow, placed, slowly, traffic
from scenarios.families import PlainMap, Point, along, curve, from_none_to_dense
from smarts.sstudio import gen_family
from smarts.sstudio import types as t

RAMPS = {2: [(1, 1)], 3: [(1, 1), (2, 1), (1, 2)], 4: [(2, 2)]}
"""Lanes of the upper and the lower ramp that a weaving section of so many lanes may have."""
BEND = 27.0
"""Distance from the corner of a ramp's bend to its ends [m]."""
APPROACH, EXIT = 120.0, 60.0
"""Lengths of the straight parts of the ramps [m]."""
LIMIT = 13.89
WARM_UP = 25.0
CROSSING = 0.6
"""Share of the vehicles that leave on the other side."""
LONG = 180.0
"""Length of a weaving section from which on agents' goals are in it, no way being longer than 250 m [m]."""
SLOW = 8.0
"""Speed of a normal vehicle ahead of the agents [m/s]."""

Lanes = dict[str, int]
"""Number of lanes of the ramps "top_left", "down_left", "top_right" and "down_right"."""


def draw_lanes(generator: Generator) -> tuple[int, Lanes]:
    """Return the number of lanes of the weaving section and those of the ramps."""
    count = int(generator.integers(2, 5))
    left, right = (RAMPS[count][generator.integers(len(RAMPS[count]))] for _ in range(2))
    return count, {"top_left": left[0], "down_left": left[1], "top_right": right[0], "down_right": right[1]}


def first_lane(ramp: str, count: int, lanes: int) -> int:
    """Return the lane of a weaving section of `count` lanes that the right lane of a ramp joins or leaves."""
    return count - lanes if ramp.startswith("top") else 0


def bend(ramp: str, count: int, lanes: int, width: float, angle: float) -> list[Point]:
    """Return a ramp's points from the weaving section at (0, y) outward to the right [m]."""
    side = 1 if ramp.startswith("top") else -1
    corner = BEND, side * (count - lanes) * width / 2
    return curve((0.0, corner[1]), corner, along(corner, side * angle, BEND))


def road_map(count: int, lanes: Lanes, length: float, width: float, angles: list[float]) -> t.MapSpec:
    """Return the map, of which the weaving section of `count` lanes leads from x = 0 to `length` [m]."""
    drawn = PlainMap(width)
    drawn.node("merge_begin", (0.0, 0.0))
    drawn.node("merge_end", (length, 0.0))
    drawn.road("merge", ("merge_begin", "merge_end"), count, LIMIT, spreadType="center")
    for (ramp, number), angle in zip(lanes.items(), angles, strict=True):
        points, first = bend(ramp, count, number, width, angle), first_lane(ramp, count, number)
        heading, end = (angle if ramp.startswith("top") else -angle), f"{ramp}_end"
        if ramp.endswith("left"):
            far = along(points[-1], heading, APPROACH)
            points = [(-x, y) for x, y in reversed(points)]
            drawn.node(end, (-far[0], far[1]), "dead_end")
            drawn.node(f"{ramp}_ramp", points[0])
            approach, joint = f"{ramp}_approach", f"{ramp}_ramp"
            drawn.road(approach, (end, joint), number, LIMIT, spreadType="center")
            drawn.road(ramp, (joint, "merge_begin"), number, LIMIT, points, spreadType="center")
        else:
            points = [(length + x, y) for x, y in [*points, along(points[-1], heading, EXIT)]]
            drawn.node(end, points[-1], "dead_end")
            drawn.road(ramp, ("merge_end", end), number, LIMIT, points, spreadType="center")
        for lane in range(number):
            if ramp.endswith("left"):
                drawn.link(ramp, "merge", (lane, first + lane))
            else:
                drawn.link("merge", ramp, (first + lane, lane))
    return drawn.spec()


def social(lanes: Lanes, density: float, drivers: Drivers) -> dict[str, t.Traffic]:
    """Return vehicles from both ramps to both exits, and a slow one ahead on the outermost lanes."""
    flows = []
    for begin, same, other in (
        ("top_left", "top_right", "down_right"),
        ("down_left", "down_right", "top_right"),
    ):
        rate = (900 + 100 * lanes[begin]) * density / lanes[begin]
        for goal, share in ((other, CROSSING), (same, 1 - CROSSING)):
            for lane in range(lanes[begin]):
                end = goal, min(lane, lanes[goal] - 1)
                flows.append(flow((f"{begin}_approach", lane), end, rate * share, drivers))
    count = max(lanes["top_left"] + lanes["down_left"], lanes["top_right"] + lanes["down_right"])
    for lane, goal in ((0, "down_right"), (count - 1, "top_right")):
        leader = [("merge", lane, 25.0)]
        flows += placed(leader, (goal, 0), WARM_UP - 0.2, slowly(drivers, SLOW))
    return traffic(flows, WARM_UP, {"top_left_approach": 115, "down_left_approach": 115})


def draw(generator: Generator) -> t.Scenario:
    """Return a weaving section between ramps."""
    count, lanes = draw_lanes(generator)
    length, width = generator.uniform(120, 300), generator.uniform(3.0, 3.6)
    angles = [radians(angle) for angle in generator.uniform(12, 32, 4)]
    lefts, rights = (("top_left", "down_left"), ("top_right", "down_right"))
    starts = [(ramp, lane, at) for ramp in lefts for lane in range(lanes[ramp]) for at in (10, 30)]
    goals = [(ramp, lane, at) for ramp in rights for lane in range(lanes[ramp]) for at in (10, 40)]
    if length > LONG:
        goals = [("merge", lane, at) for lane in range(count) for at in (LONG - 60, LONG - 30)]
    return t.Scenario(
        map_spec=road_map(count, lanes, length, width, angles),
        traffic=from_none_to_dense(lambda density, drivers: social(lanes, density, drivers)),
        ego_missions=[t.DrawnMission(starts, goals)],
        start_variation=START_IN_TOWN,
    )


gen_family(draw, output_dir=Path(__file__).parent)
