"""Let a vehicle cut across each kind of social driver, and print how they react.

    python -m perf.social_drivers [--kinds KIND...] [--encounters 40] [--seed 7]

The vehicle drives as on rails, at constant speed; each encounter has one driver of SUMO, on empty roads.

- crossing: on the intersection's minor road, the vehicle crosses ahead of a driver with priority that would
  arrive 0 to 1 s later. Printed: how often the driver gave way, so that they did not touch.
- cut_in: on the weaving section, the vehicle changes into the driver's lane, 4 to 16 m ahead of it and
  slower. Printed: how often they did not touch.
- gap: the vehicle has priority, and would arrive 1 to 6 s after a driver on the minor road. Printed: how
  often the driver waited.
"""

from __future__ import annotations

import argparse
import math
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmark.statistics import wilson_interval
from scenarios.drivers import KINDS, Drivers
from smarts.geometry.boxes import boxes_overlap
from smarts.sim.traffic_run import TrafficRun, traffic_run
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t
from smarts.sstudio.build import build_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.types.streams import Purpose, stream
from smarts.types.vehicles import Owner, VehicleKind

SCENARIOS = Path(__file__).parents[1] / "scenarios"
ONE = "one"
LENGTH, WIDTH = 5.0, 1.8
"""Of both [m]."""
INNER = 1.6
"""Distance of the inner lanes from the middle of the intersection, and of both lanes of the weave [m]."""
LONGEST = 60.0
"""Of an encounter [s]."""

Pose = tuple[float, float, float]
"""x, y of the centre [m], heading [rad]."""


@dataclass(frozen=True)
class Encounter:
    """A driver of traffic and a vehicle whose ways meet."""

    scenario: str
    """Whose map it is."""
    begin: tuple[str, int, float]
    """Where the driver departs."""
    end: tuple[str, int]
    axis: int
    """Of the driver's way: 0 eastward, 1 northward."""
    appears: float
    """Where on it the driver's front is when the vehicle appears [m]."""
    passed: float
    """Where its centre is when it has passed the vehicle's way [m]."""
    speed: float
    """Of the vehicle [m/s]."""
    drawn: tuple[float, float]
    """Range of the drawn number: a time [s] or a gap [m]."""
    start: Callable[[float, float], Pose]
    """Returns the vehicle's first pose from the driver's time to the place where they meet, or its front, and
    the drawn number."""
    sideways: float = 0.0
    """Change of lane of the vehicle within `CHANGE` [m]."""
    left: Callable[[Pose], bool] = lambda _: False
    """Returns whether the vehicle has passed the driver's way."""


CHANGE = 3.0
"""Duration of a lane change [s]."""
PAST = WIDTH / 2 + LENGTH / 2
"""Distance of a centre from another way's middle at which a vehicle has just passed it [m]."""
CROSS_SPEED, MAJOR_SPEED, CUT_SPEED = 6.0, 10.0, 7.0

ENCOUNTERS = {
    "crossing": Encounter(
        "intersection",
        ("south_approach", 1, 40.0),
        ("north_exit", 1),
        axis=1,
        appears=-60.0,
        passed=-INNER + PAST,
        speed=CROSS_SPEED,
        drawn=(0.0, 1.0),
        start=lambda arrival, lag: (INNER - PAST - CROSS_SPEED * (arrival - lag), -INNER, 0.0),
        left=lambda pose: pose[0] > INNER + PAST,
    ),
    "gap": Encounter(
        "intersection",
        ("west_approach", 1, 40.0),
        ("east_exit", 1),
        axis=0,
        appears=-45.0,
        passed=INNER + PAST,
        speed=MAJOR_SPEED,
        drawn=(1.0, 6.0),
        start=lambda arrival, lag: (INNER, -INNER - PAST - MAJOR_SPEED * (arrival + lag), math.pi / 2),
        left=lambda pose: pose[1] > -INNER + PAST,
    ),
    "cut_in": Encounter(
        "double_merge",
        ("down_left_approach", 0, 60.0),
        ("down_right", 0),
        axis=0,
        appears=70.0,
        passed=math.inf,
        speed=CUT_SPEED,
        drawn=(4.0, 16.0),
        start=lambda front, room: (front + room + LENGTH / 2, INNER, 0.0),
        sideways=-2 * INNER,
        left=lambda pose: pose[0] > 220.0,
    ),
}


