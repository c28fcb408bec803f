"""Imitated drivers in closed loop, beside constant speed and the intelligent driver model (IDM).

    python -m perf.imitation simulate FOLDER [--hours 1]
    python -m perf.imitation compare SCENARIO RUN [--begin 2400 --end 3600 --every 20 --traffic recorded]

`simulate` writes a scenario with recorded traffic of SUMO in which three kinds of drivers are mixed; names of
vehicles begin with their kind. Its traffic "early" is the first two thirds. `compare` has all vehicles driven
for 5 s along the paths that they were recorded on, again and again: by the policy of a run of `bc` that acts
by `AlongPath`, by IDM with the zoo's parameters, at constant speed, and, for collisions and headways, as
recorded. Until the 5 s begin vehicles drive as recorded. Intervals resample vehicles, each with all its
scenes; with under 20 vehicles there is none.

The table of docs/guide/recorded.md, with west and merge imported from MONA's files, and in west's scenario.py
a traffic "early" with end=45, mode="log" before "recorded":

    python -m perf.imitation simulate road
    smarts-bench demonstrations road --traffic early --out road.parquet --action AlongPath \
        --observation "{frames: 4, stacked: [car_following]}"
    smarts-bench run road.yaml --out results
    python -m perf.imitation compare road results/road/bc/road/recorded/seed_1

and so with west, then

    python -m perf.imitation compare west results/west/bc/west/recorded/seed_1 --begin 45 --end 60 --every 5
    python -m perf.imitation compare merge results/west/bc/west/recorded/seed_1 --begin 0 --end 60 --every 5

road.yaml; west.yaml has 1_000_000 agent steps and the settings that follow:

    name: road
    algorithms: [bc]
    tasks: [{name: road, scenarios: [road]}]
    traffic: [recorded]
    seeds: [1]
    environment:
      agents: 1
      action: AlongPath
      vehicle_model: kinematic
      observation: {frames: 4, stacked: [car_following]}
    settings: {bc: {data: road.parquet, noise: 0.0, updates: 500, hidden: [128, 128],
                    lr: [[0, 1e-3], [15_000_000, 1e-4]]}}
    # settings: {bc: {data: west.parquet, noise: 0.05, updates: 200, lr: 5e-4}}
    budget: {agent_steps: 20_000_000}
    evaluation: {validations: 0}
"""

from __future__ import annotations

import argparse
import subprocess
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import sumo
import torch
from numpy.typing import NDArray

from algorithms.joint.batch import GroupView
from algorithms.joint.spaces import to_env
from benchmark.metrics.realism import LEAST_SCENES
from benchmark.results.run_folder import RunFolder
from benchmark.running.policy import checked_modules, read_run
from benchmark.statistics.resampling import bootstrap_counts, bootstrap_interval
from smarts.env.traffic_agents import TrafficAgents
from smarts.geometry.boxes import boxes_overlap
from smarts.observations.surroundings import LANE_TRAFFIC, OWN_VEHICLE, Lane, Own
from smarts.recordings.importing import import_recording
from smarts.recordings.log import NAME, Log
from smarts.recordings.reading import Source
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.streams import Purpose, stream
from smarts.zoo.driving import Idm

INTERVAL, TIME = 5, 0.5
DECISIONS = 10
"""Decisions of 0.5 s in a scene of 5 s."""
CATCHING_UP = 0.8
"""How much faster than recorded a vehicle drives that is a metre late, before the 5 s begin [1/s]."""
BEFORE = 6
"""Decisions as recorded before that, for policies with a history."""
NODES = "".join(f'<node id="{n}" x="{x}" y="0"/>' for n, x in enumerate((0, 500, 800, 1200)))
EDGES = "".join(
    f'<edge id="e{n}" from="{n}" to="{n + 1}" numLanes="2" speed="{speed}"/>'
    for n, speed in enumerate((25, 15, 25))
)
DRIVERS = {
    "quick": 'tau="0.8" accel="2.2" decel="3.5" speedFactor="normc(1.1,0.05)" length="5"',
    "calm": 'tau="2.0" accel="1.2" decel="2.0" speedFactor="normc(0.95,0.05)" length="5"',
    "truck": 'tau="1.6" accel="0.9" decel="2.0" speedFactor="normc(0.85,0.03)" length="7.1" vClass="truck"',
}
RATES = {"quick": 700, "calm": 600, "truck": 150}
"""Vehicles per hour."""


