"""A recording on a map, as the traffic engine needs it: where each vehicle is when, and the path it drives.

A track's path leaves out what its samples scribble while it stands. Where the recording's end cuts a track
off, its path continues along the lanes to the map's end.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.frames import wrap_angle
from smarts.recordings.gaps import headways
from smarts.recordings.matching import lanes_of, routes_of
from smarts.recordings.paths import Paths
from smarts.recordings.signals import lights_of
from smarts.recordings.tracks import RecordingError, Tracks
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.paces import LATERAL
from smarts.types.vehicles import VehicleKind

NAME = "history-vehicle-"
"""Names of recorded vehicles begin so, as in SMARTS 2; the track's name follows."""
LEAST_PROGRESS = 0.2
"""A path's points are at least so far apart [m]."""
AHEAD = 10.0
"""The pace of a place is the largest speed that was driven within this distance behind it [m]."""
SLOWEST = 1.0
"""The least pace [m/s]."""
DECEL = 2.0
"""Deceleration before bends of lanes [m/s^2]."""
BLEND = 30.0
"""Distance within which a path that continues along a lane reaches the middle of the lane [m]."""
NEAR = 3.0
"""A lane is that of a pose if its middle is not farther away [m]."""


@dataclass(frozen=True, eq=False)
class Log:
    """T tracks in order of their first time."""

    names: tuple[str, ...]
    paths: Paths
    routes: tuple[tuple[int, ...], ...]
    """Numbers of the road edges along each track."""
    lights: NDArray
    """What lanes show; see `lights_of`."""

    def most_at_once(self) -> int:
        """Return how many vehicles there are at most at a time."""
        rank = np.searchsorted(np.sort(self.paths.end), self.paths.begin, side="left")
        return int((1 + np.arange(len(self.names)) - rank).max(initial=0))

    def save(self, file: Path) -> None:
        """Write the log to a file; equal logs give equal bytes."""
        edges = np.concatenate([np.zeros(0, np.int32), *(np.array(each, np.int32) for each in self.routes)])
        counts = np.array([len(each) for each in self.routes], np.int32)
        buffer = io.BytesIO()
        named = self.paths._asdict() | {"names": np.array(self.names), "edges": edges, "edge_counts": counts}
        named["lights"] = self.lights
        np.savez(buffer, allow_pickle=False, **named)
        file.write_bytes(buffer.getvalue())

    @classmethod
    def load(cls, file: Path) -> Log:
        """Read a saved log."""
        with np.load(file, allow_pickle=False) as found:
            paths = Paths._make(found[name] for name in Paths._fields)
            routes = np.split(found["edges"], np.cumsum(found["edge_counts"])[:-1])
            names, lights = tuple(found["names"].tolist()), found["lights"]
        return cls(names, paths, tuple(tuple(each.tolist()) for each in routes), lights)


def make_log(tracks: Tracks, roads: LaneGraph, begin: float = 0.0, end: float = np.inf) -> Log:
    """Return a part of a recording on its map; poses at the part's ends are interpolated.

    Args:
        tracks: The recording.
        roads: The map.
        begin: Begin of the part [s].
        end: End of the part [s].

    Raises:
        RecordingError: No vehicle is recorded in this time.
    """
    last = min(end, float(tracks.t.max()))
    parts = [(number, _clipped(tracks, number, begin, last)) for number in range(len(tracks))]
    parts = sorted(((number, part) for number, part in parts if len(part)), key=lambda each: each[1][0, 0])
    if not parts:
        remedy = f"it was recorded from 0 to {tracks.t.max():g} s"
        raise RecordingError(f"no vehicle is recorded from {begin:g} to {end:g} s", remedy=remedy)
    # Tracks whose next sample would have come after the end are cut off, the others leave, and so do walkers.
    order = np.array([number for number, _ in parts])
    walks = (tracks.kind[order] == VehicleKind.PEDESTRIAN).tolist()
    pieces = [
        _path_of(part, roads, is_cut=last - part[-1, 0] < _step(part) and not is_on_foot)
        for (_, part), is_on_foot in zip(parts, walks, strict=True)
    ]
    paths = _packed(pieces)._replace(**{name: getattr(tracks, name)[order] for name in _SHAPE})
    paths = paths._replace(headway=headways(paths))
    names = tuple(tracks.names[number] for number in order)
    position, heading = np.column_stack([paths.x, paths.y]), wrap_angle(paths.turn)
    routes = routes_of(position, heading, paths.sample, roads)
    routes = (() if on_foot else route for route, on_foot in zip(routes, walks, strict=True))
    signals = tracks.signals[tracks.signals[:, 0] <= end]
    return Log(names, paths, tuple(routes), lights_of(signals, roads)[0])


_SHAPE = ("kind", "length", "width")
_Piece = tuple[NDArray, NDArray]
"""Samples t, x, y, turn, speed, s; points x, y, turn, s, pace: columns of arrays."""


def _step(part: NDArray) -> float:
    """Return the longest time between the last samples of a track, less a bit [s]."""
    return 0.99 * float(np.diff(part[-3:, 0]).max(initial=1e-6))


def _clipped(tracks: Tracks, number: int, begin: float, end: float) -> NDArray:
    """Return the samples t, x, y, turn, speed of a track from `begin` to `end`."""
    rows = slice(tracks.start[number], tracks.start[number + 1])
    t = tracks.t[rows]
    columns = [tracks.x[rows], tracks.y[rows], np.unwrap(tracks.heading[rows]), tracks.speed[rows]]
    cuts = [cut for cut in (begin, end) if t[0] <= cut <= t[-1]]
    times = np.unique(np.concatenate([t, cuts]))
    times = times[(times >= begin) & (times <= end)]
    return np.column_stack([times, *(np.interp(times, t, column) for column in columns)])


