"""Ramps that join a road of two or three lanes by an acceleration lane."""

import math
from pathlib import Path

from numpy.random import Generator

from scenarios.drivers import START_ON_A_FAST_ROAD, Drivers, flow, traffic
from scenarios.families import PlainMap, along, curve, from_none_to_dense
from smarts.sstudio import gen_family
from smarts.sstudio import types as t

WARM_UP = 20.0
MAIN, AFTER = 280.0, 180.0
"""Lengths of the road before and behind the acceleration lane [m]."""
RAMP = 170.0
"""Length of the ramp before its bend [m]."""
BEND = 20.0
"""Distance from the corner of the ramp's bend to its ends [m]."""
FILLED = {"main_in": 270, "ramp": 170}


def road_map(lanes: int, joined: float, width: float, speed: float, angle: float) -> t.MapSpec:
    """Return the map; the acceleration lane leads from x = 0 to `joined` [m]."""
    drawn = PlainMap(width)
    y = -lanes * width
    line = curve((0.0, y), (-BEND, y), along((-BEND, y), math.pi + angle, BEND))
    line.append(along(line[-1], math.pi + angle, RAMP))
    places = {"main_start": (-MAIN, 0.0), "ramp_start": line[-1], "main_end": (joined + AFTER, 0.0)}
    for name, place in places.items():
        drawn.node(name, place, "dead_end")
    drawn.node("gore", (0.0, 0.0))
    drawn.node("lane_end", (joined, 0.0))
    drawn.road("main_in", ("main_start", "gore"), lanes, speed, priority="3")
    drawn.road("ramp", ("ramp_start", "gore"), 1, min(speed, 16.67), line[::-1], priority="1")
    drawn.road("merge", ("gore", "lane_end"), lanes + 1, speed, priority="3")
    drawn.road("main_out", ("lane_end", "main_end"), lanes, speed, priority="3")
    drawn.link("ramp", "merge", (0, 0))
    for lane in range(lanes):
        drawn.link("main_in", "merge", (lane, lane + 1))
        drawn.link("merge", "main_out", (lane + 1, lane))
    return drawn.spec()


def social(lanes: int, density: float, drivers: Drivers) -> dict[str, t.Traffic]:
    """Return vehicles on the road and on the ramp."""
    flows = [flow(("ramp", 0), ("main_out", 0), 350 * density, drivers)]
    for lane in range(lanes):
        flows.append(flow(("main_in", lane), ("main_out", lane), 1100 * density, drivers))
    return traffic(flows, WARM_UP, FILLED)


def draw(generator: Generator) -> t.Scenario:
    """Return a ramp to a road."""
    lanes, joined = int(generator.integers(2, 4)), generator.uniform(80, 150)
    width, speed = generator.uniform(3.2, 3.7), generator.choice([16.67, 19.44, 22.22])
    angle = math.radians(generator.uniform(8, 20))
    starts = [("ramp", 0, at) for at in (150, 180)]
    starts += [("main_in", lane, at) for lane in range(lanes) for at in (220, 250)]
    goals = [("main_out", lane, at) for lane in range(lanes) for at in (30, 60)]
    return t.Scenario(
        map_spec=road_map(lanes, joined, width, speed, angle),
        traffic=from_none_to_dense(lambda density, drivers: social(lanes, density, drivers)),
        ego_missions=[t.DrawnMission(starts, goals)],
        start_variation=START_ON_A_FAST_ROAD,
    )


gen_family(draw, output_dir=Path(__file__).parent)
