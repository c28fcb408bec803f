"""Safety: no collision, no short time to collision, no near miss."""

from collections.abc import Mapping

import numpy as np

from benchmark.metrics.encounters import find_encounters
from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.leaders import time_to_collision
from benchmark.metrics.measure import Columns, Floats, Measure, Totals, ended_by, mean_of_known, share
from smarts.types.events import Outcome

SAFE_TIME = 1.5
"""To collision [s]."""
SAFE_GAP = 1.0
"""Post-encroachment time [s]."""
LEAST_DRIVEN = 5.0
"""For driving time to count [m]."""


def measure(episode: EpisodeData) -> Columns:
    """Return collisions, driving time that is safe and in all, encounters that are safe and in all."""
    times = episode.shared(time_to_collision)
    drove = episode.entered & (episode.agents["distance_travelled"] >= LEAST_DRIVEN)
    encounters = episode.shared(find_encounters)
    is_known = np.isfinite(encounters.gap_time)
    gaps = np.bincount(encounters.agent[is_known], minlength=episode.count)
    safe = is_known & (encounters.gap_time > SAFE_GAP)
    return {
        "collisions": ended_by(episode, Outcome.COLLISION),
        "safe_time": np.where(drove, (times > SAFE_TIME).sum(axis=0) * episode.dt, 0.0),
        "driving_time": np.where(drove, (~np.isnan(times)).sum(axis=0) * episode.dt, 0.0),
        "gaps": gaps.astype(float),
        "safe_gaps": np.bincount(encounters.agent[safe], minlength=episode.count).astype(float),
    }


def terms(totals: Totals) -> Mapping[str, Floats]:
    """Return the three shares."""
    return {
        "non_collision": 1.0 - share(totals["collisions"], totals["agents"]),
        "time_to_collision": share(totals["safe_time"], totals["driving_time"]),
        "post_encroachment_time": share(totals["safe_gaps"], totals["gaps"]),
    }


METRIC = Measure(
    name="safety",
    label="Safety",
    meaning="mean of: non-collision rate; share of driving time with time-to-collision above 1.5 s; "
    "share of conflict encounters with post-encroachment time above 1.0 s",
    columns=("collisions", "safe_time", "driving_time", "gaps", "safe_gaps"),
    measure=measure,
    value=lambda totals: mean_of_known(terms(totals)),
    missing="no agent took part",
    better="higher",
    is_axis=True,
    terms=terms,
)
