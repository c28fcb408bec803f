"""Whether agents meet social vehicles at all: a cell with traffic in which they do not is one without."""

import numpy as np

from benchmark.metrics.encounters import find_encounters
from benchmark.metrics.episode_data import EpisodeData, Lanes, Paths, VehicleTracks
from benchmark.metrics.lane_changes import find_lane_changes
from benchmark.metrics.leaders import leader_of
from benchmark.metrics.measure import Columns, ratio
from smarts.arrays import Bools
from smarts.geometry.compiling import kernel

HEADWAY = 2.0
"""Behind a social leader [s]."""
NEAR = 20.0
"""To a social vehicle during a lane change, between centres [m]."""


def measure(episode: EpisodeData) -> Columns:
    """Return 1 for each agent that had a conflict with, followed, or changed lanes near a social vehicle."""
    is_social = np.ones(episode.motion.present.shape[1], np.bool_)
    is_social[episode.own[episode.own >= 0]] = False
    encounters = episode.shared(find_encounters)
    changes = episode.shared(find_lane_changes)
    met = np.zeros(episode.count)
    met[encounters.agent[is_social[encounters.other]]] = 1.0
    for agent in np.flatnonzero(episode.own >= 0).tolist():
        own, driving = int(episode.own[agent]), episode.driving[:, agent]
        args = (
            episode.motion,
            episode.paths,
            episode.lanes,
            own,
            driving,
            changes.under_way[:, agent],
            is_social,
        )
        met[agent] = max(met[agent], float(_follows_or_changes(*args)))
    return {"met_social": met}


@kernel
def _follows_or_changes(
    motion: VehicleTracks,
    paths: Paths,
    lanes: Lanes,
    own: int,
    driving: Bools,
    is_changing: Bools,
    is_social: Bools,
) -> bool:
    for k in range(len(driving)):
        if not driving[k] or not motion.present[k, own]:
            continue
        leader, ahead = leader_of(motion, paths, lanes, own, k)
        if leader >= 0 and is_social[leader]:
            gap = ahead - (motion.length[own] + motion.length[leader]) / 2
            if gap < HEADWAY * motion.speed[k, own]:
                return True
        if not is_changing[k]:
            continue
        for other in range(len(is_social)):
            if is_social[other] and motion.present[k, other]:
                dx, dy = motion.x[k, other] - motion.x[k, own], motion.y[k, other] - motion.y[k, own]
                if np.hypot(dx, dy) <= NEAR:
                    return True
    return False


METRIC = ratio(
    "met_social",
    is_count=True,
    name="social_encounters",
    label="Met social vehicles",
    meaning="share of agent-episodes with a conflict with a social vehicle, a social leader within 2 s of "
    "headway, or a lane change with a social vehicle within 20 m",
    measure=measure,
    missing="no agent took part",
)
