"""Crossings of three to five arms, with one to three lanes a direction, some with signals."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

from numpy.random import Generator

from scenarios.drivers import START_IN_TOWN, Drivers, flow, inattentive_car, traffic
from scenarios.families import PlainMap, along, from_none_to_dense
from smarts.sstudio import gen_family
from smarts.sstudio import types as t

LEAST_ANGLE = {3: math.radians(70), 4: math.radians(60), 5: math.radians(55)}
"""Least angle between neighbouring arms, by their number."""
STRAIGHT_ON = math.radians(50)
"""Largest turn that counts as straight on."""
CORNER = 4.0
"""Length of the junction beyond the roads' overlap, as netconvert makes it [m]."""
INATTENTIVE = replace(
    inattentive_car, junction_model=t.JunctionModel(impatience=0.5, ignore_junction_foe_prob=0.1)
)
"""Version 1's, but for overlooking a vehicle that crosses in the junction in each of its decisions, one a
second, by a chance of 0.1 and not always: these hit each other 4.7 times in a vehicle-hour, as version 1's
do at its own intersection (4.5), and others 0.3 times where they are a tenth of all."""
OUTER = 100.0
"""Length of the roads on which traffic arrives and leaves [m]."""


@dataclass(frozen=True)
class Arm:
    """A road to and from the crossing."""

    name: str
    angle: float
    """Direction in which it leads away from the crossing [rad]."""
    lanes: int
    """Number of lanes a direction."""
    is_main: bool
    """Whether it is one of the two arms of the road with priority."""


Turn = tuple[Arm, float, list[tuple[int, int]]]
"""The arm behind the crossing, the angle, positive to the left, and the lanes that are connected."""


def draw_arms(generator: Generator) -> list[Arm]:
    """Return the arms counter-clockwise; the main road is the pair that is straightest."""
    count = int(generator.integers(3, 6))
    spare = 2 * math.pi - count * LEAST_ANGLE[count]
    gaps = LEAST_ANGLE[count] + spare * generator.dirichlet([2.0] * count)
    angles = [float(angle) for angle in generator.uniform(0, 2 * math.pi) + gaps.cumsum()]
    main_lanes = int(generator.integers(1, 4))
    side_lanes = int(generator.integers(1, min(main_lanes, 2) + 1))
    pairs = [(i, j) for i in range(count) for j in range(i)]
    main = min(pairs, key=lambda pair: abs(turn_angle(angles[pair[0]], angles[pair[1]])))
    return [
        Arm(f"arm{i}", angle, main_lanes if i in main else side_lanes, i in main)
        for i, angle in enumerate(angles)
    ]


def turn_angle(begin: float, end: float) -> float:
    """Return the turn from one arm into another, both given by their angles, positive to the left [rad]."""
    return (end - begin) % (2 * math.pi) - math.pi


