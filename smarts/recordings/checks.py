"""What is implausible in a recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from smarts.arrays import Bools, Floats, Longs
from smarts.geometry.boxes import boxes_overlap
from smarts.recordings.matching import lanes_of
from smarts.recordings.signals import lights_of
from smarts.recordings.tracks import SAMPLE, Tracks
from smarts.roads.lane_graph import LaneGraph
from smarts.types.vehicles import VehicleKind

SLACK = 0.1
"""Footprints overlap if they still do when they are this much shorter and narrower [m]."""
BEGIN_TOGETHER, OVERLAP_AT_BEGIN = 0.5, 0.2
"""Tracks are no traffic if at least the first share of all begin at one time, and more than the second share
of these overlap."""
BESIDE = 0.1
"""Times that differ by less from a multiple of the time step belong to that frame [time steps]."""
OVER = 0.5
"""Accelerations are taken over this time [s]."""
LIMITS = {
    "off the map": (0.1, "{} {:.0%} of its samples"),
    "accelerations": (8.0, "{} {:.1f} m/s^2"),
    "speeds unlike positions": (2.0, "{} by {:.1f} m/s"),
}
"""Kind of a finding in single tracks -> the value above which a track is named, and how.

They are the share of samples off the lanes; the largest acceleration, along or across; the 95th percentile
of the difference between speeds and those of positions.
"""

NOT_TRAFFIC = "not traffic"
_Pairs = dict[tuple[int, int], int]
"""Tracks that overlap -> the first frame in which they do."""


class Finding(NamedTuple):
    """Something implausible."""

    kind: str
    """A key of `LIMITS`, "overlaps" or `NOT_TRAFFIC`."""
    text: str


@dataclass(frozen=True)
class Report:
    """What there is to say of a recording."""

    contents: str
    """What it is, in one sentence."""
    on_lanes: float | None
    """Share of the positions that lie on lanes; None without a map."""
    findings: tuple[Finding, ...]

    @property
    def is_traffic(self) -> bool:
        """Whether the vehicles were on the road together."""
        return all(each.kind != NOT_TRAFFIC for each in self.findings)


def check(tracks: Tracks, roads: LaneGraph | None = None) -> Report:
    """Return what is implausible in a recording.

    Args:
        tracks: The recording.
        roads: Its map.
    """
    dt = float(tracks.facts["time_step"])
    frame = np.round(tracks.t / dt).astype(int)
    # Samples between frames are not compared: their vehicles are there in the next frame.
    is_in_frame = np.abs(tracks.t / dt - frame) < BESIDE
    pairs = _overlaps(tracks, np.where(is_in_frame, frame, -1))
    on_lane = np.ones(len(tracks.t), bool) if roads is None else on_lanes(tracks, roads)
    findings = (
        *_begun_together(tracks, pairs, dt),
        *_of_pairs(tracks, pairs, dt),
        *_in_tracks(tracks, on_lane),
    )
    contents = _contents(tracks, np.bincount(frame[is_in_frame]), dt)
    if len(tracks.signals):
        known = f", {lights_of(tracks.signals, roads)[1]} of them found on the map" if roads else ""
        contents += f"; {len(np.unique(tracks.signals[:, 1:5], axis=0))} ways with signals{known}"
    return Report(
        contents,
        None if roads is None else share_of_vehicles(on_lane, tracks),
        findings,
    )


def on_lanes(tracks: Tracks, roads: LaneGraph) -> Bools:
    """Return which samples lie on lanes for motor vehicles, or are pedestrians', shape (N,)."""
    found = lanes_of(np.column_stack([tracks.x, tracks.y]), tracks.heading, roads)
    is_on = (found.lane >= 0) & (found.distance <= roads.width[found.lane] / 2)
    return is_on | (tracks.kind[tracks.track] == VehicleKind.PEDESTRIAN)


def share_of_vehicles(chosen: Bools, tracks: Tracks) -> float:
    """Return the share of chosen samples, shape (N,), among those of vehicles."""
    return float(chosen[tracks.kind[tracks.track] != VehicleKind.PEDESTRIAN].mean())


