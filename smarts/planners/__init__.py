"""Motion planners for agents: states, targets and neighbours in, paths out."""

from smarts.planners.bezier import BezierPlanner
from smarts.planners.optimal_control import Weights
from smarts.planners.paths import as_actions, resample
from smarts.planners.protocol import Limits, Neighbours, Planner, Plans, PlanStatus
from smarts.planners.receding_horizon import RecedingHorizonPlanner

__all__ = [
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
