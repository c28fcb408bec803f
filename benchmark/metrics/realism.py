"""Realism: how likely what recorded vehicles did is among what simulated drivers do in their place.

Axis letters: R rollouts, T instants, K other vehicles, C scenes, F features.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from benchmark.statistics.resampling import bootstrap_counts, bootstrap_interval
from smarts.arrays import Bools, Floats, Ints
from smarts.geometry.boxes import boxes_overlap
from smarts.geometry.frames import wrap_angle
from smarts.recordings.log import lanes_onward
from smarts.roads.atlas import RoadAtlas
from smarts.roads.lane_graph import LaneGraph
from smarts.types.streams import Purpose, stream

STEP = 0.1
"""Time between instants [s]."""
_LAG = 5
"""Accelerations and yaw rates are means over so many steps."""
_NO_LEADER = 60.0
"""Leaders are no farther ahead [m]."""
BINS = {
    "speed": np.linspace(-0.5, 40.5, 42),
    "acceleration": np.linspace(-6.25, 6.25, 26),
    "yaw_rate": np.linspace(-0.525, 0.525, 22),
    "leader_gap": np.append(np.linspace(0.0, _NO_LEADER, 21), 2.0 * _NO_LEADER),  # the last: no leader
    "time_to_collision": np.append(np.linspace(0.0, 5.0, 11), 10.0),  # the last: later, or never
    "lane_offset": np.linspace(-2.1, 2.1, 22),
}
"""Edges of each feature's bins [m, s]; values beyond them count in the outermost bins."""
SMOOTHING = 1 / 33
"""Share of a histogram that is spread evenly over its bins: what one more than 32 rollouts is of them."""
LEAST_SCENES = 20
"""With fewer scenes realism is n/a."""


class Motion(NamedTuple):
    """Vehicles over the time of a scene, shape (R, T) of one or (R, T, K) of several; NaN while not there."""

    pose: Floats
    """x, y of the centre [m], heading [rad], speed [m/s], shape (..., 4)."""
    size: Floats
    """Length and width of the footprints [m], shape (2,) or (K, 2)."""
    lane: Ints
    """Lane, -1 where there is none."""
    s: Floats
    """Place along it [m]."""
    offset: Floats
    """Offset from its middle, positive to the left [m]."""

    def of(self, columns: Any) -> Motion:
        """Return one of several vehicles by its column, or some of them."""
        places = self.lane[..., columns], self.s[..., columns], self.offset[..., columns]
        return Motion(self.pose[:, :, columns], self.size[columns], *places)

    def without(self, column: int) -> Motion:
        """Return all vehicles but one."""
        return self.of(np.arange(len(self.size)) != column)


