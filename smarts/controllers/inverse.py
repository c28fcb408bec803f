"""Inverses of controllers: the action that explains how a vehicle has moved.

Axis letters: N vehicles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from smarts.arrays import Bools, Floats, Ints
from smarts.controllers import action_format
from smarts.controllers.lane_following import SLOWING
from smarts.controllers.tracking import SPEED_GAIN
from smarts.errors import ActionError
from smarts.types.actions import ActionSpaceType, LaneAction

GAINING = 2.0
"""Acceleration of a vehicle that keeps its lane below the speed limit, roughly [m/s^2]."""
SUBSTEP = 0.01
"""[s]"""


class Motion(NamedTuple):
    """How N vehicles have moved between two decisions; the first axis of 2 is before and after."""

    position: Floats
    """[m], shape (2, N, 2)."""
    heading: Floats
    """[rad], shape (2, N)."""
    speed: Floats
    """[m/s], shape (2, N)."""
    side: Ints
    """1: into the lane to the left, -1: to the right, 0: neither, shape (N,)."""
    limit: Floats
    """Speed limit at the decision [m/s], shape (N,)."""
    action_mask: Bools
    """Lane actions that were allowed, shape (N, 4)."""
    time: float
    """[s]"""

    @property
    def acceleration(self) -> Floats:
        """Mean acceleration [m/s^2], shape (N,)."""
        return (self.speed[1] - self.speed[0]) / self.time

    @property
    def distance(self) -> Floats:
        """Distance between both positions [m], shape (N,)."""
        return np.linalg.norm(self.position[1] - self.position[0], axis=-1)


Inverse = Callable[[Motion], tuple[Floats, Floats]]
"""Motion -> the actions that explain it, shape (N, ...), within the bounds of their space, and how far from
it they end [m], shape (N,): in the plane for `Direct`, along the way for the others, whose paths are their
controllers' own."""


def inverse_of(action: str) -> Inverse:
    """Return the inverse of the controller of an action type, given by its name.

    Raises:
        ActionError: It has none.
    """
    if action not in INVERSES:
        raise ActionError(
            f"no action {action!r} follows from a vehicle's motion",
            place="action",
            remedy=f"use one of {', '.join(INVERSES)}",
        )
    return INVERSES[action]


def _direct(motion: Motion) -> tuple[Floats, Floats]:
    turn = np.pi - (np.pi - motion.heading[1] + motion.heading[0]) % (2.0 * np.pi)
    actions = _within(ActionSpaceType.Direct, np.column_stack([motion.acceleration, turn / motion.time]))
    position, heading, speed = motion.position[0].copy(), motion.heading[0].copy(), motion.speed[0].copy()
    for _ in range(round(motion.time / SUBSTEP)):  # as `move_directly` integrates
        after = speed + actions[:, 0] * SUBSTEP
        after = np.where((actions[:, 0] < 0.0) & (speed >= 0.0), np.maximum(after, 0.0), after)
        middle = heading + 0.5 * actions[:, 1] * SUBSTEP
        way = 0.5 * (speed + after) * SUBSTEP
        position += way[:, None] * np.column_stack([np.cos(middle), np.sin(middle)])
        heading, speed = heading + actions[:, 1] * SUBSTEP, after
    return actions, np.linalg.norm(position - motion.position[1], axis=-1)


def _along_path(motion: Motion) -> tuple[Floats, Floats]:
    actions = _within(ActionSpaceType.AlongPath, motion.acceleration[:, None])
    return actions, _residual(motion, motion.speed[0] + actions[:, 0] * motion.time)


def _lane_and_speed(motion: Motion) -> tuple[Floats, Floats]:
    # The distance to a target speed that is held goes to 0 exponentially.
    reached = 1.0 - math.exp(-SPEED_GAIN * motion.time)
    before, after = motion.speed
    wanted = np.stack([before + (after - before) / reached, motion.side.astype(float)], axis=1)
    actions = _within(ActionSpaceType.LaneWithContinuousSpeed, wanted)
    return actions, _residual(motion, before + reached * (actions[:, 0] - before))


def _lane(motion: Motion) -> tuple[Floats, Floats]:
    """Return the lane change, else which of `keep_lane` and `slow_down` comes nearer to the speed."""
    before, after = motion.speed
    kept = np.clip(motion.limit, before - SLOWING * motion.time, before + GAINING * motion.time)
    slowed = np.maximum(before - SLOWING * motion.time, 0.0)
    actions = np.where(
        np.abs(after - slowed) < np.abs(after - kept), LaneAction.slow_down, LaneAction.keep_lane
    )
    change = np.where(motion.side > 0, LaneAction.change_lane_left, LaneAction.change_lane_right)
    changes = (motion.side != 0) & motion.action_mask[np.arange(len(change)), change]
    reached = np.where(actions == LaneAction.slow_down, slowed, kept)
    return np.where(changes, change, actions), _residual(motion, np.where(changes, kept, reached))


def _within(kind: ActionSpaceType, actions: Floats) -> Floats:
    space: Any = action_format(kind).space()
    return np.clip(actions, space.low, space.high)


def _residual(motion: Motion, after: Floats) -> Floats:
    """Return how far a steady change of speed ends from where a vehicle was [m]."""
    return np.abs(0.5 * (motion.speed[0] + np.maximum(after, 0.0)) * motion.time - motion.distance)


INVERSES: dict[str, Inverse] = {
    ActionSpaceType.Direct.name: _direct,
    ActionSpaceType.AlongPath.name: _along_path,
    ActionSpaceType.LaneWithContinuousSpeed.name: _lane_and_speed,
    ActionSpaceType.Lane.name: _lane,
}
"""Name of each action type whose controller has an inverse -> the inverse."""
