"""The agent `u-turn-v0`."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.agents.checks import check_number
from smarts.agents.interface import AgentInterface
from smarts.agents.policy import ActionBatch
from smarts.arrays import Bools, Floats, Ints
from smarts.observations.surroundings import Own
from smarts.observations.u_turn import LANE_WAY, LATERAL, POINTS, TURN_STATE, TURN_WAY
from smarts.types.actions import ActionSpaceType
from smarts.zoo.driving import DRIVER, STEP, Driver, Memory, Seen, target_speed

BEFORE, TURNING, OVER = 0.0, 1.0, 2.0
"""Phases."""
TOLERANCE = 0.5
"""The turn begins at this speed above that of the turn, at most [m/s]."""
DONE_HEADING = 0.9
"""Cosine of the angle to the last heading, from which on the turn is over."""
CLEAR = 15.0
"""Least gap to an oncoming vehicle [m]..."""
CLEAR_TIME = 6.0
"""...and the time that it takes to come, at least [s]."""


class UTurn(Driver):
    """Turns round into the other direction where the road is wide enough, then drives by IDM.

    Args:
        after: How long it drives before it looks for a place [s].
        speed_factor: Desired speed, in speed limits.

    Raises:
        InterfaceError: An argument is not a number, or out of its range.
    """

    interface: ClassVar[AgentInterface] = DRIVER.replace(action=ActionSpaceType.Trajectory)
    observation: ClassVar[Any] = ["surroundings", "u_turn"]

    def __init__(self, after: float = 0.0, speed_factor: float = 1.0) -> None:
        super().__init__(speed_factor=speed_factor)
        check_number("after", after, most=1e6, place="UTurn")
        self._after = float(after)
        # Phase, step of entry, and the way round.
        self._memory = Memory(2 + 3 * POINTS)

    def act(self, obs: ActionBatch) -> NDArray:
        """Return paths of x, y, heading, speed, shape (N, 4, P)."""
        seen, memory = Seen.of(obs), self._memory.of(obs)
        is_new = self._memory.is_new(obs)
        memory[is_new, 1] = obs.step[is_new]
        phase, kept = memory[:, 0], memory[:, 2:].reshape(-1, POINTS, 3)
        pace, gap, its_speed = obs.observations[TURN_STATE].T
        may_turn = (phase == BEFORE) & (pace > 0.0) & (obs.step - memory[:, 1] >= self._after / STEP)
        is_clear = (gap > CLEAR) & (gap > CLEAR_TIME * its_speed)
        begins = may_turn & is_clear & (seen.speed <= pace + TOLERANCE)
        kept[begins], phase[begins] = obs.observations[TURN_WAY][begins], TURNING
        phase[(phase == TURNING) & self._is_round(seen, kept)] = OVER
        turns = phase == TURNING
        self._memory.keep(obs, memory)
        speed = self._speed(seen, may_turn & ~begins, is_clear, pace)
        speed = np.where(turns, _speed_in_turn(kept), speed)
        way = np.where(turns[:, None, None], kept, obs.observations[LANE_WAY])
        paths = np.empty((len(speed), 4, POINTS))
        paths[:, :3] = way.transpose(0, 2, 1)
        paths[:, 3] = speed[:, None]
        return paths

    def decide(self, batch: ActionBatch, seen: Seen) -> tuple[Floats, Ints]:
        """Return accelerations along the lane, and no lane changes; see `Driver`."""
        return self.follow(seen, keeps_to_route=False), np.zeros(len(seen.own), np.int32)

    def _speed(self, seen: Seen, waits: Bools, is_clear: Bools, pace: Floats) -> Floats:
        """Return target speeds along the lane; those that are about to turn slow down, or stop for others."""
        found = self.follow(seen, keeps_to_route=False)
        slowing = np.where(is_clear, pace - seen.speed, -seen.speed)
        found = np.where(waits, np.minimum(found, np.maximum(slowing, -self.model.decel)), found)
        return target_speed(seen.speed, found)

    def _is_round(self, seen: Seen, kept: Floats) -> Bools:
        return np.cos(kept[:, -1, 2] - seen.own[:, Own.HEADING]) > DONE_HEADING


def _speed_in_turn(ways: Floats) -> Floats:
    """Return speeds at which the sharpest bends of ways take `LATERAL`, shape (N,)."""
    chords = np.hypot(np.diff(ways[..., 0], axis=1), np.diff(ways[..., 1], axis=1))
    turned = np.diff(ways[..., 2], axis=1)
    turned = np.abs(np.arctan2(np.sin(turned), np.cos(turned)))
    return np.sqrt(LATERAL / np.maximum((turned / np.maximum(chords, 0.1)).max(axis=1), 1e-3))
