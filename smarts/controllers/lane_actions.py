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

_NUMBERS = np.array([*LaneAction])


class LaneFormat:
    """The format of a `LaneAction`, given by number or name."""

    has_path = False

    def space(self) -> Discrete:
        """Return a new `Discrete` of the four actions."""
        return Discrete(len(LaneAction))

    def remedy(self) -> str:
        """Return the remedy of error messages: the numbers and names of the actions."""
        return f"give 0 to 3: {', '.join(LaneAction.__members__)}"

    def parse(self, action: Any, place: str, most_points: int) -> Floats:
        """Return the number, shape (1,); see `ActionFormat`."""
        if isinstance(action, str):
            if action in LaneAction.__members__:
                return np.array([float(LaneAction[action])])
            close = difflib.get_close_matches(action, LaneAction.__members__, n=1)
            remedy = f"did you mean {close[0]!r}?" if close else self.remedy()
            raise rejection(action, "is not a lane action", place, remedy)
        number = numbers_of(action, (1,), place, self.remedy)
        if not (number == _NUMBERS).any():
            raise rejection(action, "is not a lane action", place, self.remedy)
        return number

    def parse_batch(self, values: NDArray) -> Floats | Rejected:
        """Return the numbers, shape (N, 1); see `ActionFormat`."""
        is_bad = ~(values[:, None] == _NUMBERS).any(axis=1)
        return Rejected(int(np.argmax(is_bad)), "is not a lane action") if is_bad.any() else values[:, None]

    def write(self, parsed: Floats, places: Places, out: Actions) -> None:
        """Write the first column of `Actions.values`."""
        out.values[(*places, slice(1))] = parsed


class LaneActions(LaneFollowing):
    """Follows lanes by `LaneAction`s: keep the lane, slow down, change to the left or right lane.

    Values: the number of the action. The target speed is the lane's limit or the scenario's maximum speed,
    whichever is lower, and at most 12.5 m/s during a lane change. `slow_down` brakes to a standstill.

    Args:
        scene: The world, its maps and its routes.
        speeds: Maximum speed on each map [m/s], shape (M,).
    """

    action_format: ClassVar[ActionFormat] = LaneFormat()
    command_type: ClassVar[int] = BY_NAME