def turns_of(arm: Arm, arms: list[Arm]) -> list[Turn]:
    """Return the turns from an arm, from right to left.

    All lanes lead straight on, the rightmost to the right, the leftmost to the left. Where no arm is straight
    on, the lanes are shared between right and left, and the middle one of three leads both ways.
    """
    others = [other for other in arms if other != arm]
    angles = sorted((turn_angle(arm.angle, other.angle), other) for other in others)
    nearest = min(angles, key=lambda each: abs(each[0]))[0]
    split = nearest if abs(nearest) < STRAIGHT_ON else 0.0
    rights = [each for each in angles if each[0] < split]
    lefts = [each for each in angles if each[0] > split]
    last, found = arm.lanes - 1, []
    for angle, other in angles:
        lanes = range(arm.lanes)
        if angle < split:
            lanes = range(last // 2 + 1) if split == 0.0 and lefts and angle == rights[-1][0] else range(1)
        elif angle > split:
            lanes = range(arm.lanes // 2, arm.lanes) if split == 0.0 and angle == lefts[0][0] else [last]
        shift = other.lanes - arm.lanes if angle > split else 0
        found.append((other, angle, [(lane, lane + shift) for lane in lanes if lane + shift >= 0]))
    return found


def road_map(arms: list[Arm], lengths: list[float], width: float, speed: float, signals: bool) -> t.MapSpec:
    """Return the map; `lengths` [m] are those of the arms' roads at the crossing, beyond their overlap."""
    drawn = PlainMap(width)
    drawn.node("center", (0.0, 0.0), "traffic_light" if signals else "priority")
    for arm, length in zip(arms, lengths, strict=True):
        distance = length + CORNER + max(overlap(arm, other, width) for other in arms if other != arm)
        priority = str(2 if arm.is_main and not signals else 1)
        near, far = arm.name, f"{arm.name}_end"
        drawn.node(near, along((0.0, 0.0), arm.angle, distance))
        drawn.node(far, along((0.0, 0.0), arm.angle, distance + OUTER), "dead_end")
        for part, ends in (
            ("approach", (far, near)),
            ("in", (near, "center")),
            ("out", ("center", near)),
            ("exit", (near, far)),
        ):
            drawn.road(f"{arm.name}_{part}", ends, arm.lanes, speed, priority=priority)
        for other, angle, lanes in turns_of(arm, arms):
            # Left turns wait at the stop line: SUMO's drivers hit vehicles that wait in the junction.
            waits = {"contPos": "0"} if angle > STRAIGHT_ON else {}
            for pair in lanes:
                drawn.link(f"{arm.name}_in", f"{other.name}_out", pair, **waits)
    return drawn.spec()


def overlap(arm: Arm, other: Arm, width: float) -> float:
    """Return how far from the centre two arms' roads part [m]."""
    between = abs(turn_angle(arm.angle, other.angle) % (2 * math.pi) - math.pi)
    if between > math.radians(150):
        return 0.0
    return width * (other.lanes + arm.lanes * math.cos(between)) / math.sin(between)


def social(arms: list[Arm], density: float, drivers: Drivers) -> dict[str, t.Traffic]:
    """Return vehicles from every arm into every other one, most of them straight on."""
    flows = []
    for arm in arms:
        rate = (220 + 130 * arm.lanes) * 4 / len(arms) * density
        turns = turns_of(arm, arms)
        weights = [len(lanes) if abs(angle) < STRAIGHT_ON else 0.5 for _, angle, lanes in turns]
        for (other, _, lanes), weight in zip(turns, weights, strict=True):
            for begin, end in lanes:
                share = weight / len(lanes) / sum(weights)
                flows.append(
                    flow((f"{arm.name}_approach", begin), (f"{other.name}_exit", end), rate * share, drivers)
                )
    return traffic(flows, 30.0, {f"{arm.name}_approach": 95 for arm in arms})


def draw(generator: Generator) -> t.Scenario:
    """Return a crossing; offsets of starts are 15 m or more before the shortest road's end."""
    arms = draw_arms(generator)
    lengths = [float(length) for length in generator.uniform(55, 80, len(arms))]
    width, speed = generator.uniform(3.0, 3.6), generator.choice([11.11, 13.89])
    # Side roads would wait for minutes for a gap in three lanes.
    signals = any(arm.lanes == 3 for arm in arms) or bool(generator.random() < 0.2)
    starts = [(f"{arm.name}_in", lane, at) for arm in arms for lane in range(arm.lanes) for at in (10, 35)]
    goals = [(f"{arm.name}_exit", lane, at) for arm in arms for lane in range(arm.lanes) for at in (40, 80)]
    return t.Scenario(
        map_spec=road_map(arms, lengths, width, speed, signals),
        traffic=from_none_to_dense(lambda density, drivers: social(arms, density, drivers), INATTENTIVE),
        ego_missions=[t.DrawnMission(starts, goals)],
        start_variation=START_IN_TOWN,
    )


gen_family(draw, output_dir=Path(__file__).parent)