def simulate(folder: Path, hours: float) -> None:
    """Write a scenario with a recording of SUMO's traffic."""
    with TemporaryDirectory() as temporary:
        place = Path(temporary, "road")
        place.mkdir()
        Path(place, "nodes.xml").write_text(f"<nodes>{NODES}</nodes>")
        Path(place, "edges.xml").write_text(f"<edges>{EDGES}</edges>")
        kinds = "".join(
            f'<vType id="{name}" carFollowModel="IDM" minGap="2" {given}/>' for name, given in DRIVERS.items()
        )
        flows = "".join(
            f'<flow id="{name}" type="{name}" end="{3600 * hours}" from="e0" to="e2" departLane="random" '
            f'departSpeed="max" period="exp({rate / 3600})"/>'
            for name, rate in RATES.items()
        )
        Path(place, "routes.xml").write_text(f"<routes>{kinds}{flows}</routes>")
        binaries = Path(sumo.SUMO_HOME, "bin")
        net, fcd = Path(place, "map.net.xml"), Path(place, "fcd.xml")
        made = f"-n {place}/nodes.xml -e {place}/edges.xml -o {net} --offset.disable-normalization"
        subprocess.run([binaries / "netconvert", *made.split()], check=True, capture_output=True)
        played = (
            f"-n {net} -r {place}/routes.xml --step-length 0.1 --fcd-output {fcd} --device.fcd.period 0.2"
        )
        played += f" --end {3600 * hours} --lanechange.duration 3 --seed 1 --no-step-log"
        subprocess.run([binaries / "sumo", *played.split()], check=True)
        for line in import_recording(Source(fcd), folder, licence="simulated", map_file=net):
            print(line)
    whole = 't.Traffic([], engine="Recorded", recording=t.Recording(".", mode="log"))'
    early = whole.replace('"log"', f'"log", end={2400.0 * hours}')
    text = Path(folder, "scenario.py").read_text()
    old = '"recorded": t.Traffic([], engine="Recorded", recording=t.Recording("."))'
    Path(folder, "scenario.py").write_text(text.replace(old, f'"early": {early}, "recorded": {whole}'))


