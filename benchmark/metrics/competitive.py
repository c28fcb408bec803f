"""Competitive: overtaking slower vehicles where that is possible."""

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.episode_data import EpisodeData, Lanes, Paths, VehicleTracks
from benchmark.metrics.leaders import distance_ahead, leader_of
from benchmark.metrics.measure import Columns, ratio
from smarts.geometry.compiling import kernel
from smarts.roads.lane_graph import LaneKind

LEAST_OPPORTUNITIES = 10
"""For a ratio."""
LEAST_TIME = 1.0
"""Behind the leader [s]."""
MOST_GAP = 30.0
"""To the leader, bumper to bumper [m]."""
SLOWER = 1.0
"""By more than this is the leader's desired speed lower [m/s]."""

_CAR = int(LaneKind.CAR)


def measure(episode: EpisodeData) -> Columns:
    """Return opportunities, and those that were taken."""
    columns = {name: np.zeros(episode.count) for name in METRIC.columns}
    least = round(LEAST_TIME / episode.dt)
    for agent in np.flatnonzero(episode.own >= 0).tolist():
        columns["opportunities"][agent], columns["overtakes"][agent] = _opportunities(
            episode.motion,
            episode.paths,
            episode.lanes,
            int(episode.own[agent]),
            episode.driving[:, agent],
            least,
        )
    return columns


@kernel
def _opportunities(
    motion: VehicleTracks, paths: Paths, lanes: Lanes, own: int, driving: NDArray[np.bool_], least: int
) -> tuple[int, int]:
    """Count the vehicles that could be overtaken, and those that were; each counts once."""
    vehicles = motion.present.shape[1]
    behind, is_open, is_taken = np.zeros(vehicles), np.zeros(vehicles), np.zeros(vehicles)
    for k in range(len(driving)):
        if not driving[k]:
            continue
        leader, ahead = leader_of(motion, paths, lanes, own, k)
        for other in range(vehicles):
            follows = other == leader and _could_pass(motion, lanes, own, other, ahead, k)
            # Instants are one more than the steps between them.
            behind[other] = behind[other] + 1 if follows else 0
            if behind[other] > least:
                is_open[other] = 1
            if is_open[other] > 0 and is_taken[other] == 0:
                reach = (motion.length[own] + motion.length[other]) / 2
                if distance_ahead(motion, paths, lanes, own, other, k) < -reach:
                    is_taken[other] = 1
    return int(is_open.sum()), int(is_taken.sum())


@kernel
def _could_pass(motion: VehicleTracks, lanes: Lanes, own: int, leader: int, ahead: float, k: int) -> bool:
    """Return whether a leader is near, slower, in the same direction, and a lane beside is open to cars."""
    if ahead - (motion.length[own] + motion.length[leader]) / 2 > MOST_GAP:
        return False
    if motion.desired_speed[k, own] - motion.desired_speed[k, leader] <= SLOWER:
        return False
    if abs(motion.turn[k, leader]) > np.pi / 2:
        return False
    lane = motion.lane[k, own]
    left, right = lanes.left[lane], lanes.right[lane]
    is_open = (left >= 0 and lanes.kind[left] == _CAR) or (right >= 0 and lanes.kind[right] == _CAR)
    return bool(is_open)


METRIC = ratio(
    "overtakes",
    "opportunities",
    is_count=True,
    name="competitive",
    label="Competitive",
    meaning="overtakes / opportunities: a slower leader within 30 m for 1 s and a lane to pass on",
    measure=measure,
    counted="opportunities",
    least=LEAST_OPPORTUNITIES,
    missing=f"fewer than {LEAST_OPPORTUNITIES} opportunities",
    better="higher",
)
