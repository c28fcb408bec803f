"""Drive seeded scenes by the planners, and measure the processor time of their calls.

    python -m perf.planners [--scenes 200] [--seed 0] [--each]

A scene is a vehicle, a target pose and time, and three neighbours that drive on evenly, whatever the
vehicle does: lane changes and overtaking in traffic, turns, and drives through crossing traffic. The
vehicle plans every 0.2 s and follows its path exactly. It has reached its target where it is within 1 m and
10 degrees of it, at most 5 s late; contact is an overlap of footprints at any tenth of a second. Scenes are
drawn again in which a neighbour is near the target within 1 s of its time, or near another neighbour at the
begin, or near the vehicle within 1 s if that drives on straight.
"""

from __future__ import annotations

import argparse
import math
import time
from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.boxes import boxes_overlap
from smarts.geometry.frames import wrap_angle
from smarts.planners import BezierPlanner, Neighbours, Planner, PlanStatus, RecedingHorizonPlanner, resample
from smarts.types.streams import Purpose, stream

TICK = 0.1
PERIOD = 2
"""Ticks between two calls of the planner."""
LATEST = 5.0
"""After the target's time [s]."""
LANE = 3.5
SIZE = np.array([5.0, 2.0])
"""Of all vehicles [m]."""


class Scene(NamedTuple):
    """A task for a planner."""

    kind: str
    state: Floats
    """x, y, heading, speed, curvature, shape (5,)."""
    target: Floats
    """Time, x, y, heading, speed, shape (5,)."""
    neighbours: Floats
    """x, y, heading, speed, shape (3, 4)."""


class Outcome(NamedTuple):
    """How a drive through a scene ended."""

    reached: bool
    contact: bool
    late: float
    """When it was at the target, after the target's time [s]."""
    failed: int
    """Calls in which planning failed."""
    seconds: tuple[float, ...]
    """Processor time of each call."""


def lane_change(draw: np.random.Generator) -> Scene:
    """Return a change to a neighbouring lane, with traffic on both lanes."""
    begin, end = draw.uniform(5.0, 15.0, 2)
    duration, side = draw.uniform(4.0, 8.0), draw.choice([-1.0, 1.0])
    target = [duration, 0.5 * (begin + end) * duration * draw.uniform(0.9, 1.1), side * LANE, 0.0, end]
    around = []
    for _ in range(3):
        if draw.random() < 0.5:
            around.append([draw.uniform(-30.0, 50.0), side * LANE, 0.0, draw.uniform(0.6, 1.3) * begin])
        elif draw.random() < 0.5:
            around.append([draw.uniform(-30.0, -8.0), 0.0, 0.0, draw.uniform(0.5, 1.0) * begin])
        else:
            around.append([draw.uniform(12.0, 50.0), 0.0, 0.0, draw.uniform(0.6, 1.3) * begin])
    return Scene("lane change", np.array([0, 0, 0, begin, 0]), np.array(target), np.array(around))


def overtaking(draw: np.random.Generator) -> Scene:
    """Return a drive past a slow vehicle back to its own lane."""
    speed, duration = draw.uniform(7.0, 14.0), draw.uniform(6.0, 9.0)
    around = [[draw.uniform(20.0, 35.0), 0.0, 0.0, draw.uniform(0.0, 0.3) * speed]]
    for _ in range(2):
        around.append([draw.uniform(-40.0, 60.0), LANE, 0.0, draw.uniform(0.8, 1.3) * speed])
    target = [duration, max(speed * duration, around[0][0] + around[0][3] * duration + 20.0), 0.0, 0.0, speed]
    return Scene("overtaking", np.array([0, 0, 0, speed, 0]), np.array(target), np.array(around))


def turn(draw: np.random.Generator) -> Scene:
    """Return a turn into a crossing road, with traffic on it and oncoming."""
    radius, side = draw.uniform(8.0, 20.0), draw.choice([-1.0, 1.0])
    begin, end = draw.uniform(3.0, 8.0), draw.uniform(3.0, 6.0)
    duration = 0.5 * math.pi * radius / (0.5 * (begin + end)) * draw.uniform(1.0, 1.4)
    target = [duration, radius, side * radius, side * 0.5 * math.pi, end]
    around = [[draw.uniform(25.0, 70.0), LANE, math.pi, draw.uniform(3.0, 10.0)]]
    for _ in range(2):
        ahead = draw.random() < 0.5
        y = side * (draw.uniform(5.0, 30.0) if ahead else draw.uniform(-50.0, -10.0))
        around.append([radius, y, side * 0.5 * math.pi, draw.uniform(3.0, 9.0)])
    return Scene("turn", np.array([0, 0, 0, begin, 0]), np.array(target), np.array(around))


def crossing(draw: np.random.Generator) -> Scene:
    """Return a drive straight on through crossing traffic."""
    speed, duration = draw.uniform(5.0, 12.0), draw.uniform(5.0, 8.0)
    target = [duration, speed * duration, 0.0, 0.0, speed]
    around = []
    for _ in range(3):
        x, side, other = draw.uniform(15.0, 40.0), draw.choice([-1.0, 1.0]), draw.uniform(3.0, 12.0)
        y = -side * other * (x / speed + draw.uniform(-2.0, 2.0))
        around.append([x, y, side * 0.5 * math.pi, other])
    return Scene("crossing", np.array([0, 0, 0, speed, 0]), np.array(target), np.array(around))


KINDS = (lane_change, overtaking, turn, crossing)


