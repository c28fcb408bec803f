"""Completion rate: who reached the goal."""

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.measure import Columns, Measure, ended_by, share
from smarts.types.events import Outcome


def measure(episode: EpisodeData) -> Columns:
    """Return who arrived."""
    return {"goals": ended_by(episode, Outcome.GOAL)}


METRIC = Measure(
    name="completion_rate",
    label="Completion rate",
    meaning="share of agent-episodes that ended at the goal",
    columns=("goals",),
    measure=measure,
    value=lambda totals: share(totals["goals"], totals["agents"]),
    hits="goals",
    missing="no agent took part",
    better="higher",
)
