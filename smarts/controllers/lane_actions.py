"""The four discrete lane actions."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import ClassVar

from smarts.controllers.lane_following import BY_NAME, LaneFollowing
from smarts.errors import ActionError
from smarts.types.actions import ActionSpaceType, LaneAction


class LaneActions(LaneFollowing):
    """Follows lanes as `LaneAction` says: keep the lane, slow down, change to the left or right.

    Values: the number of the action. The speed is the lane's limit, or the scenario's where that is lower;
    12.5 m/s at most while a lane change is made; `slow_down` brakes steadily to a stand.

    Args:
        scene: What the controller works in.
        speeds: The largest speed on each map [m/s], shape (M,).
    """

    action: ClassVar[ActionSpaceType] = ActionSpaceType.Lane
    manner: ClassVar[int] = BY_NAME


def lane_action_number(action: object, *, agent: str = "") -> int:
    """Return the number of a lane action given by number or name.

    Raises:
        ActionError: There is no such action.
    """
    names: Sequence[str] = [known.name for known in LaneAction]
    if isinstance(action, str) and action in names:
        return int(LaneAction[action])
    if not isinstance(action, str | bool):
        try:
            number = int(action)  # type: ignore[call-overload]
        except (TypeError, ValueError, OverflowError):
            number = -1
        if number == action and 0 <= number < len(names):
            return number
    close = difflib.get_close_matches(action, names, n=1) if isinstance(action, str) else []
    remedy = f"did you mean {close[0]!r}?" if close else f"give 0 to 3, or one of {', '.join(names)}"
    raise ActionError(f"there is no lane action {action!r}", place=agent, remedy=remedy)
