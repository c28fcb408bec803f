"""The four discrete lane actions."""

from __future__ import annotations

import difflib
from typing import Any, ClassVar

import numpy as np
from gymnasium.spaces import Discrete
from numpy.typing import NDArray

from smarts.arrays import Floats
from smarts.controllers.action_formats import ActionFormat, Places, Rejected, numbers_of, rejection
from smarts.controllers.lane_following import BY_NAME, LaneFollowing
from smarts.types.actions import Actions, LaneAction

_NUMBERS = [int(action) for action in LaneAction]


class LaneFormat:
    """A `LaneAction`, by number or name."""

    has_path = False

    def space(self) -> Discrete:
        """Return a new `Discrete` of the four actions."""
        return Discrete(len(LaneAction))

    def remedy(self) -> str:
        """Return the numbers and names."""
        return f"give 0 to 3: {', '.join(LaneAction.__members__)}"

    def parse(self, action: Any, place: str, most_points: int) -> Floats:
        """Return the number, shape (1,); see `ActionFormat`."""
        if isinstance(action, str):
            if action in LaneAction.__members__:
                return np.array([float(LaneAction[action])])
            close = difflib.get_close_matches(action, LaneAction.__members__, n=1)
            remedy = f"did you mean {close[0]!r}?" if close else self.remedy()
            raise rejection(action, "is no lane action", place, remedy)
        number = numbers_of(action, (1,), place, self.remedy)
        if number[0] not in _NUMBERS:
            raise rejection(action, "is no lane action", place, self.remedy)
        return number

    def parse_batch(self, values: NDArray) -> Floats | Rejected:
        """Return the numbers, shape (N, 1); see `ActionFormat`."""
        is_bad = ~np.isin(values, _NUMBERS)
        return Rejected(int(np.argmax(is_bad)), "is no lane action") if is_bad.any() else values[:, None]

    def write(self, parsed: Floats, places: Places, out: Actions) -> None:
        """Write the first column of `Actions.values`."""
        out.values[(*places, slice(1))] = parsed


class LaneActions(LaneFollowing):
    """Follows lanes as `LaneAction` says: keep the lane, slow down, change to the left or right.

    Values: the number of the action. The speed is the lane's limit, or the scenario's where that is lower;
    12.5 m/s at most while a lane change is made; `slow_down` brakes steadily to a stand.

    Args:
        scene: What the controller works in.
        speeds: The largest speed on each map [m/s], shape (M,).
    """

    action_format: ClassVar[ActionFormat] = LaneFormat()
    manner: ClassVar[int] = BY_NAME
