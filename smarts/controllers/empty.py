"""No control at all."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.roads.scene import Scene
from smarts.types.actions import Actions, ActionSpaceType, CommandMode, Commands

Bools = NDArray[np.bool_]


class Empty:
    """Lets the vehicle roll on with its steering held."""

    action: ClassVar[ActionSpaceType] = ActionSpaceType.Empty

    def __init__(self, scene: Scene) -> None:
        pass

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Command nothing; see `Controller`."""
        out.mode[chosen] = CommandMode.NONE
