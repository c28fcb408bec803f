"""The four discrete lane actions."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from typing import ClassVar

from smarts.controllers.action_numbers import numbers_of, refusal
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
    remedy = f"give 0 to 3: {', '.join(names)}"
    if isinstance(action, str):
        if action in names:
            return int(LaneAction[action])
        close = difflib.get_close_matches(action, names, n=1)
        raise _refusal(action, agent, f"did you mean {close[0]!r}?" if close else remedy)
    number = float(numbers_of(action, (), place=agent, remedy=remedy))
    if number not in (*LaneAction,):
        raise _refusal(action, agent, remedy)
    return int(number)


def _refusal(action: object, agent: str, remedy: str) -> ActionError:
    return refusal(action, "is no lane action", agent, remedy)
