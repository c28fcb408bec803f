"""Controllers: convert actions of one type to vehicle commands, for all agents of that type in one call.

Control has two levels. A controller writes `Commands` at 10 Hz: a reference, actuators, or poses. The
tracking law (`tracking`) follows a reference at 100 Hz, by feedback on the vehicle's motion.

A new controller is one file here and one line in `ActionSpaceType`, which names it.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

from smarts.registry import Registry
from smarts.types.actions import ActionSpaceType

if TYPE_CHECKING:
    from gymnasium.spaces import Space

    from smarts.controllers.action_formats import ActionFormat

CONTROLLERS = Registry("controller", {kind.name: kind.controller for kind in ActionSpaceType})
"""`ActionSpaceType` name -> a `protocol.Controller` class, constructed with a `Scene`."""


@cache
def action_format(kind: int) -> ActionFormat:
    """Return the action format of an `ActionSpaceType`."""
    return CONTROLLERS[ActionSpaceType(kind).name].action_format


def action_space(kind: int) -> Space:
    """Return a new Gymnasium space for the actions of an `ActionSpaceType`."""
    return action_format(kind).space()
