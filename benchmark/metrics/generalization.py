"""Generalization: what is left of completion and safety in each variation that was not trained on."""

from collections.abc import Mapping

import numpy as np

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.measure import Columns, Floats, Measure, Totals, ended_by, share
from smarts.types.events import Outcome

SPLITS = ("train", "held_out")
LEAST_COMPLETION = 0.5
"""In training, below which there is nothing to generalize."""


def measure(episode: EpisodeData) -> Columns:
    """Return agents, goals and collisions in columns of the episode's split."""
    counts = {
        "agents": episode.entered.astype(float),
        "goals": ended_by(episode, Outcome.GOAL),
        "collisions": ended_by(episode, Outcome.COLLISION),
    }
    return {
        f"{split}_{name}": column if split == episode.split else np.zeros(episode.count)
        for split in SPLITS
        for name, column in counts.items()
    }


def terms(totals: Totals) -> Mapping[str, Floats]:
    """Return the raw pairs: completion and non-collision rates in training and in a held-out variation."""
    rates = {}
    for split in SPLITS:
        agents = totals[f"{split}_agents"]
        rates[f"{split}_completion"] = share(totals[f"{split}_goals"], agents)
        rates[f"{split}_non_collision"] = 1.0 - share(totals[f"{split}_collisions"], agents)
    return rates


def value(totals: Totals) -> Floats:
    """Return the smaller of min(1, held-out / training) of the two rates, of one held-out variation."""
    rates = terms(totals)
    kept = [
        np.minimum(1.0, share(rates[f"held_out_{name}"], rates[f"train_{name}"]))
        for name in ("completion", "non_collision")
    ]
    is_trained = rates["train_completion"] >= LEAST_COMPLETION
    return np.where(is_trained, np.min(kept, axis=0), np.nan)


METRIC = Measure(
    name="generalization",
    label="Generalization",
    meaning="mean over held-out variations of the smaller of min(1, held-out / training) of completion and "
    "of non-collision rate; the worst variation stands beside it",
    columns=tuple(f"{split}_{name}" for split in SPLITS for name in ("agents", "goals", "collisions")),
    measure=measure,
    value=value,
    count=("held_out_agents",),
    counted="held-out agent-episodes",
    missing="no held-out variation was played, or completion in training is below 0.5",
    better="higher",
    terms=terms,
    is_by_variation=True,
)
