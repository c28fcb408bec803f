"""Play bubbles of each kind on maps that the project did not make.

    python -m perf.bubble_maps MAP... [--agents idm-v0 keep-lane-v0] [--seconds 120] [--seed 42]

Bubbles lie on the junctions with the most lanes inside: a rectangle, a polygon, the end of a lane that leads
into a junction, boids, a `TrafficEngineActor`, one that follows a vehicle and one that follows a social
agent. SUMO's traffic drives on random routes. A map is any file that a scenario may name.

Columns: vehicles in all; taken by agents; given back; vehicles that left the simulation
from an agent, by `Departure`; those of traffic that vanished before the end of their route ("lost");
collisions of agents' vehicles; social agents that failed; names that never appeared.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from smarts.agents.benchmark import benchmark_interface
from smarts.arrays import Bools, Ints
from smarts.env.casting import cast_of
from smarts.env.runner import EpisodeKey, SimulationRunner
from smarts.errors import SmartsError
from smarts.roads.lane_graph import LaneGraph
from smarts.sim.assembly import assemble
from smarts.sstudio import build_scenario, gen_scenario
from smarts.sstudio import types as t
from smarts.types.frame import Frame
from smarts.types.transfers import Departure, Reason
from smarts.types.vehicles import Owner

FLOWS, RATE = 30, 60.0
"""Number of random routes, and vehicles an hour on each."""
WARM_UP = 60.0
"""[s]"""
NEAR = 20.0
"""A vehicle with less than this left of its route [m] may arrive in one step or two."""
SIZE, MARGIN = 50.0, 12.0
"""Of bubbles [m]."""


class Watch:
    """Counts what happens to vehicles, until an ego enters, for which traffic is cleared away.

    Args:
        roads: The map.
    """

    def __init__(self, roads: LaneGraph) -> None:
        self.roads = roads
        self.left = Counter[str]()
        self.changed = Counter[Reason]()
        self.failed: list[str] = []
        self.vehicles = 0
        self.lost: list[str] = []
        self._before: dict[tuple[int, int], tuple[str, int, bool]] = {}

    def reset(self, egos: Bools) -> None:
        """Do nothing."""

    def collect(self, frame: Frame, is_last: bool) -> None:
        """Take in one step."""
        world, vehicles = frame.world, frame.world.vehicles
        if world.agents.entry_step[0, 0] == world.step[0]:
            return
        self.failed += frame.social_failures.values()
        gone_from_agents = set[tuple[int, int]]()
        for carried_out in frame.transfers:
            transfer = carried_out.transfer
            reason = Reason(int(transfer["reason"]))
            self.changed[reason] += 1
            if reason == Reason.LEAVE:
                self.left[Departure(int(transfer["departure"])).name.lower()] += 1
                gone_from_agents.add((int(transfer["slot"]), int(transfer["generation"])))
        now = dict[tuple[int, int], tuple[str, int, bool]]()
        for slot in np.flatnonzero(vehicles.alive[0]).tolist():
            lane, route = int(vehicles.lane[0, slot]), int(vehicles.route[0, slot])
            is_near_end = lane < 0 or self._left(world.routes.edges(0, route), lane) < NEAR
            owner, name = int(vehicles.owner[0, slot]), world.registry.name(0, slot)
            now[slot, int(vehicles.generation[0, slot])] = name, owner, is_near_end
        for vehicle, (name, owner, is_near_end) in self._before.items():
            if vehicle not in now and vehicle not in gone_from_agents and not is_near_end:
                self.lost.append(f"{name} ({Owner(owner).name}, step {int(world.step[0])})")
        self.vehicles += len(now.keys() - self._before.keys())
        self._before = now

    def _left(self, route: Ints, lane: int) -> float:
        """Return the length of the route behind a lane [m]."""
        roads = self.roads
        edge = int(roads.lane_edge[lane])
        places = np.flatnonzero(route == edge)
        if not len(places):  # Inside a junction: to the first edge behind it.
            ahead = [int(roads.lane_edge[each]) for each in roads.successors(lane)]
            places = np.flatnonzero(np.isin(route, ahead))
        first = int(places[-1]) if len(places) else 0
        return float(sum(roads.length[roads.edge_first_lane[edge]] for edge in route[first + 1 :].tolist()))


def junctions(roads: LaneGraph) -> list[int]:
    """Return lanes inside junctions, one for each junction, those with the most lanes inside first."""
    inside = np.flatnonzero(roads.is_internal)
    count = Counter(roads.lane_junction[inside].tolist())
    first = {int(roads.lane_junction[lane]): int(lane) for lane in reversed(inside.tolist())}
    return [first[junction] for junction, _ in count.most_common()]


def bubbles_of(roads: LaneGraph, agent: str) -> list[t.Bubble]:
    """Return bubbles of each kind on the largest junctions of a map."""
    lanes = junctions(roads)
    places = [tuple(roads.centreline(lanes[number % len(lanes)]).mean(0).tolist()) for number in range(5)]
    into = int(roads.predecessors(lanes[2 % len(lanes)])[0])
    edge, length = roads.edge_ids[roads.lane_edge[into]], float(roads.sumo_length[into])
    index, stretch = int(roads.lane_index[into]), min(40.0, length)
    half = SIZE / 2
    (x, y), corners = places[1], [(-1, -0.4), (-0.4, -1), (0.4, -1), (1, -0.4), (1, 0.4), (0.4, 1), (-1, 0.4)]
    actor = t.SocialAgentActor("driver", agent)
    boids, engine = t.BoidAgentActor("flock", "boids-v0"), t.TrafficEngineActor("engine")
    square = (SIZE, SIZE)
    follow = {"follow_offset": (0.0, 5.0), "margin": MARGIN}
    return [
        t.Bubble(t.PositionalZone(places[0], square), actor, MARGIN, id="rectangle"),
        t.Bubble(
            t.ConfigurableZone([(x + a * half, y + b * half) for a, b in corners]),
            actor,
            MARGIN,
            id="polygon",
        ),
        t.Bubble(t.MapZone((edge, index, length - stretch), stretch, 1), actor, MARGIN, id="lanes"),
        t.Bubble(t.PositionalZone(places[3], square), boids, MARGIN, id="boids", keep_alive=True),
        t.Bubble(t.PositionalZone(places[4], square), engine, MARGIN, id="engine"),
        t.Bubble(t.PositionalZone((0, 0), square), actor, id="vehicle", follow_vehicle_id="leader", **follow),
        t.Bubble(
            t.PositionalZone((0, 0), square),
            actor,
            id="agent",
            follow_actor_id="social-agent-group-first",
            **follow,
        ),
    ]


def write_scenario(folder: Path, source: Path, agent: str, seconds: float) -> None:
    """Write a scenario on a map."""
    folder.mkdir()
    shutil.copy(source, folder / f"map{''.join(source.suffixes)}")
    plain = t.Scenario(ego_missions=[t.Mission(t.RandomRoute("ego"), start_time=seconds)])
    gen_scenario(plain, output_dir=folder)
    roads = build_scenario(folder).roads()
    car, truck = t.TrafficActor("car"), t.TrafficActor("truck", vehicle_type="truck")
    flows = [t.Flow(t.RandomRoute(f"flow-{n}"), RATE, actors={car: 0.85, truck: 0.15}) for n in range(FLOWS)]
    trips = [t.Trip("leader", t.RandomRoute("leader"), depart=WARM_UP + 1.0)]
    first = t.SocialAgentActor("first", agent)
    scenario = t.Scenario(
        traffic={"random": t.Traffic(flows, trips, warm_up=WARM_UP)},
        ego_missions=plain.ego_missions,
        social_agent_missions={"group": ([first], [t.Mission(t.RandomRoute("first"))])},
        bubbles=bubbles_of(roads, agent),
    )
    gen_scenario(scenario, output_dir=folder)


def play(folder: Path, seed: int) -> tuple[Watch, dict[str, dict[str, int]]]:
    """Play one episode until its ego enters; return what happened to vehicles and in bubbles."""
    built = build_scenario(folder)
    watch = Watch(built.roads())
    parts = assemble([built], [benchmark_interface()], seed=seed, cast=cast_of([built]))
    runner = SimulationRunner(parts, [watch])
    try:
        runner.reset({0: EpisodeKey(0, 0)})
        return watch, runner.social_info(0)["bubbles"]
    finally:
        runner.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Play the maps that the command line names, and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("maps", type=Path, nargs="+", metavar="MAP")
    parser.add_argument("--agents", nargs="+", default=["idm-v0", "keep-lane-v0"], metavar="LOCATOR")
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--seed", type=int, default=42)
    given = parser.parse_args(arguments)
    print("| map | agent | vehicles | driven | given back | left | lost | collided | failed | missing |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for source in given.maps:
        for agent in given.agents:
            with tempfile.TemporaryDirectory() as temporary:
                folder = Path(temporary) / "scenario"
                try:
                    write_scenario(folder, source, agent, given.seconds)
                    watch, bubbles = play(folder, given.seed)
                except SmartsError as error:
                    print(f"| {source.stem} | {agent} | {error} |", flush=True)
                    continue
            collided, missing = (
                {name: counts[count] for name, counts in bubbles.items() if counts[count]}
                for count in ("collided", "never_appeared")
            )
            numbers = (watch.vehicles, watch.changed[Reason.TAKE], watch.changed[Reason.RELEASE])
            rest = (dict(watch.left), watch.lost, collided, Counter(watch.failed) or "", missing)
            print(f"| {source.stem} | {agent} | {' | '.join(map(str, (*numbers, *rest)))} |", flush=True)
            taken = {name: counts["taken"] for name, counts in bubbles.items()}
            print(f"  taken {taken}", flush=True)


if __name__ == "__main__":
    main()