class Features:
    """Measures features of vehicles on a map.

    Args:
        roads: The map.
    """

    def __init__(self, roads: LaneGraph) -> None:
        self._roads, self._atlas = roads, RoadAtlas([roads])
        self._ahead: dict[int, Floats] = {}
        """By lane, how far the begins of all lanes are ahead of its own, straight on [m], shape (L,)."""

    def motion(self, pose: Floats, size: Floats) -> Motion:
        """Return vehicles with their places on lanes; see `Motion`."""
        is_there, found = ~np.isnan(pose[..., 0]), np.nan_to_num(pose).reshape(-1, 4)
        maps, height = np.zeros(len(found), np.int32), np.full(len(found), np.nan)
        lane, s, offset, distance = self._atlas.locate(maps, found[:, :2], found[:, 2].copy(), height=height)
        lane = np.where(is_there.ravel() & (distance <= self._roads.width[lane]), lane, -1)
        shape = is_there.shape
        return Motion(pose, size, lane.reshape(shape), s.reshape(shape), offset.reshape(shape))

    def measure(self, own: Motion, others: Motion) -> dict[str, Floats]:
        """Return the features of a vehicle by name, arrays of shape (R, T), NaN while it is not there.

        Differences have T - 5 instants.

        Args:
            own: The vehicle.
            others: All others, in as many rollouts, or in one if all are alike.
        """
        turn, speed, lane = own.pose[..., 2], own.pose[..., 3], own.lane
        lane2, s2, speed2 = (
            np.broadcast_to(each, (*lane.shape, len(others.size)))
            for each in (others.lane, others.s, others.pose[..., 3])
        )
        ahead = np.stack([self._onward(each) for each in lane.ravel().tolist()]).reshape(*lane.shape, -1)
        apart = np.take_along_axis(ahead, np.maximum(lane2, 0), axis=-1) + s2 - own.s[..., None]
        gap = np.where((lane2 >= 0) & (apart > 0), apart - 0.5 * (own.size[0] + others.size[..., 0]), np.inf)
        gap = np.concatenate([np.maximum(gap, 0.0), np.full_like(gap[..., :1], np.inf)], axis=-1)
        leader = gap.argmin(axis=-1)[..., None]
        gap = np.take_along_axis(gap, leader, axis=-1)[..., 0]
        closing = (
            speed - np.take_along_axis(np.pad(speed2, ((0, 0), (0, 0), (0, 1))), leader, axis=-1)[..., 0]
        )
        is_closing = (gap < _NO_LEADER) & (closing > 0)
        found = {
            "speed": speed,
            "acceleration": (speed[:, _LAG:] - speed[:, :-_LAG]) / (_LAG * STEP),
            "yaw_rate": wrap_angle(turn[:, _LAG:] - turn[:, :-_LAG]) / (_LAG * STEP),
            "leader_gap": np.where(gap < _NO_LEADER, gap, np.inf),
            "time_to_collision": np.divide(gap, closing, out=np.full_like(gap, np.inf), where=is_closing),
            "lane_offset": own.offset,
        }
        is_there = ~np.isnan(speed)
        return {name: np.where(is_there[:, -each.shape[1] :], each, np.nan) for name, each in found.items()}

    def _onward(self, lane: int) -> Floats:
        """Return a row of `_ahead`; infinite for lanes to which the way does not lead, or from -1."""
        if lane not in self._ahead:
            ahead = self._ahead[lane] = np.full(len(self._roads.lane_ids), np.inf)
            if lane >= 0:
                lanes = lanes_onward(self._roads, lane)
                ahead[lanes] = np.append(0.0, np.cumsum(self._roads.length[lanes]))[:-1]
        return self._ahead[lane]


def log_likelihoods(logged: Mapping[str, Floats], simulated: Mapping[str, Floats]) -> Floats:
    """Return the mean log-likelihood of a scene's logged values, by feature, shape (F,).

    Each feature has one histogram of all rollouts and instants at which the vehicle is there; `SMOOTHING` of
    it is spread evenly.
    """
    found = []
    for name, edges in BINS.items():
        shares = (1.0 - SMOOTHING) * _shares(simulated[name], edges) + SMOOTHING / (len(edges) - 1)
        found.append(float(_shares(logged[name], edges) @ np.log(shares)))
    return np.array(found)


def _shares(values: Floats, edges: Floats) -> Floats:
    counts, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
    return counts / max(counts.sum(), 1)


def collides(own: Motion, others: Motion) -> Bools:
    """Return in which rollouts a vehicle overlaps another one, shape (R,); see `Features.measure`."""
    pose, pose2 = own.pose[..., None, :], others.pose
    overlaps = boxes_overlap(
        pose[..., :2], pose[..., 2], own.size, pose2[..., :2], pose2[..., 2], others.size
    )
    return np.any(overlaps, axis=(-1, -2))


def realism(likelihoods: Floats) -> dict[str, float]:
    """Return realism over scenes, the ends of its 95% interval, and the value of each feature, by name.

    Realism is NaN with too few scenes.

    Args:
        likelihoods: Of each scene by `log_likelihoods`, shape (C, F).
    """
    count, found = len(likelihoods), np.full(3, np.nan)
    if count >= LEAST_SCENES:
        drawn = bootstrap_counts(np.zeros(count), stream(0, Purpose.RESAMPLING)) / count
        low, high = bootstrap_interval(np.exp(drawn @ likelihoods).mean(axis=1))
        found[:] = np.exp(likelihoods.mean(axis=0)).mean(), low, high
    values = *found.tolist(), *np.exp(likelihoods.mean(axis=0)).tolist()
    return dict(zip(("realism", "low", "high", *BINS), values, strict=True))
