"""The interface of controllers."""

from __future__ import annotations

from typing import ClassVar, Protocol

from smarts.arrays import Bools
from smarts.controllers.action_formats import ActionFormat
from smarts.types.actions import Actions, Commands


class Controller(Protocol):
    """Decides 10 times a second what vehicles are to follow; the vehicles themselves track it at 100 Hz.

    The memory of a controller is in `world.agents` (the latch of lane changes), so a reset of the agents
    resets it. A controller is made with the scene that it works in.
    """

    action_format: ClassVar[ActionFormat]
    """The format of this type's actions."""
    follows_lanes: ClassVar[bool]
    """Whether it writes the agents' target lane and the vehicles' desired speed. Such a controller is made
    with the largest speeds on each map [m/s], shape (M,), too."""

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the commands of the chosen agents, and nothing of the others.

        Edge actions (a lane change, a relative pose) count where `actions.fresh`; whether they can be carried
        out is decided then, against `actions.action_mask`, and kept in `agents.effective` until the next.

        Args:
            actions: Of all agents, shape (B, A).
            chosen: The active agents of stepped simulations that act by this type, shape (B, A).
            out: To write into.
        """
        ...
