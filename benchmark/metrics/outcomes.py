"""Shares of outcomes: completion rate, collision rate, and all other ways in which agent-episodes end."""

from functools import partial
from typing import Any

import numpy as np

from benchmark.metrics.episode_data import EpisodeData
from benchmark.metrics.measure import Columns, Measure, ended_by, ratio
from smarts.types.events import Outcome
from smarts.types.vehicles import VehicleKind

VULNERABLE = [VehicleKind.MOTORCYCLE, VehicleKind.BICYCLE, VehicleKind.PEDESTRIAN]


def _measure(outcome: Outcome, column: str, episode: EpisodeData) -> Columns:
    return {column: ended_by(episode, outcome)}


def outcome_share(outcome: Outcome, ended: str = "", column: str = "", **given: Any) -> Measure:
    """Return the share of agent-episodes with an outcome.

    Args:
        outcome: The outcome.
        ended: How they ended, where the outcome's name does not say it.
        column: Name of the column, by default that of the metric.
        given: Fields of `Measure` with other values than the usual ones.
    """
    words = outcome.name.lower().replace("_", "-")
    usual = {
        "name": f"ended_{outcome.name.lower()}",
        "label": words.capitalize(),
        "meaning": f"share of agent-episodes {f'that ended {ended}' if ended else f'with outcome {words}'}",
        "missing": "no agent took part",
        "better": "lower",
    }
    fields = {**usual, **given}
    column = column or fields["name"]
    return ratio(column, is_count=True, measure=partial(_measure, outcome, column), **fields)


COLLISION_RATE = outcome_share(
    Outcome.COLLISION,
    "by a collision with any vehicle",
    "collisions",
    name="collision_rate",
    label="Collision rate",
)


def _measure_vulnerable(episode: EpisodeData) -> Columns:
    is_vulnerable = np.isin(np.append(episode.kind, -1), VULNERABLE)
    hit = ended_by(episode, Outcome.COLLISION) * is_vulnerable[episode.partner]
    return {
        "vulnerable_collisions": hit,
        "agents_among_vulnerable": np.full(len(hit), float(is_vulnerable.any())),
    }


VULNERABLE_COLLISION_RATE = ratio(
    "vulnerable_collisions",
    "agents_among_vulnerable",
    is_count=True,
    measure=_measure_vulnerable,
    name="vulnerable_collision_rate",
    label="Collisions with vulnerable road users",
    meaning="share of agent-episodes with cycles or pedestrians that ended by a collision with one of them",
    missing="there was none",
    better="lower",
)
COMPLETION_RATE = outcome_share(
    Outcome.GOAL, "at the goal", "goals", name="completion_rate", label="Completion rate", better="higher"
)
OFF_ROAD = outcome_share(Outcome.OFF_ROAD)
OFF_ROUTE = outcome_share(Outcome.OFF_ROUTE)
MISSED_GOAL = outcome_share(Outcome.MISSED_GOAL)
NOT_MOVING = outcome_share(Outcome.NOT_MOVING)
TIME_OUT = outcome_share(Outcome.TIME_OUT)
OTHER = outcome_share(Outcome.OTHER, "for another's sake: too few agents or vehicles of interest were left")
OTHER_TERMINAL = outcome_share(
    Outcome.OTHER_TERMINAL, "on the shoulder, against the direction, at a via point or after a lap"
)
LEFT_BUBBLE = outcome_share(
    Outcome.LEFT_BUBBLE, "where the vehicle left the bubble in which the agent learns", better=None
)
