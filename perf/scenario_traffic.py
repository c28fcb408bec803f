"""Traffic of the suite: `python -m perf.scenario_traffic` rewrites the table in docs/guide/scenarios.md."""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from smarts.envision.route_lines import route_line
from smarts.providers.sumo_traffic import sumo_options
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio import types as t
from smarts.sstudio.build import build_scenario, suite
from smarts.sstudio.built import BuiltScenario
from smarts.types.vehicles import VehicleKind, VehicleStates

RADIUS = 100.0
"""Vehicles this near are around an ego [m]."""
SPACING = 10.0
"""Between the places on an ego's way at which vehicles are counted [m]."""
FULL = "random_social_vehicles"
STANDING = 0.1
"""Slower counts as standing [m/s]."""
PAGE = Path(__file__).resolve().parents[1] / "docs" / "guide" / "scenarios.md"
TABLE_BEGIN, TABLE_END = "<!-- survey: begin -->", "<!-- survey: end -->"


@dataclass(frozen=True)
class Density:
    """How full a scenario is, on average over episodes and time."""

    at_start: float
    """Vehicles around a place on an ego's way when the episode begins."""
    around_egos: float
    """The same over the whole time."""
    vehicles: float
    """On the whole map."""
    fewest: int
    """On the whole map, at any moment."""


@dataclass(frozen=True)
class Flow:
    """How well the traffic gets on without egos."""

    speed: float
    """On average [m/s]."""
    last_speed: float
    """On average over the last minute [m/s]."""
    longest_stand: float
    """The longest time that any car stood without a break [s]; buses wait at stops and do not count."""
    collisions: int
    """Pairs of vehicles that SUMO reports as collided."""
    vehicle_hours: float
    """In which they happened [h]."""


def mission_places(built: BuiltScenario) -> NDArray[np.float64]:
    """Return places from start to goal of all missions, evenly spaced along their routes, shape (P, 2)."""
    return np.concatenate([_along(route_line(built.roads(), route)) for route in mission_routes(built)])


def mission_routes(built: BuiltScenario) -> list[t.Route]:
    """Return the fixed routes among the missions."""
    routes = [
        mission.route for mission in built.scenario.ego_missions or () if isinstance(mission, t.Mission)
    ]
    return [route for route in routes if isinstance(route, t.Route)]


def _along(line: NDArray[np.float64]) -> NDArray[np.float64]:
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    places = np.arange(0.0, s[-1], SPACING)
    return np.stack([np.interp(places, s, line[:, axis]) for axis in (0, 1)], axis=1)


def density(built: BuiltScenario, *, episodes: int = 10, seconds: float = 30.0, seed: int = 0) -> Density:
    """Count the vehicles near the egos' ways in the first `seconds` of some episodes, twice a second."""
    places = mission_places(built)
    starts, around, vehicles = [], [], []
    for episode in range(episodes):
        with traffic_run(built, FULL, seed=seed, episode=episode) as run:
            starts.append(_count(run.states, places))
            for step, states in enumerate(run.steps(seconds)):
                if step % 5 == 0:
                    around.append(_count(states, places))
                    vehicles.append(int(states.alive.sum()))
    return Density(float(np.mean(starts)), float(np.mean(around)), float(np.mean(vehicles)), min(vehicles))


def _count(states: VehicleStates, places: NDArray[np.float64]) -> float:
    offset = states.position[states.alive][None] - places[:, None]
    return float((np.hypot(offset[..., 0], offset[..., 1]) < RADIUS).sum(axis=1).mean())


def flow(built: BuiltScenario, *, seconds: float = 300.0, seed: int = 0) -> Flow:
    """Watch one long episode without egos."""
    speeds, last = [], []
    longest = 0.0
    with traffic_run(built, FULL, seed=seed) as run:
        standing = np.zeros(run.states.capacity)
        generation = run.states.generation.copy()
        for step, states in enumerate(run.steps(seconds)):
            waits = states.alive & (states.speed < STANDING) & (states.kind != VehicleKind.BUS)
            standing = np.where(waits & (generation == states.generation), standing + run.dt, 0.0)
            generation = states.generation.copy()
            longest = max(longest, float(standing.max()))
            speeds.append(states.speed[states.alive].mean())
            last += [speeds[-1]] if step * run.dt >= seconds - 60 else []
    collisions, vehicle_hours = _collisions(built, seconds, seed)
    return Flow(float(np.mean(speeds)), float(np.mean(last)), longest, collisions, vehicle_hours)


def _collisions(built: BuiltScenario, seconds: float, seed: int) -> tuple[int, float]:
    """Run plain SUMO with its collision check and return (pairs that collided, hours driven)."""
    files = built.traffic_files(FULL)
    options = sumo_options(files, seed, 0.1)
    options[options.index("--collision.action") + 1] = "warn"
    package = find_spec("sumo")
    if package is None or package.origin is None:
        raise ModuleNotFoundError("eclipse-sumo is not installed", name="sumo")
    with tempfile.TemporaryDirectory(prefix="smarts-survey-") as folder:
        collided, statistics = Path(folder) / "collisions.xml", Path(folder) / "summary.xml"
        command = [str(Path(package.origin).parent / "bin" / "sumo"), *options]
        command += ["--end", str(files.warm_up + seconds)]
        command += ["--collision-output", str(collided), "--summary-output", str(statistics)]
        subprocess.run(command, check=True, capture_output=True)
        pairs = {(c.get("collider"), c.get("victim")) for c in ElementTree.parse(collided).iter("collision")}
        running = sum(int(step.get("running", 0)) for step in ElementTree.parse(statistics).iter("step"))
    return len(pairs), running * 0.1 / 3600


def table(names: Sequence[str]) -> str:
    """Return the survey of some scenarios as a Markdown table."""
    lines = [
        "| scenario | egos | around an ego at the start | in the first 30 s | on the map | mean speed [m/s]"
        " | longest stand [s] | collisions per vehicle-hour |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in names:
        built = build_scenario(name)
        full, moving, egos = density(built), flow(built), len(built.scenario.ego_missions or ())
        lines.append(
            f"| {name} | {egos} | {full.at_start:.1f} | {full.around_egos:.1f}"
            f" | {full.vehicles:.0f} | {moving.speed:.1f} | {moving.longest_stand:.0f}"
            f" | {moving.collisions} in {moving.vehicle_hours:.1f} h |"
        )
    return "\n".join(lines)


def main() -> None:
    """Rewrite the table in the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--page", type=Path, default=Path(__file__).resolve().parents[1] / "docs/guide/scenarios.md"
    )
    page: Path = parser.parse_args().page
    before, _, rest = page.read_text(encoding="utf-8").partition(TABLE_BEGIN)
    _, _, after = rest.partition(TABLE_END)
    body = f"{TABLE_BEGIN}\n{table(list(suite()))}\n{TABLE_END}"
    page.write_text(before + body + after, encoding="utf-8")
    print(body)


if __name__ == "__main__":
    main()
