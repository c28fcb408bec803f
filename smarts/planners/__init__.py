"""Motion planners for agents: states, targets and neighbours in, paths out."""

from typing import Any

from smarts.planners.bezier import BezierPlanner
from smarts.planners.optimal_control import Weights
from smarts.planners.paths import as_actions, resample
from smarts.planners.protocol import Limits, Neighbours, Planner, Plans, PlanStatus
from smarts.planners.receding_horizon import RecedingHorizonPlanner
from smarts.registry import Registry

__all__ = [
    "PLANNERS",
    "BezierPlanner",
    "Limits",
    "Neighbours",
    "PlanStatus",
    "Planner",
    "Plans",
    "RecedingHorizonPlanner",
    "Weights",
    "as_actions",
    "resample",
]


def _adopt(name: str, found: Any) -> Any:
    """Return a user's planner: a class with a method `plan`, made with the vehicle's `Limits`."""
    if not isinstance(found, type) or not callable(getattr(found, "plan", None)):
        raise ValueError("is not a class with a method 'plan': see smarts.planners.Planner")
    return found


PLANNERS = Registry(
    "planner",
    {
        "bezier": "smarts.planners.bezier:BezierPlanner",
        "receding_horizon": "smarts.planners.receding_horizon:RecedingHorizonPlanner",
    },
    _adopt,
)
"""Name -> "module:Class" of a `Planner`, made with `Limits`; a user's own is such a "module:Class"."""