def scene(seed: int, number: int) -> Scene:
    """Return one scene, somewhere and in any direction."""
    draw = stream(seed, Purpose.AGENTS, episode=number)
    while True:
        found = KINDS[number % len(KINDS)](draw)
        if _is_fair(found):
            break
    angle, where = draw.uniform(-math.pi, math.pi), draw.uniform(-500.0, 500.0, 2)
    turned = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    for rows, x in ((found.state, 0), (found.target, 1), (found.neighbours, 0)):
        rows[..., x : x + 2] = rows[..., x : x + 2] @ turned + where
        rows[..., x + 2] = wrap_angle(rows[..., x + 2] + angle)
    return found


def _is_fair(found: Scene) -> bool:
    """Return whether a scene is one that the module's text describes."""
    wide = SIZE + np.array([3.0, 0.6])
    for now in np.arange(0.0, 1.05, TICK):
        ahead = np.array([found.state[0] + found.state[3] * now, found.state[1]])
        there = _moved(found.neighbours, now)
        if boxes_overlap(ahead, 0.0, wide, there[:, :2], there[:, 2], SIZE).any():
            return False
        for at in (found.target[0] - now, found.target[0] + now):
            there = _moved(found.neighbours, at)
            if boxes_overlap(found.target[1:3], found.target[3], wide, there[:, :2], there[:, 2], SIZE).any():
                return False
    for one in range(3):
        others = np.delete(found.neighbours, one, axis=0)
        mine = found.neighbours[one]
        if boxes_overlap(mine[:2], mine[2], wide, others[:, :2], others[:, 2], SIZE).any():
            return False
    return True


def _moved(rows: Floats, seconds: float) -> Floats:
    """Return neighbours after a time of even driving."""
    moved = rows.copy()
    moved[:, 0] += seconds * rows[:, 3] * np.cos(rows[:, 2])
    moved[:, 1] += seconds * rows[:, 3] * np.sin(rows[:, 2])
    return moved


def drive(found: Scene, planner: Planner) -> Outcome:
    """Drive through a scene until the target, a contact, or the latest time."""
    state, target, last = found.state.copy(), found.target, None
    seconds, failed, contact = [], 0, False
    for tick in range(round((target[0] + LATEST) / TICK)):
        there = _moved(found.neighbours, tick * TICK)
        if tick % PERIOD == 0:
            rows = np.concatenate([np.zeros((3, 1)), there], axis=1)[None, :, None]
            around = Neighbours(rows, np.tile(SIZE, (1, 3, 1)))
            left = np.array([[target[0] - tick * TICK, *target[1:]]])
            begin = time.process_time()
            plans = planner.plan(state[None], left, around, last, PERIOD * TICK)
            seconds.append(time.process_time() - begin)
            failed += int(plans.status[0] != PlanStatus.PLANNED)
            if plans.status[0] == PlanStatus.FAILED:
                break
            last = plans.path
        assert last is not None
        ticks = tick % PERIOD * TICK + np.array([[TICK - 0.01, TICK]])
        before, after = resample(last, ticks)[0, :, 1:]
        way = max(math.hypot(*(after[:2] - before[:2])), 1e-3)
        state = np.array([*after, wrap_angle(after[2] - before[2]) / way if after[3] > 0.5 else 0.0])
        there = _moved(found.neighbours, (tick + 1) * TICK)
        contact = bool(boxes_overlap(state[:2], state[2], SIZE, there[:, :2], there[:, 2], SIZE).any())
        off = math.hypot(*(state[:2] - target[1:3])), abs(wrap_angle(state[2] - target[3]))
        if contact or (off[0] < 1.0 and off[1] < math.radians(10.0)):
            late = (tick + 1) * TICK - target[0]
            return Outcome(not contact, contact, late, failed, tuple(seconds))
    return Outcome(False, contact, math.nan, failed, tuple(seconds))


def report(planner: Planner, scenes: list[Scene], each: bool) -> None:
    """Drive and print, by kind of scene, then the times."""
    drive(scenes[0], planner)  # compiles the kernels
    outcomes = [drive(found, planner) for found in scenes]
    print(f"{type(planner).__name__}: reached {sum(o.reached for o in outcomes)} of {len(outcomes)}")
    for kind in dict.fromkeys(found.kind for found in scenes):
        of_kind = [o for o, found in zip(outcomes, scenes, strict=True) if found.kind == kind]
        late = [o.late for o in of_kind if o.reached]
        ends = f"{len(late):3} of {len(of_kind):3}, contact {sum(o.contact for o in of_kind):2}"
        print(f"  {kind:12} {ends}" + (f", median {np.median(late):+.1f} s late" if late else ""))
    times = 1e3 * np.concatenate([o.seconds for o in outcomes])
    median, high = np.percentile(times, [50, 99])
    print(
        f"  processor time of {len(times)} calls: median {median:.2f} ms, p99 {high:.2f} ms,"
        f" most {times.max():.2f} ms; {sum(o.failed for o in outcomes)} calls failed"
    )
    for number, outcome in enumerate(outcomes):
        if each and not outcome.reached:
            print(f"  {number} {scenes[number].kind}: {outcome._replace(seconds=())}")


def main() -> None:
    """Print a table for each planner."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--each", action="store_true", help="list the drives that did not reach their target")
    asked = parser.parse_args()
    scenes = [scene(asked.seed, number) for number in range(asked.scenes)]
    for planner in (RecedingHorizonPlanner(), BezierPlanner()):
        report(planner, scenes, asked.each)


if __name__ == "__main__":
    main()