class Scenes:
    """Times of a recording from which on vehicles are driven for 5 s.

    Args:
        scenario: The scenario.
        traffic: Variation of its traffic, which is recorded.
        times: The times [s].
    """

    def __init__(self, scenario: str, traffic: str, times: NDArray) -> None:
        self.built, self.traffic, self.times = build_scenario(scenario), traffic, times
        recording = self.built.traffic_files(traffic).recording
        if recording is None:
            raise SystemExit(f"the traffic {traffic!r} is not recorded")
        self._paths = Log.load(recording.log)
        self._number = {NAME + name: number for number, name in enumerate(self._paths.names)}

    def at(self, name: str, time: float) -> NDArray:
        """Return x, y, speed of a vehicle at a time; not a number where it is not recorded."""
        paths, number = self._paths.paths, self._number[name]
        rows = slice(paths.sample[number], paths.sample[number + 1])
        columns, outside = (paths.x, paths.y, paths.speed), {"left": np.nan, "right": np.nan}
        return np.array([np.interp(time, paths.t[rows], column[rows], **outside) for column in columns])

    def _speeds(self, agents: TrafficAgents, names: Sequence[str], slots: NDArray, now: float) -> NDArray:
        """Return the speeds with which vehicles are where they were recorded after a decision."""
        heading, position = agents.vehicles.heading[slots], agents.vehicles.position[slots]
        there = np.array([self.at(name, now)[:2] for name in names]).reshape(-1, 2) - position
        late = there[:, 0] * np.cos(heading) + there[:, 1] * np.sin(heading)
        return np.array([self.at(name, now + TIME)[2] for name in names]) + CATCHING_UP * late

    def play(self, act: Callable[[Any, NDArray], NDArray] | None, observation: Any) -> dict[str, Any]:
        """Return displacements by vehicle and scene, collisions and headways of all vehicles.

        Args:
            act: Decision and speeds -> accelerations; None: as recorded.
            observation: What the agents observe.
        """
        agents = TrafficAgents(
            self.built,
            self.traffic,
            observation,
            ActionSpaceType.AlongPath,
            decision_interval=INTERVAL,
            drives=True,
        )
        moved, collided, counted, headways = defaultdict(list), 0, 0, defaultdict(list)
        for time in self.times:
            agents.reset(begin=time - BEFORE * TIME)
            followed: dict[str, list[float]] = {}
            overlaps, touched = set[str](), set[str]()
            for number in range(BEFORE + DECISIONS + 1):
                now, decision = time + (number - BEFORE) * TIME, agents.decide()
                names = [agents.name(slot) for slot in decision.slot.tolist()]
                speed = agents.vehicles.speed[decision.slot]
                recorded = self._speeds(agents, names, decision.slot, now)
                if number == BEFORE:
                    ends = time + DECISIONS * TIME
                    followed = {name: [] for name in names if np.isfinite(self.at(name, ends)[0])}
                    overlaps = _overlapping(agents)
                if number > BEFORE:
                    position = agents.vehicles.position[decision.slot]
                    for name, place in zip(names, position, strict=True):
                        if name in followed:
                            followed[name].append(float(np.hypot(*(place - self.at(name, now)[:2]))))
                    touched |= _overlapping(agents) - overlaps
                if number == BEFORE + DECISIONS:
                    _add_headways(agents, followed, headways)
                actions = np.where(np.isfinite(recorded), (recorded - speed) / TIME, 0.0)
                if number >= BEFORE and act is not None:
                    actions = act(decision, speed)
                agents.step(decision, actions[:, None])
            for name, each in followed.items():
                moved[name] += [np.mean(each)] * bool(each)
            collided += len(touched & followed.keys())
            counted += len(followed)
        agents.close()
        return {
            "moved": [each for each in moved.values() if each],
            "collided": collided / max(counted, 1),
            "count": counted,
            "headways": headways,
        }


def _overlapping(agents: TrafficAgents) -> set[str]:
    """Return the names of vehicles that overlap another one."""
    vehicles = agents.vehicles
    slots = np.flatnonzero(vehicles.alive)
    size = np.column_stack([vehicles.length, vehicles.width])[slots]
    box = vehicles.position[slots], vehicles.heading[slots], size
    found = boxes_overlap(*(each[:, None] for each in box), *(each[None] for each in box))
    np.fill_diagonal(found, False)
    return {agents.name(slot) for slot in slots[found.any(axis=1)].tolist()}


def _add_headways(
    agents: TrafficAgents, followed: Mapping[str, Any], headways: dict[str, list[float]]
) -> None:
    """Add the time headways of vehicles that follow another in their lane, by kind of driver [s]."""
    vehicles = agents.vehicles
    slots = np.flatnonzero(vehicles.alive)
    for slot in slots.tolist():
        name, speed = agents.name(slot), vehicles.speed[slot]
        if name not in followed or speed < 3:
            continue
        ahead = vehicles.position[slots] - vehicles.position[slot]
        cos, sin = np.cos(vehicles.heading[slot]), np.sin(vehicles.heading[slot])
        along, aside = ahead @ (cos, sin), ahead @ (-sin, cos)
        gaps = along - 0.5 * (vehicles.length[slots] + vehicles.length[slot])
        gaps = gaps[(along > 0) & (np.abs(aside) < 1.6)]
        if len(gaps) and gaps.min() / speed < 4:
            headways[name.removeprefix(NAME).split(".")[0].rstrip("0123456789")].append(gaps.min() / speed)


