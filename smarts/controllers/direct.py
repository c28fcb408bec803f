"""Direct control of a vehicle's motion: speed, or acceleration and yaw rate."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats
from smarts.controllers.action_formats import ActionFormat, NumbersFormat, Rejected, numbers_of
from smarts.geometry.binding import LateBound
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped_half_open
from smarts.roads.scene import Scene
from smarts.types.actions import Actions, CommandMode, Commands
from smarts.types.world import State

_PLACE = int(CommandMode.PLACE)
_TOP_SPEED = 60.0
"""Maximum speed of an action [m/s]."""


class SpeedOrMotion(NumbersFormat):
    """The format of acceleration [m/s^2] and yaw rate [rad/s], or of a speed [m/s] alone.

    A third value, added by `parse`, is 1 for a speed alone.
    """

    def remedy(self) -> str:
        """Return the remedy of error messages: give an element of the space, or a speed."""
        return f"{super().remedy()}, or a speed [m/s] alone"

    def parse(self, action: Any, place: str, most_points: int) -> Floats:
        """Return (speed, 0, 1) for a single number, else (acceleration, yaw rate, 0); see `ActionFormat`."""
        if _is_number(action):
            speed = float(numbers_of(action, (), place, self.remedy))
            return np.array([min(max(speed, -_TOP_SPEED), _TOP_SPEED), 0.0, 1.0])
        return np.append(super().parse(action, place, most_points), 0.0)

    def parse_batch(self, values: NDArray) -> Floats | Rejected:
        """Return rows (acceleration, yaw rate, 0), shape (N, 3); see `ActionFormat`."""
        parsed = super().parse_batch(values)
        return parsed if isinstance(parsed, Rejected) else np.pad(parsed, ((0, 0), (0, 1)))


def _is_number(action: Any) -> bool:
    is_array = hasattr(action, "__array__")  # arrays of any library
    return isinstance(action, int | float | np.number) or (is_array and getattr(action, "ndim", 1) == 0)


class Direct:
    """Moves a vehicle as a unicycle, without its dynamics; braking stops at standstill.

    Values: (acceleration [m/s^2], yaw rate [rad/s], 0), or (speed [m/s], 0, 1).

    Args:
        scene: The world, its maps and its routes.
    """

    action_format: ClassVar[ActionFormat] = SpeedOrMotion([-10, -np.pi], [10, np.pi])
    follows_lanes: ClassVar[bool] = False

    def __init__(self, scene: Scene) -> None:
        self._move = LateBound(move_directly, scene.world.state)

    def command(self, actions: Actions, chosen: Bools, out: Commands) -> None:
        """Write the poses of the chosen agents; see `Controller`."""
        self._move.to(actions, out)(chosen)


@kernel
def move_directly(state: State, actions: Actions, commands: Commands, chosen: Bools) -> None:
    """Write the poses of chosen agents' vehicles, integrated as unicycles; shapes as in `Commands`."""
    vehicles = state.vehicles
    for b in range(chosen.shape[0]):
        for a in range(chosen.shape[1]):
            if not chosen[b, a]:
                continue
            commands.mode[b, a] = _PLACE
            v = state.agents.slot[b, a]
            x, y, angle, pace = (
                vehicles.position[b, v, 0],
                vehicles.position[b, v, 1],
                vehicles.heading[b, v],
                vehicles.speed[b, v],
            )
            gain, turn = actions.values[b, a, 0], actions.values[b, a, 1]
            if actions.values[b, a, 2] > 0.5:
                pace, gain, turn = actions.values[b, a, 0], 0.0, 0.0
            h = state.dt / commands.poses.shape[2]
            for k in range(commands.poses.shape[2]):
                after = pace + gain * h
                if gain < 0.0 and pace >= 0.0:
                    after = max(after, 0.0)
                # The mean speed of the sub-step, along the heading at its middle.
                way, middle = 0.5 * (pace + after) * h, angle + 0.5 * turn * h
                x, y = x + way * math.cos(middle), y + way * math.sin(middle)
                angle += turn * h
                pace = after
                commands.poses[b, a, k, 0], commands.poses[b, a, k, 1] = x, y
                commands.poses[b, a, k, 2] = wrapped_half_open(angle)
                commands.poses[b, a, k, 3] = pace