def _overlaps(tracks: Tracks, frame: Longs) -> _Pairs:
    """Return the pairs of vehicles that overlap, by samples of the same frame; frame -1 is none."""
    place, track = np.column_stack([tracks.x, tracks.y]), tracks.track
    size = np.column_stack([tracks.length, tracks.width])[track]
    reach = np.hypot(*size.T).max()
    order = np.argsort(frame, kind="stable")[(frame < 0).sum() :]
    first: _Pairs = {}
    for rows in np.split(order, np.flatnonzero(np.diff(frame[order])) + 1):
        near = rows[KDTree(place[rows]).query_pairs(reach, output_type="ndarray")]
        one, other = ((place[row], tracks.heading[row], size[row] - SLACK) for row in near.T)
        for pair in np.sort(track[near[boxes_overlap(*one, *other)]]).tolist():
            first.setdefault(tuple(pair), int(frame[rows[0]]))
    return first


def _begun_together(tracks: Tracks, pairs: _Pairs, dt: float) -> Iterator[Finding]:
    """Yield a finding if these are single tracks that were all moved to one time."""
    begin = np.round(tracks.t[tracks.start[:-1]] / dt).astype(int)
    frame, count = Counter(begin.tolist()).most_common(1)[0]
    at_begin = (begin == frame) & (tracks.kind != VehicleKind.PEDESTRIAN)  # pedestrians walk in groups
    over = {each for pair, first in pairs.items() if first == frame for each in pair if at_begin[each]}
    if count >= BEGIN_TOGETHER * len(tracks) and len(over) > OVERLAP_AT_BEGIN * count:
        yield Finding(
            NOT_TRAFFIC,
            f"{count} of {len(tracks)} tracks begin at {frame * dt:g} s, {len(over)} of them overlapping: "
            "these are single tracks, which the traffic engine Recorded refuses",
        )


def _of_pairs(tracks: Tracks, pairs: _Pairs, dt: float) -> Iterator[Finding]:
    if pairs:
        names = (f"{tracks.names[a]} and {tracks.names[b]} at {at * dt:g} s" for (a, b), at in pairs.items())
        yield Finding("overlaps", f"{len(pairs)} pairs, as {_first(names)}")


def _in_tracks(tracks: Tracks, on_lane: Bools) -> Iterator[Finding]:
    """Yield what is implausible in single tracks, the worst first."""
    columns = np.array([getattr(tracks, name) for name in SAMPLE])
    values = []
    for rows in (slice(*ends) for ends in pairwise(tracks.start)):
        values.append((1.0 - on_lane[rows].mean(), *_measures(columns[:, rows])))
    for (kind, (limit, form)), value in zip(LIMITS.items(), np.array(values).T, strict=True):
        worst = np.argsort(-value)[: (value > limit).sum()]
        if len(worst):
            names = _first(form.format(tracks.names[each], value[each]) for each in worst)
            yield Finding(kind, f"{len(worst)} track{'s' * (len(worst) > 1)}: {names}")


def _measures(columns: Floats) -> tuple[float, float]:
    """Return the values of a track for `LIMITS` behind the first; columns as in `SAMPLE`, shape (5, n)."""
    t, x, y, _, speed = columns
    if len(t) < 2:
        return 0.0, 0.0
    apart = np.abs(np.hypot(np.diff(x), np.diff(y)) / np.diff(t) - (speed[1:] + speed[:-1]) / 2)
    begin = t[t + 2 * OVER <= t[-1] + 1e-6]
    early, now, late = (
        np.array([np.interp(begin + shift, t, axis) for axis in (x, y)]) for shift in (0.0, OVER, 2 * OVER)
    )
    acceleration = np.hypot(*(late - 2 * now + early)).max(initial=0.0) / OVER**2
    return acceleration, float(np.percentile(apart, 95))


def _contents(tracks: Tracks, present: Longs, dt: float) -> str:
    kinds = Counter(VehicleKind(kind).name.lower() for kind in tracks.kind)
    same = tracks.track[1:] == tracks.track[:-1]
    way, time = np.hypot(np.diff(tracks.x), np.diff(tracks.y))[same].sum(), np.diff(tracks.t)[same].sum()
    entered = (tracks.t[tracks.start[:-1]] > dt / 2).sum()
    return (
        f"{len(tracks)} road users ({', '.join(f'{count} {name}' for name, count in kinds.items())}), "
        f"{tracks.facts['duration']} s at {dt:g} s; {present.mean():.1f} at once on average, "
        f"{present.max()} at most; {entered} enter during the recording; mean speed {way / time:.1f} m/s"
    )


def _first(names: Iterable[str], count: int = 3) -> str:
    listed = [*names]
    return ", ".join(listed[:count]) + (", ..." if len(listed) > count else "")
