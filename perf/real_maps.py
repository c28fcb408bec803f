"""How well vehicles keep their lanes on maps that the project did not make.

    python -m perf.real_maps MAP... [--vehicle sedan bus truck] [--routes 40] [--seed 0]

One vehicle at a time in Bullet, no traffic, `keep_lane` in every decision at the lanes' speed limits, from
rest, along random routes of 300 to 600 m on lanes that are open to it, without turnarounds. A map is any file
that a scenario may name. A drive ends off the road (the event `off_road`: the footprint's centre is on no
lane and in no junction), at the end of its route, on another road ("strayed"), or too late.

Columns: drives that ended off the road; how all ended; the median and the largest of all drives' largest
offsets from the middle of a lane [m]; the share of steps in which a corner of the footprint was off the road.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smarts.controllers.set import ControllerSet
from smarts.dynamics import vehicle
from smarts.geometry.frames import wrap_angle
from smarts.providers.vehicle import FleetVehicles
from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.roads.compile import compile_map
from smarts.roads.lane_graph import LaneGraph, LaneKind
from smarts.roads.scene import Scene
from smarts.roads.sources import find_map_source
from smarts.roads.sumo_net import read_net
from smarts.sim.map_matching import MapMatcher
from smarts.sim.ownership import Ownership
from smarts.types.actions import Actions, ActionSpaceType, LaneAction
from smarts.types.episode import AgentStart
from smarts.types.mission import AgentMission
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World

SHORTEST, LONGEST = 300.0, 600.0
"""Shortest and longest route [m]; a route is shorter where no way leads on."""
SLOWEST = 2.5
"""Mean speed at which a vehicle comes to the end of its route in time [m/s]."""
STRAYED = 20.0
"""Off its route for this long, a vehicle is on its way elsewhere: it took another lane [s]."""
EXIT = 30.0
"""What is this far behind a junction is its exit [m]."""
TURNED_BACK = 2.7
"""From the end of a road to the begin of the next [rad]."""
KINDS = {"sedan": VehicleKind.PASSENGER, "bus": VehicleKind.BUS, "truck": VehicleKind.TRUCK}
PLACES = "junction", "exit", "road"
ENDS = *PLACES, "done", "strayed", "late"


@dataclass
class Drive:
    """One vehicle's way along one route."""

    lanes: list[int]
    length: float
    """Length of the route [m]."""
    ends: str = "late"
    """Where it left the road (one of `PLACES`), "done", "strayed" (on another road) or "late"."""
    offset: float = 0.0
    """The largest from the middle of a lane [m]."""
    shoulder: int = 0
    """Steps in which a corner of the footprint was off the road."""
    steps: int = 0
    strayed: int = 0
    """Steps since it was last on its route."""
    place: str = ""
    """The lane near which it left the road, and where on it."""


class _Drives:
    """A provider that accepts every vehicle."""

    def can_accept(self, rows: NDArray[np.int32], slots: NDArray[np.int32]) -> NDArray[np.int8]:
        return np.full(len(rows), Refusal.NONE, np.int8)


def load(path: Path, folder: Path) -> LaneGraph:
    """Return the lanes of a map in any format."""
    net = folder / f"{path.stem}.net.xml"
    compile_map(find_map_source(Path(), str(path.resolve())), net)
    return read_net(net)


def turnarounds(graph: LaneGraph) -> set[tuple[int, int]]:
    """Return the links by which lanes lead back beside their own road, where vehicles have to reverse."""
    found = set()
    for lane in np.flatnonzero(~graph.is_internal).tolist():
        heading = graph.point_heading[graph.point_start[lane + 1] - 1]
        for onward in graph.successors(lane).tolist():
            target = onward
            while graph.is_internal[target] and len(graph.successors(target)):
                target = int(graph.successors(target)[0])
            turn = wrap_angle(graph.point_heading[graph.point_start[target]] - heading)
            if abs(turn) > TURNED_BACK:
                found.add((lane, onward))
    return found


def random_lanes(graph: LaneGraph, kind: VehicleKind, generator: np.random.Generator) -> list[int]:
    """Return lanes that follow each other, from a road lane on, without a lane change."""
    kinds = [LaneKind.CAR] + [LaneKind.BUS] * (kind == VehicleKind.BUS)
    usable = np.isin(graph.kind, kinds)
    excluded = turnarounds(graph)
    begins = np.flatnonzero(usable & ~graph.is_internal & (graph.length > 15.0))
    best: list[int] = []
    for _ in range(20):
        lanes, way = [int(generator.choice(begins))], 0.0
        wanted = generator.uniform(SHORTEST, LONGEST)
        while way < wanted or graph.is_internal[lanes[-1]]:
            way += graph.length[lanes[-1]]
            ahead = graph.successors(lanes[-1]).tolist()
            onward = [lane for lane in ahead if usable[lane] and (lanes[-1], lane) not in excluded]
            if not onward:
                break
            lanes.append(int(generator.choice(onward)))
        while graph.is_internal[lanes[-1]]:
            lanes.pop()
        if sum(graph.length[lanes]) > sum(graph.length[best]):
            best = lanes
        if way >= wanted:
            break
    return best


