"""No control."""

from __future__ import annotations

from typing import ClassVar

from smarts.arrays import Bools
from smarts.controllers.action_formats import ActionFormat, NumbersFormat
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, CommandMode, Commands


class Empty:
    """Lets the vehicle roll with constant steering; any action is valid."""

    action_format: ClassVar[ActionFormat] = NumbersFormat([], [])
    follows_lanes: ClassVar[bool] = False

    def __init__(self, scene: Scene) -> None:
        pass

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Set the mode of the chosen agents to NONE; see `Controller`."""
        out.mode[chosen] = CommandMode.NONE
