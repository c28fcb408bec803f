"""Windows of a recording, and what drivers without observations do in the place of recorded vehicles.

Axis letters: R rollouts, T instants, K vehicles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from benchmark.metrics.realism import STEP
from smarts.arrays import Floats
from smarts.dynamics.car_following import idm_interaction
from smarts.geometry.binding import bind
from smarts.geometry.frames import wrap_angle
from smarts.providers.recorded.following import ACCEL, DECEL, HARDEST
from smarts.providers.traffic_engines import traffic_of
from smarts.providers.vehicle import TYPES
from smarts.recordings.gaps import DEFAULT_HEADWAY, STANDING_GAP, gap_on_path
from smarts.recordings.log import Log
from smarts.recordings.matching import lanes_of
from smarts.roads.lane_graph import LaneGraph
from smarts.types.episode import EpisodeStart
from smarts.types.streams import Purpose, stream
from smarts.types.traffic import TrafficFiles
from smarts.types.vehicles import VehicleKind
from smarts.types.world import World

SECONDS = 5.0
"""Length of a window [s]."""
INSTANTS = round(SECONDS / STEP) + 1
_TIMES = STEP * np.arange(INSTANTS)
NOISE = 0.3
"""Standard deviation of random accelerations [m/s^2]."""
_REACH = 100.0
"""IDM looks so far ahead [m]."""


class Window(NamedTuple):
    """A part of a recording, with all K vehicles that are in it at some time."""

    begin: float
    """[s]"""
    tracks: list[int]
    """Rows of the log, one for each of the K vehicles."""
    pose: Floats
    """x, y [m], heading [rad], speed [m/s], NaN where a vehicle is not there, shape (T, K, 4)."""
    size: Floats
    """Length and width [m], shape (K, 2)."""
    scenes: list[int]
    """Columns of the vehicles that drivers replace: agents can drive their kind, they are there all the time,
    and no scene of an earlier window with them lasts until now."""


def windows_of(log: Log, begin: float) -> Iterator[Window]:
    """Yield the windows of a log with scenes; they begin whole seconds after a time."""
    paths, columns = log.paths, (log.paths.x, log.paths.y, log.paths.turn, log.paths.speed)
    can_drive = np.isin(paths.kind, [*TYPES])
    over = np.full(len(can_drive), -np.inf)
    for start in np.arange(begin, float(paths.end.max()) - SECONDS + 1e-6).tolist():
        tracks, times = np.flatnonzero((paths.begin < start + SECONDS) & (paths.end > start)), start + _TIMES
        pose = np.empty((INSTANTS, len(tracks), 4))
        for column, track in enumerate(tracks.tolist()):
            rows = slice(paths.sample[track], paths.sample[track + 1])
            for number, each in enumerate(columns):
                pose[:, column, number] = np.interp(times, paths.t[rows], each[rows], np.nan, np.nan)
        is_whole = ~np.isnan(pose).any(axis=(0, 2))
        scenes = np.flatnonzero(is_whole & can_drive[tracks] & (over[tracks] <= start))
        over[tracks[scenes]] = start + SECONDS
        size = np.stack([paths.length[tracks], paths.width[tracks]], axis=-1)
        if len(scenes):
            yield Window(start, tracks.tolist(), pose, size, scenes.tolist())


def constant_speed(log: Log, window: Window, column: int, roads: LaneGraph) -> Floats:
    """Return the poses of a vehicle that keeps its speed along its recorded path, shape (1, T, 4)."""
    return _along(log, window, column, lambda _, speed, __: speed)


def noisy_speed(log: Log, window: Window, column: int, roads: LaneGraph, rollouts: int) -> Floats:
    """Return those of accelerations that are drawn from N(0, 0.3 m/s^2) each 0.5 s, shape (R, T, 4)."""
    draws = stream(0, Purpose.AGENTS, world=window.tracks[column], episode=round(window.begin / STEP))
    drawn = STEP * np.repeat(draws.normal(0.0, NOISE, (rollouts, INSTANTS // 5)), 5, axis=1)

    def drive(changes: Sequence[float]) -> Floats:
        return _along(log, window, column, lambda _, speed, instant: max(0.0, speed + changes[instant]))

    return np.concatenate([drive(each) for each in drawn.tolist()])


def idm(log: Log, window: Window, column: int, roads: LaneGraph) -> Floats:
    """Return those of the intelligent driver model at the speed limit along the path, shape (1, T, 4)."""
    track, halves, paths = window.tracks[column], 0.5 * window.size, log.paths
    rows = slice(*paths.sample[track : track + 2])
    place = np.column_stack([paths.x[rows], paths.y[rows]])
    limit = roads.speed_limit[lanes_of(place, wrap_angle(paths.turn[rows]), roads).lane]
    gap_to = bind(gap_on_path, paths)

    def follow(s: float, speed: float, instant: int) -> float:
        here = min(int(np.searchsorted(paths.s[rows], s)), len(limit) - 1)
        braking = 0.0
        for other in np.flatnonzero(~np.isnan(window.pose[instant, :, 0])).tolist():
            *pose, leader = window.pose[instant, other].tolist()
            gap, cosine = gap_to(
                track, s, *halves[column].tolist(), _REACH, tuple(pose), *halves[other].tolist()
            )
            if other != column and gap < _REACH:
                others = max(gap, 0.1), speed, max(0.0, leader * cosine)
                found = idm_interaction(ACCEL, DECEL, DEFAULT_HEADWAY, STANDING_GAP, *others)
                braking = max(braking, float(found))
        accel = ACCEL * (1.0 - (speed / limit[here]) ** 4) - braking
        return max(0.0, speed + STEP * max(accel, -HARDEST))

    return _along(log, window, column, follow)


def _along(log: Log, window: Window, column: int, drive: Callable[[float, float, int], float]) -> Floats:
    """Return poses on a recorded path, shape (1, T, 4); `drive` maps place and speed to the next speed."""
    paths, track = log.paths, window.tracks[column]
    rows, points = (slice(*start[track : track + 2]) for start in (paths.sample, paths.point))
    s, speed = np.empty(INSTANTS), np.full(INSTANTS, window.pose[0, column, 3])
    s[0] = np.interp(window.begin, paths.t[rows], paths.s[rows])
    for instant in range(INSTANTS - 1):
        speed[instant + 1] = drive(float(s[instant]), float(speed[instant]), instant)
        s[instant + 1] = s[instant] + STEP * speed[instant + 1]
    known = paths.point_s[points]
    x, y, turn = (
        np.interp(s, known, each[points]) for each in (paths.point_x, paths.point_y, paths.point_turn)
    )
    beyond = np.maximum(0.0, s - known[-1])  # straight on behind the path's end
    return np.stack([x + beyond * np.cos(turn), y + beyond * np.sin(turn), turn, speed], axis=-1)[None]


def play_engine(
    engine: str, log: Log, windows: Sequence[Window], roads: LaneGraph, net: Path, rollouts: int
) -> Iterator[Floats]:
    """Yield the poses of all vehicles of each window as a traffic engine drives them, shape (R, T, K, 4).

    Vehicles have their recorded place, speed and route when they enter; where the engine cannot
    put them there, in the middle of a junction, or no longer has them, they are NaN.
    """
    most = max(len(window.tracks) for window in windows)
    world = World(worlds=rollouts, capacity=most, agents=0, lanes=len(roads.lane_ids))
    traffic, rows = traffic_of([engine], world, [roads]), np.ones(rollouts, np.bool_)
    vehicles = world.vehicles
    with TemporaryDirectory() as folder:
        for number, window in enumerate(windows):
            file = Path(folder, f"{number}.rou.xml")
            file.write_bytes(tostring(_trips(log, window, roads)))
            files = TrafficFiles(net, routes=(file,))
            for row in range(rollouts):
                world.clear(row)
            traffic.reset(
                {
                    row: EpisodeStart(1, row, number, "", 0, files, "", row, most, (), engine)
                    for row in range(rollouts)
                }
            )
            pose = np.full((rollouts, INSTANTS, len(window.tracks), 4), np.nan)
            for instant in range(INSTANTS):
                if instant or not vehicles.alive.any():  # SUMO's first vehicles depart in its first step
                    world.advance(rows)
                    traffic.step(rows)
                for row, slot in np.argwhere(vehicles.alive).tolist():
                    column = int(world.registry.name(row, slot))
                    own = vehicles.heading[row, slot], vehicles.speed[row, slot]
                    pose[row, instant, column] = *vehicles.position[row, slot], *own
            yield pose
    traffic.close()


def _trips(log: Log, window: Window, roads: LaneGraph) -> Element:
    """Return the vehicles of a window as a route file of SUMO."""
    routes, vehicles = Element("routes"), []
    for column, track in enumerate(window.tracks):
        first = int(np.argmin(np.isnan(window.pose[:, column, 0])))
        pose, (length, width) = window.pose[first, column], window.size[column].tolist()
        found = lanes_of(pose[None, :2], pose[2:3].copy(), roads)
        lane, edges = int(found.lane[0]), log.routes[track]
        edge = int(roads.lane_edge[lane])
        if edge not in edges:
            continue
        front = (found.s[0] + 0.5 * length) * roads.sumo_length[lane] / roads.length[lane]
        kind = {"id": f"type{column}", "vClass": VehicleKind(int(log.paths.kind[track])).name.lower()}
        SubElement(routes, "vType", kind | {"length": f"{length:.3f}", "width": f"{width:.3f}"})
        given = {
            "depart": f"{first * STEP:.2f}",
            "departLane": f"{roads.lane_index[lane]}",
            "departPos": f"{min(front, roads.sumo_length[lane]):.3f}",
            "departSpeed": f"{pose[3]:.3f}",
            "insertionChecks": "none",
        }
        vehicle = Element("vehicle", {"id": str(column), "type": f"type{column}", **given})
        way = " ".join(roads.edge_ids[each] for each in edges[edges.index(edge) :])
        SubElement(vehicle, "route", edges=way)
        vehicles.append((first, vehicle))
    routes.extend(each for _, each in sorted(vehicles, key=lambda each: each[0]))
    return routes
