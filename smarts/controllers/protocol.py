"""What a controller is."""

from __future__ import annotations

from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.roads.scene import Scene
from smarts.types.actions import Actions, ActionSpaceType, Commands

Bools = NDArray[np.bool_]


class Controller(Protocol):
    """Decides 10 times a second what vehicles are to follow; the vehicles themselves track it at 100 Hz.

    What is to be remembered of a seat stands in `world.seats` (the latch of lane changes), so that a reset of
    the seats resets the controller.
    """

    action: ClassVar[ActionSpaceType]

    def command(self, scene: Scene, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the commands of the chosen seats, and nothing of the others.

        Edge actions (a lane change, a relative pose) count where `actions.fresh`; whether they can be carried
        out is decided then, against `actions.legal`, and kept in `seats.effective` until the next.

        Args:
            scene: The state at the begin of the step.
            actions: Of all seats, shape (B, A).
            chosen: The active seats of stepped simulations that act by this type, shape (B, A).
            out: To write into.
        """
        ...
