"""Collision rate: whose episode ended by a collision."""

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.measure import Columns, Measure, ended_by, share
from smarts.types.events import Outcome


def measure(episode: EpisodeData) -> Columns:
    """Return who collided."""
    return {"collisions": ended_by(episode, Outcome.COLLISION)}


METRIC = Measure(
    name="collision_rate",
    label="Collision rate",
    meaning="share of agent-episodes that ended by a collision with any vehicle",
    columns=("collisions",),
    measure=measure,
    value=lambda totals: share(totals["collisions"], totals["agents"]),
    hits="collisions",
    missing="no agent took part",
    better="lower",
)
