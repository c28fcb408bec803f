"""Safety: no collision, no short time to collision, no near miss."""

from collections.abc import Mapping

import numpy as np

from benchmark.metrics.collision_times import time_to_collision
from benchmark.metrics.encounters import find_encounters
from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.measure import Columns, Floats, Measure, Totals, ended_by, mean_of_known, share
from smarts.types.events import Outcome

SAFE_TIME = 1.5
"""To collision [s]."""
SAFE_GAP = 1.0
"""Post-encroachment time [s]."""
LEAST_DRIVEN = 5.0
"""By an agent that counts [m]."""


def measure(episode: EpisodeData) -> Columns:
    """Return collisions, decisions and encounters of agents that drove, and how many of each were safe."""
    drove = drove_enough(episode)
    times = episode.shared(time_to_collision)
    encounters = episode.shared(find_encounters)
    is_known = np.isfinite(encounters.gap_time)
    gaps = np.bincount(encounters.agent[is_known], minlength=episode.count)
    safe = is_known & (encounters.gap_time > SAFE_GAP)
    safe_gaps = np.bincount(encounters.agent[safe], minlength=episode.count)
    found = {
        "driven_agents": drove,
        "driven_collisions": ended_by(episode, Outcome.COLLISION),
        "timed_decisions": (~np.isnan(times)).sum(axis=0),
        "safe_decisions": (times > SAFE_TIME).sum(axis=0),
        "timed_gaps": gaps,
        "safe_gaps": safe_gaps,
    }
    return {name: np.where(drove, each, 0.0) for name, each in found.items()}


def drove_enough(episode: EpisodeData) -> np.ndarray:
    """Return which agents drove 5 m, shape (A,): of others no safety is measured."""
    return episode.entered & (episode.agents["distance_travelled"] >= LEAST_DRIVEN)


def terms(totals: Totals) -> Mapping[str, Floats]:
    """Return the three shares."""
    return {
        "non_collision": 1.0 - share(totals["driven_collisions"], totals["driven_agents"]),
        "time_to_collision": share(totals["safe_decisions"], totals["timed_decisions"]),
        "post_encroachment_time": share(totals["safe_gaps"], totals["timed_gaps"]),
    }


METRIC = Measure(
    name="safety",
    label="Safety",
    meaning="mean of: non-collision rate; share of decisions with time to collision above 1.5 s, along "
    "planned paths that cross or merge as well; share of conflict encounters with post-encroachment time "
    "above 1.0 s",
    columns=(
        *("driven_agents", "driven_collisions", "timed_decisions", "safe_decisions"),
        *("timed_gaps", "safe_gaps"),
    ),
    measure=measure,
    value=lambda totals: mean_of_known(terms(totals)),
    count=("driven_agents",),
    counted="agents that drove 5 m",
    missing="no agent drove 5 m",
    better="higher",
    is_axis=True,
    terms=terms,
)
