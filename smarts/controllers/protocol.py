"""The protocol of controllers."""

from __future__ import annotations

from typing import ClassVar, Protocol

from smarts.arrays import Bools
from smarts.controllers.action_formats import ActionFormat
from smarts.types.actions import Actions, Commands


class Controller(Protocol):
    """Writes the commands of agents of one action type at 10 Hz; vehicles execute commands at 100 Hz.

    A controller keeps its memory (the state of lane changes) in `world.agents`, so a reset of the agents
    resets it. Arrays of its own, shape (B, A, ...), it lists in an attribute `columns`: they are cleared when
    another agent takes a column. It is constructed with a `Scene`.
    """

    action_format: ClassVar[ActionFormat]
    """The format of this type's actions."""
    follows_lanes: ClassVar[bool]
    """Whether the controller writes the agents' target lanes and the vehicles' desired speeds. Such a
    controller is also constructed with the maximum speed on each map [m/s], shape (M,)."""

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the commands of the chosen agents only.

        One-time actions (a lane change, a relative pose) are executed if `actions.fresh`. The controller
        checks them against the masks of the decision and of now (`actions.action_mask`, `agents.action_mask`)
        and stores the result in `agents.effective`.

        Args:
            actions: Actions of all agents, shape (B, A).
            chosen: Active agents with this action type in the stepped simulations, shape (B, A).
            out: Commands of all agents, written.
        """
        ...
