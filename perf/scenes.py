"""Scenarios of the suite with as many social vehicles and egos as a measurement asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from smarts.env.vector import VectorHiWayEnv
from smarts.errors import ScenarioError
from smarts.sstudio import types as t
from smarts.sstudio.build import build_described, build_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.types.vehicles import Owner

TRAFFIC = "random_social_vehicles"
BAND = 0.12
"""How far the number of social vehicles may be from the one asked for: 25 +- 3."""
START_SPEED = 5.0, 10.0
"""Least and largest start speed of egos, which are to move from the first step on [m/s]."""
TRIALS, EPISODES = 6, 6
"""Densities to try, and episodes to look at for each."""


def scene(name: str, social: int, egos: int, folder: Path) -> Path:
    """Build a scenario whose episodes begin with a number of social vehicles, give or take `BAND`.

    Map, drivers, routes and missions are the suite's; the rate of the traffic is another, egos do not start
    from rest, and the variation without traffic is left out. More egos than there are missions drive without
    a goal, from places along the longest roads.

    Raises:
        ScenarioError: No rate gives that number of vehicles.
    """
    base = build_scenario(name)
    density, seen = 1.0, 0.0
    for trial in range(TRIALS):
        source = folder / f"{name}-{social}-{egos}-{trial}"
        source.mkdir()
        built = build_described(source, _varied(base, density, egos))
        seen = _social_vehicles(source, egos)
        if abs(seen - social) <= BAND / 3 * social:
            return built.source
        density *= social / max(seen, 1.0)
    raise ScenarioError(f"{name} cannot be had with {social} vehicles: there are {seen:g}", place="perf.step")


def _varied(base: BuiltScenario, density: float, egos: int) -> t.Scenario:
    scenario = base.scenario
    given = (scenario.traffic or {})[TRAFFIC]
    flows = [replace(flow, rate=flow.rate * density) for flow in given.flows]
    trips = list(given.trips or ())
    count = round(len(trips) * density)
    more = [
        replace(trip, vehicle_name=f"{trip.vehicle_name}_{number // len(trips)}")
        for number, trip in enumerate(trips * (count // max(len(trips), 1) + 1))
    ][:count]
    start = replace(scenario.start_variation or t.StartVariation(), speed=START_SPEED)
    return replace(
        scenario,
        start_variation=start,
        map_spec=t.MapSpec(source=str(base.net_file)),
        traffic={TRAFFIC: replace(given, flows=flows, trips=more or None)},
        ego_missions=_missions(base, egos),
        held_out=None,
    )


def _missions(base: BuiltScenario, egos: int) -> Sequence[t.Mission | t.EndlessMission]:
    """Return the scenario's missions, or as many endless ones, spread over the longest roads."""
    missions = base.scenario.ego_missions or ()
    if len(missions) >= egos:
        return [mission for mission in missions if isinstance(mission, t.Mission)][:egos]
    roads = base.roads()
    places = []
    for lane in np.argsort(-roads.length, kind="stable").tolist():
        if not roads.is_internal[lane]:
            edge, _, index = roads.lane_ids[lane].rpartition("_")
            last = int(roads.length[lane]) - 20
            places += [(edge, int(index), float(at)) for at in range(20, last, 40)]
    return [t.EndlessMission(begin=place) for place in places[:egos]]


def _social_vehicles(source: Path, egos: int) -> float:
    env = VectorHiWayEnv(1, [source], egos)
    try:
        counts = []
        for episode in range(EPISODES):
            env.reset(episode=episode)
            counts.append(int((env._runner.world.vehicles.owner == Owner.TRAFFIC).sum()))
    finally:
        env.close()
    return float(np.mean(counts))