def _path_of(part: NDArray, roads: LaneGraph, *, is_cut: bool) -> _Piece:
    """Return the samples of a track with their arc lengths, and the points of its path."""
    _, x, y, turn, speed = part.T
    kept, s = [0], np.zeros(len(part))
    for row in range(1, len(part)):
        last = kept[-1]
        dx, dy = x[row] - x[last], y[row] - y[last]
        progress = dx * np.cos(turn[last]) + dy * np.sin(turn[last])
        if progress >= LEAST_PROGRESS:
            s[row] = s[last] + np.hypot(dx, dy)
            kept.append(row)
        else:
            s[row] = max(s[row - 1], s[last] + progress)
    behind = np.searchsorted(s, s + AHEAD, side="right")
    pace = [max(SLOWEST, speed[row : behind[row]].max()) for row in kept]
    points = np.column_stack([x[kept], y[kept], turn[kept], s[kept], pace])
    if is_cut:
        points = np.concatenate([points, _onward_from(points[-1], roads)])
    if len(points) == 1:
        points = np.concatenate([points, _ahead(points[0], 1.0)])
    return np.column_stack([part, s]), points


def _ahead(point: NDArray, distance: float) -> NDArray:
    """Return a point of a path straight ahead of another one, shape (1, 5)."""
    x, y, turn, s, pace = point
    ahead = x + distance * np.cos(turn), y + distance * np.sin(turn), turn, s + distance, pace
    return np.array([ahead])


def _onward_from(point: NDArray, roads: LaneGraph) -> NDArray:
    """Return points along the lanes behind the last point of a track; none where it is on no lane."""
    x, y, turn, s, _ = point
    found = lanes_of(np.array([[x, y]]), wrap_angle(np.array([turn])), roads)
    lane, offset = int(found.lane[0]), float(found.t[0])
    if lane < 0 or found.distance[0] > NEAR:
        return np.zeros((0, 5))
    points = _onward(roads, lane)
    points = points[points[:, 3] > found.s[0] + LEAST_PROGRESS]
    way = points[:, 3] - found.s[0]
    share = np.minimum(way / BLEND, 1.0)
    left = offset * (1.0 - share * share * (3.0 - 2.0 * share))
    points[:, 0] -= left * np.sin(points[:, 2])
    points[:, 1] += left * np.cos(points[:, 2])
    points[:, 2] += 2.0 * np.pi * np.round((turn - points[:1, 2]) / (2.0 * np.pi))
    points[:, 3] = s + way
    return points


def lanes_onward(roads: LaneGraph, lane: int) -> list[int]:
    """Return the lanes from one to the map's end, or until they come round again.

    At each junction the way leads straight on: into the lane that turns least.
    """
    lanes = [lane]
    while len(following := roads.successors(lanes[-1])):
        ends = roads.point_heading[roads.point_start[following + 1] - 1]
        here = roads.point_heading[roads.point_start[lanes[-1] + 1] - 1]
        lane = int(following[np.abs(wrap_angle(ends - here)).argmin()])
        if lane in lanes:
            break
        lanes.append(lane)
    return lanes


def _onward(roads: LaneGraph, lane: int) -> NDArray:
    """Return points x, y, turn, s, pace along `lanes_onward`."""
    lanes = lanes_onward(roads, lane)
    rows = np.concatenate([np.arange(roads.point_start[each], roads.point_start[each + 1]) for each in lanes])
    xy, turn = roads.point_xy[rows], np.unwrap(roads.point_heading[rows])
    pace = np.repeat(roads.speed_limit[lanes], np.diff(roads.point_start)[lanes])
    apart = np.append(0.0, np.hypot(*np.diff(xy, axis=0).T))
    # A lane begins where the one before ends, or less than a centimetre from there.
    is_new = np.append(True, apart[1:] > LEAST_PROGRESS)
    xy, turn, s, pace = xy[is_new], turn[is_new], np.cumsum(apart)[is_new], pace[is_new]
    bend = np.abs(np.interp(s + 2.0, s, turn) - np.interp(s - 2.0, s, turn)) / 4.0
    bent = np.minimum(pace**2, LATERAL / np.maximum(bend, 1e-4)) + 2.0 * DECEL * s
    slower = np.sqrt(np.minimum.accumulate(bent[::-1])[::-1] - 2.0 * DECEL * s)
    return np.column_stack([xy, turn, s, np.maximum(slower, SLOWEST)])


def lane_path(roads: LaneGraph, lane: int) -> Paths:
    """Return the path from a lane's begin to the map's end."""
    return _packed([(np.zeros((0, 6)), _onward(roads, lane))])


def _packed(pieces: list[_Piece]) -> Paths:
    """Return paths of cars, with default headways."""
    count = len(pieces)
    samples = np.concatenate([each for each, _ in pieces])
    points = np.concatenate([each for _, each in pieces])
    driven = [float(each[-1, 5]) if len(each) else np.inf for each, _ in pieces]
    length = [float(each[-1, 3]) for _, each in pieces]
    return Paths(
        np.zeros(count, np.int8),
        np.full(count, 5.0),
        np.full(count, 1.8),
        np.ones(count),
        np.array([each[0, 0] if len(each) else np.inf for each, _ in pieces]),
        np.array([each[-1, 0] if len(each) else -np.inf for each, _ in pieces]),
        np.array([most > own + 1.0 for most, own in zip(length, driven, strict=True)]),
        np.cumsum([0, *(len(each) for each, _ in pieces)], dtype=np.int32),
        np.cumsum([0, *(len(each) for _, each in pieces)], dtype=np.int32),
        *np.ascontiguousarray(samples.T),
        *np.ascontiguousarray(points.T),
    )