def drive_all(graph: LaneGraph, name: str, routes: int, seed: int) -> list[Drive]:
    """Drive one vehicle along each of some random routes."""
    generator = np.random.default_rng(seed)
    kind, shape = KINDS[name], vehicle(name)
    drives = []
    for _ in range(routes):
        lanes = random_lanes(graph, kind, generator)
        drives.append(Drive(lanes, float(sum(graph.length[lanes]))))
    world = World(worlds=routes, capacity=1, agents=1, lanes=len(graph.lane_ids), vias=1)
    atlas = RoadAtlas([graph])
    agent_routes = AgentRoutes(atlas, routes, 1)
    ownership = Ownership(world, {Owner.TRAFFIC: _Drives(), Owner.AGENT: _Drives()})
    for row, drive in enumerate(drives):
        _start(graph, world, agent_routes, ownership, row, drive, kind, shape.length, shape.width)
    vehicles = FleetVehicles(world)
    try:
        _follow(graph, world, Scene(world, atlas, agent_routes), vehicles, drives, shape.length)
    finally:
        vehicles.close()
    return drives


def _start(
    graph: LaneGraph,
    world: World,
    agent_routes: AgentRoutes,
    ownership: Ownership,
    row: int,
    drive: Drive,
    kind: VehicleKind,
    length: float,
    width: float,
) -> None:
    """Put a vehicle at rest on the begin of its route."""
    edges = [graph.edge_ids[graph.lane_edge[n]] for n in drive.lanes if not graph.is_internal[n]]
    mission = AgentMission(route=tuple(edges))
    agent_routes.assign(row, 0, [mission.route])
    world.missions.write(row, 0, mission, world.routes.number(row, map(graph.edge_number, mission.route)))
    pose = graph.pose_at(drive.lanes[0], 0.5 * length + 1.0)
    ownership.admit(row, 0, AgentStart("agent", pose, 0.0, mission, kind, length, width))


def _follow(
    graph: LaneGraph,
    world: World,
    scene: Scene,
    vehicles: FleetVehicles,
    drives: list[Drive],
    length: float,
) -> None:
    """Step all simulations until each drive has ended."""
    rows = np.ones(len(drives), np.bool_)
    matcher = MapMatcher(scene)
    matcher.match(rows)
    for row in range(len(drives)):
        world.settle(row)
    controllers = ControllerSet(scene, [ActionSpaceType.Lane])
    actions = Actions.allocate(len(drives), 1)
    actions.kind[:] = ActionSpaceType.Lane
    actions.given[:] = True
    actions.values[:, :, 0] = LaneAction.keep_lane
    actions.action_mask[:, :, :2] = True
    vehicles.reset(rows)
    latest = max(drive.length for drive in drives) / SLOWEST / world.dt
    step = 0
    while rows.any() and step < latest:
        step += 1
        actions.fresh[:] = True
        world.advance(rows)
        vehicles.step(controllers.command(actions, rows), rows)
        matcher.match(rows)
        for row in np.flatnonzero(rows).tolist():
            if row in vehicles.failures:
                raise vehicles.failures[row]
            rows[row] = not _note(graph, world, row, drives[row], length)


def _note(graph: LaneGraph, world: World, row: int, drive: Drive, length: float) -> bool:
    """Record one vehicle's step; return whether its drive is over."""
    vehicles, agents = world.vehicles, world.agents
    lane, s, t = (getattr(vehicles, name)[row, 0] for name in ("lane", "lane_position", "lane_offset"))
    speed = vehicles.speed[row, 0]
    drive.steps += 1
    drive.shoulder += int(agents.corners_on_road[row, 0] < 4)
    drive.offset = max(drive.offset, abs(float(t)))
    left = graph.length[drive.lanes[-1]] - s
    on_route = agents.on_route[row, 0]
    drive.strayed = 0 if on_route else drive.strayed + 1
    if drive.strayed * world.dt > STRAYED:
        drive.ends = "strayed"
    elif lane == drive.lanes[-1] and left < 0.5 * length + 3.0 and agents.remaining[row, 0] < length:
        drive.ends = "done"
    elif lane >= 0 and not len(graph.successors(lane)) and graph.length[lane] - s < 0.5 * length + 3.0:
        # Off its route, but the road has an end.
        drive.ends = "done"
    elif not agents.on_road[row, 0]:
        is_exit = any(graph.is_internal[graph.predecessors(lane)]) and s < EXIT
        drive.ends = PLACES[0] if graph.is_internal[lane] else PLACES[1 if is_exit else 2]
        drive.place = f"{graph.lane_ids[lane]} at {s:.1f} m, {t:+.2f} m off, {speed:.1f} m/s"
    return drive.ends != "late"


def report(title: str, drives: Sequence[Drive]) -> None:
    """Print a row of the table."""
    count = {end: sum(drive.ends == end for drive in drives) for end in ENDS}
    offsets: NDArray[np.float64] = np.array([drive.offset for drive in drives])
    shoulder = np.mean([drive.shoulder / max(drive.steps, 1) for drive in drives])
    cells = "".join(f"{number:9d}" for number in (sum(count[place] for place in PLACES), *count.values()))
    print(f"{title:32s}{cells}{np.median(offsets):9.2f}{offsets.max():9.2f}{shoulder:9.1%}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Drive and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("maps", nargs="+", type=Path, metavar="MAP")
    parser.add_argument("--vehicle", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--routes", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    heads = "".join(f"{head:>9s}" for head in ("off-road", *ENDS))
    title = f"map, vehicle, {options.routes} routes"
    print(f"{title:32s}{heads}{'median':>9s}{'worst m':>9s}{'corner':>9s}")
    with tempfile.TemporaryDirectory() as folder:
        for path in options.maps:
            graph = load(path, Path(folder))
            for name in options.vehicle:
                drives = drive_all(graph, name, options.routes, options.seed)
                report(f"{path.name.partition('.')[0]} {name}", drives)


if __name__ == "__main__":
    main()
