"""Metrics by name."""

from dataclasses import replace
from typing import Any

from smarts.registry import Registry, guarded


def _adopt(name: str, found: Any) -> Any:
    """Return a user's measure under its "module:NAME"."""
    from benchmark.metrics.measure import Measure  # here: listing names imports nothing

    if not isinstance(found, Measure):
        raise ValueError("is not a Measure (from benchmark.metrics import Measure)")
    doing = f"the metric {name!r}"
    return replace(
        found,
        name=name,
        measure=guarded(found.measure, doing),
        value=guarded(found.value, doing),
        terms=None if found.terms is None else guarded(found.terms, doing),
    )


METRICS = Registry(
    "metric",
    {
        "collision_rate": "benchmark.metrics.outcomes:COLLISION_RATE",
        "completion_rate": "benchmark.metrics.outcomes:COMPLETION_RATE",
        "generalization": "benchmark.metrics.generalization:METRIC",
        "safety": "benchmark.metrics.safety:METRIC",
        "agility": "benchmark.metrics.agility:METRIC",
        "stability": "benchmark.metrics.stability:METRIC",
        "control_diversity": "benchmark.metrics.control_diversity:METRIC",
        "cut_in_ratio": "benchmark.metrics.cut_in_ratio:METRIC",
        "stochasticity": "benchmark.metrics.stochasticity:METRIC",
        "collaborative": "benchmark.metrics.collaborative:METRIC",
        "competitive": "benchmark.metrics.competitive:METRIC",
        "progress_speed": "benchmark.metrics.agility:PROGRESS_SPEED",
        "at_fault_collision_rate": "benchmark.metrics.at_fault_collision_rate:METRIC",
        "vulnerable_collision_rate": "benchmark.metrics.outcomes:VULNERABLE_COLLISION_RATE",
        "ended_off_road": "benchmark.metrics.outcomes:OFF_ROAD",
        "ended_off_route": "benchmark.metrics.outcomes:OFF_ROUTE",
        "ended_missed_goal": "benchmark.metrics.outcomes:MISSED_GOAL",
        "ended_not_moving": "benchmark.metrics.outcomes:NOT_MOVING",
        "ended_time_out": "benchmark.metrics.outcomes:TIME_OUT",
        "ended_other": "benchmark.metrics.outcomes:OTHER",
        "ended_other_terminal": "benchmark.metrics.outcomes:OTHER_TERMINAL",
        "ended_left_bubble": "benchmark.metrics.outcomes:LEFT_BUBBLE",
        "goal_distance": "benchmark.metrics.extras:GOAL_DISTANCE",
        "return": "benchmark.metrics.extras:RETURN",
        "least_time_to_collision": "benchmark.metrics.extras:LEAST_TIME_TO_COLLISION",
        "social_encounters": "benchmark.metrics.social_encounters:METRIC",
        "imposed_braking": "benchmark.metrics.competitive:IMPOSED_BRAKING",
        "hard_brakes": "benchmark.metrics.extras:HARD_BRAKES",
        "decision_rate": "benchmark.metrics.extras:DECISION_RATE",
    },
    _adopt,
)
"""Name -> "module:attribute" of a `benchmark.metrics.measure.Measure`; the paper's
metrics come first. User metrics use the same form and are appended on first use."""
ALWAYS = ("collision_rate", "completion_rate")
"""Metrics that are always measured: main table and ranking need them."""
PAPER_METRICS = tuple(METRICS)[:11]
"""Metrics of the SMARTS paper."""