def build(encounter: Encounter, drivers: Drivers, folder: Path) -> BuiltScenario:
    """Build an encounter's scenario with one driver of some kinds into a folder."""
    for file in (SCENARIOS / encounter.scenario).glob("map.*.xml"):
        shutil.copy(file, folder)
    route = t.Route(begin=encounter.begin, end=(*encounter.end, "max"))
    alone = t.Traffic(flows=[t.Flow(route=route, rate=1, end=1, actors=dict(drivers))])
    gen_scenario(t.Scenario(traffic={ONE: alone}), output_dir=folder)
    return build_scenario(folder)


def gives_way(encounter: Encounter, built: BuiltScenario, drawn: float, seed: int) -> bool:
    """Play an encounter; return whether the driver let the vehicle go first, without touching it.

    Args:
        encounter: Which one.
        built: Its scenario.
        drawn: A number of `encounter.drawn`.
        seed: Of the driver.
    """
    driver = vehicle = -1
    first: Pose = (0.0, 0.0, 0.0)
    time = 0.0
    with traffic_run(built, ONE, seed=seed) as run:
        for states in run.steps(LONGEST):
            if driver < 0:
                driver = int(np.argmax(states.alive)) if states.alive.any() else -1
                continue
            centre = float(states.position[driver, encounter.axis])
            if not states.alive[driver] or centre > encounter.passed:
                return False
            if vehicle < 0:
                front = centre + LENGTH / 2
                if front < encounter.appears:
                    continue
                first = encounter.start(_arrival(encounter, front, float(states.speed[driver])), drawn)
                vehicle = run.world.registry.admit(
                    0, "vehicle", Owner.AGENT, VehicleKind.PASSENGER, LENGTH, WIDTH
                )
            elif _touch(run, driver, vehicle):
                return False
            elif encounter.left(_moved(encounter, first, time)):
                return True
            time += run.dt
            x, y, heading = _moved(encounter, first, time)
            states.position[vehicle], states.heading[vehicle] = (x, y), heading
            states.speed[vehicle] = encounter.speed
    return False


def _arrival(encounter: Encounter, front: float, speed: float) -> float:
    """Return the driver's time to the begin of the vehicle's way [s]; its front, if they share the way."""
    if math.isinf(encounter.passed):
        return front
    return (encounter.passed - 2 * PAST + LENGTH / 2 - front) / max(speed, 0.1)


def _moved(encounter: Encounter, first: Pose, time: float) -> Pose:
    x, y, heading = first
    along = encounter.speed * time
    aside = encounter.sideways * min(time / CHANGE, 1.0)
    return x + along * math.cos(heading), y + along * math.sin(heading) + aside, heading


def _touch(run: TrafficRun, *slots: int) -> bool:
    states = run.states
    boxes = [
        part
        for slot in slots
        for part in (states.position[slot], states.heading[slot], (states.length[slot], states.width[slot]))
    ]
    return bool(boxes_overlap(*boxes))


def share(name: str, drivers: Drivers, count: int, seed: int) -> float:
    """Return how often drivers give way in `count` encounters of a kind, drawn from `seed`."""
    encounter, draws = ENCOUNTERS[name], stream(seed, Purpose.STARTS)
    with tempfile.TemporaryDirectory(prefix="smarts-drivers-") as folder:
        built = build(encounter, drivers, Path(folder))
        numbers = draws.uniform(*encounter.drawn, size=count)
        return sum(gives_way(encounter, built, drawn, seed + k) for k, drawn in enumerate(numbers)) / count


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--kinds", nargs="+", default=[*KINDS], choices=[*KINDS])
    parser.add_argument("--encounters", type=int, default=40)
    parser.add_argument("--seed", type=int, default=7)
    given = parser.parse_args()
    print(f"| gave way in {given.encounters} of | {' | '.join(ENCOUNTERS)} |")
    print("|---|" + "---|" * len(ENCOUNTERS))
    for kind in given.kinds:
        cells = []
        for name in ENCOUNTERS:
            found = share(name, KINDS[kind], given.encounters, given.seed)
            low, high = wilson_interval(found, given.encounters)
            cells.append(f"{found:.2f} [{low:.2f}, {high:.2f}]")
        print(f"| {kind} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
