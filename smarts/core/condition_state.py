"""Alias of `smarts.types.condition_state`."""

from smarts.types.condition_state import ConditionState

__all__ = ["ConditionState"]
