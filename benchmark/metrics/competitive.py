"""Competitive: overtaking where that is possible, and going first where one was predicted second."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from benchmark.metrics.encounters import FIRST, UNRESOLVED, find_encounters
from benchmark.metrics.episode_data import EpisodeData, Lanes, Paths, VehicleTracks
from benchmark.metrics.leaders import distance_ahead, leader_of
from benchmark.metrics.measure import Columns, Floats, Measure, Totals, mean_of_known, ratio, share
from smarts.geometry.compiling import kernel
from smarts.roads.lane_graph import LaneKind

LEAST = 10
"""Opportunities, and contested encounters, for a share."""
LEAST_TIME = 1.0
"""Behind the leader [s]."""
MOST_GAP = 30.0
"""To the leader, bumper to bumper [m]."""
SLOWER = 1.0
"""By more than this is the leader's desired speed lower [m/s]."""

_CAR = int(LaneKind.CAR)


def measure(episode: EpisodeData) -> Columns:
    """Return opportunities to overtake and to go first, and those that were taken."""
    columns = {**_contested(episode), "opportunities": np.zeros(episode.count)}
    columns["overtakes"] = np.zeros(episode.count)
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


def _contested(episode: EpisodeData) -> dict[str, Floats]:
    """Return encounters in which the agent was predicted second and one entered, and which it pushed into."""
    encounters = episode.shared(find_encounters)
    is_contested = encounters.is_predicted_second & (encounters.result != UNRESOLVED)
    pushes = is_contested & (encounters.result == FIRST) & ~encounters.is_courtesy
    return {
        name: np.bincount(encounters.agent[rows], minlength=episode.count).astype(float)
        for name, rows in (("contested", is_contested), ("pushed_in", pushes))
    }


def measure_braking(episode: EpisodeData) -> Columns:
    """Return the sum of the other's largest decelerations in contested encounters, and their number."""
    encounters = episode.shared(find_encounters)
    rows = encounters.is_predicted_second & (encounters.result != UNRESOLVED)
    braking = np.bincount(encounters.agent[rows], encounters.braking[rows], episode.count)
    return {"imposed_braking": braking, "contested": _contested(episode)["contested"]}


def terms(totals: Totals) -> Mapping[str, Floats]:
    """Return the two shares."""
    return {
        "overtaking": share(totals["overtakes"], totals["opportunities"]),
        "going_first": share(totals["pushed_in"], totals["contested"]),
    }


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


METRIC = Measure(
    name="competitive",
    label="Competitive",
    meaning="taking what is contested: mean of overtakes / opportunities (a slower leader within 30 m for "
    "1 s and a lane to pass on) and pushed in / conflict encounters in which the agent was predicted second "
    "by 0.2 s to 3 s; pushed in: entered first by gaining more time than the other lost",
    columns=("overtakes", "opportunities", "pushed_in", "contested"),
    measure=measure,
    value=lambda totals: mean_of_known(terms(totals)),
    count=("opportunities", "contested"),
    counted="opportunities and contested encounters",
    scarce=("opportunities", "contested"),
    least=LEAST,
    missing=f"fewer than {LEAST} opportunities, and fewer than {LEAST} contested encounters",
    better="higher",
    terms=terms,
)
IMPOSED_BRAKING = ratio(
    "imposed_braking",
    "contested",
    name="imposed_braking",
    label="Imposed braking",
    meaning="mean of the other's largest deceleration in conflict encounters in which the agent was "
    "predicted second, until the other arrives",
    measure=measure_braking,
    counted="contested encounters",
    missing="no encounter in which an agent was predicted second",
    better="lower",
    unit="m/s^2",
    is_share=False,
)
