"""Controllers: actions of one type -> commands to vehicles, for all agents of that type in one call.

Control has two levels. Ten times a second a controller writes what a vehicle is to follow (`Commands`): a
reference, actuators, or poses. A hundred times a second one law (`tracking`) follows the reference, given the
vehicle's motion.

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
"""`ActionSpaceType` name -> a `protocol.Controller`, which is made with a `Scene`."""


@cache
def action_format(kind: int) -> ActionFormat:
    """Return what agents of an `ActionSpaceType` give."""
    return CONTROLLERS[ActionSpaceType(kind).name].action_format


def action_space(kind: int) -> Space:
    """Return a new Gymnasium space of the actions of an `ActionSpaceType`."""
    return action_format(kind).space()