def idm(decision: Any, speed: NDArray) -> NDArray:
    """Return the accelerations of IDM with the zoo's parameters."""
    own, lane = decision.observations[OWN_VEHICLE], decision.observations[LANE_TRAFFIC][:, 0]
    desired = np.maximum(own[:, Own.ALLOWED], 1.0)
    return Idm().acceleration(speed, desired, lane[:, Lane.AHEAD], lane[:, Lane.AHEAD_SPEED])


def compare(scenario: str, run: str, times: NDArray, traffic: str) -> None:
    """Print a row for each driver."""
    scenes, folder = Scenes(scenario, traffic, times), RunFolder(Path(run))
    trained = read_run(folder)
    (module,) = checked_modules(trained, folder.kept("last")).values()

    def imitated(decision: Any, speed: NDArray) -> NDArray:
        seen = [torch.from_numpy(array)[:, None] for array in decision.observations.values()]
        view = GroupView(
            dict(zip(module.group.observation, seen, strict=True)), torch.ones(len(speed), 1) > 0, None
        )
        with torch.no_grad():
            mean = module.policy(view)[:, 0, :1].numpy()
        return to_env(module.group.action, mean)[:, 0]

    observation = trained.task_setting.environment.observation
    drivers = {
        "as recorded": scenes.play(None, ["speed"]),
        "constant speed": scenes.play(lambda decision, speed: 0.0 * speed, ["speed"]),
        "IDM": scenes.play(idm, ["surroundings"]),
        "bc": scenes.play(imitated, observation),
    }
    vehicles = len(drivers["bc"]["moved"])
    print(f"{vehicles} vehicles, driven {drivers['bc']['count']} times for 5 s, from {len(times)} times on")
    print(
        f"{'driver':16}{'displacement [m]':>18}{'95%':>16}{'collided':>10}  headways [s]: quartiles by kind"
    )
    for name, found in drivers.items():
        sums, counts = np.array([(sum(each), len(each)) for each in found["moved"]]).T
        drawn = bootstrap_counts(np.zeros(len(sums)), stream(0, Purpose.RESAMPLING))
        low, high = bootstrap_interval(drawn @ sums / (drawn @ counts))
        interval = f"[{low:.2f}, {high:.2f}]" if len(sums) >= LEAST_SCENES else "n/a"
        kinds = "; ".join(
            f"{kind} {', '.join(f'{q:.2f}' for q in np.quantile(each, (0.25, 0.5, 0.75)))} ({len(each)})"
            for kind, each in sorted(found["headways"].items())
            if len(each) > 9
        )
        print(f"{name:16}{sums.sum() / counts.sum():18.3f}{interval:>16}{found['collided']:10.3%}  {kinds}")


def main() -> None:
    """Simulate, or compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parts = parser.add_subparsers(dest="part", required=True)
    made = parts.add_parser("simulate")
    made.add_argument("folder", type=Path)
    made.add_argument("--hours", type=float, default=1.0)
    compared = parts.add_parser("compare")
    compared.add_argument("scenario")
    compared.add_argument("run")
    for name, default in (("begin", 2400.0), ("end", 3600.0), ("every", 20.0)):
        compared.add_argument(f"--{name}", type=float, default=default)
    compared.add_argument("--traffic", default="recorded")
    given = parser.parse_args()
    if given.part == "simulate":
        simulate(given.folder, given.hours)
    else:
        first = max(given.begin, BEFORE * TIME)
        every = max(given.every, DECISIONS * TIME)  # scenes do not overlap
        times = np.arange(first, given.end - DECISIONS * TIME + 1e-6, every)
        compare(given.scenario, given.run, times, given.traffic)


if __name__ == "__main__":
    main()
