"""The agent `u-turn-v0`."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.agents.policy import ActionBatch
from smarts.arrays import Bools, Floats, Ints
from smarts.controllers.action_formats import PATH_POINTS
from smarts.observations.lane_ways import LANE_WAYS
from smarts.observations.surroundings import OWN, Own
from smarts.observations.u_turn import LATERAL, POINTS, SHARPEST, TURN_LANE, TURN_STATE
from smarts.planners import Limits, PlanStatus, resample
from smarts.types.actions import ActionSpaceType
from smarts.zoo.driving import DRIVER, STEP, Driver, Memory, Seen, target_speed
from smarts.zoo.planned import agilities, lane_paths, plan_paths, planner_named

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
FARTHEST = 1.0
"""Distance of a path's end from the pose in the other direction, at most [m]."""
LIMITS = Limits(lateral=LATERAL).turning(SHARPEST)
"""What the turn may ask of the vehicle."""


class UTurn(Driver):
    """Turns round into the other direction where the road is wide enough, then drives by IDM.

    Args:
        after: How long it drives before it looks for a place [s].
        speed_factor: Desired speed, in speed limits.
        planner: Planner of the turn, which is planned once, without neighbours: it begins when none is near.
            A name such as "bezier", or a "module:Class".

    Raises:
        SmartsError: There is no such planner.
    """

    interface: ClassVar[AgentInterface] = DRIVER.replace(action=ActionSpaceType.Trajectory)
    observation: ClassVar[Any] = ["surroundings", LANE_WAYS, "u_turn"]

    def __init__(self, after: float = 0.0, speed_factor: float = 1.0, planner: str = "bezier") -> None:
        super().__init__(speed_factor=speed_factor)
        self._after = float(after)
        self._planner = planner_named(planner, LIMITS)
        # Phase, step of entry, and the path round.
        self._memory = Memory(2 + 4 * PATH_POINTS)

    def act(self, obs: ActionBatch) -> NDArray:
        """Return paths of x, y, heading, speed, shape (N, 4, P)."""
        seen, memory = Seen.of(obs), self._memory.of(obs)
        is_new = self._memory.is_new(obs)
        memory[is_new, 1] = obs.step[is_new]
        phase, kept = memory[:, 0], memory[:, 2:].reshape(-1, 4, PATH_POINTS)
        pace, gap, its_speed = obs.observations[TURN_STATE].T
        may_turn = (phase == BEFORE) & (pace > 0.0) & (obs.step - memory[:, 1] >= self._after / STEP)
        is_clear = (gap > CLEAR) & (gap > CLEAR_TIME * its_speed)
        begins = may_turn & is_clear & (seen.speed <= pace + TOLERANCE)
        self._plan(begins, seen, obs.observations[TURN_LANE], pace, kept, phase)
        phase[(phase == TURNING) & (np.cos(kept[:, 2, -1] - seen.own[:, Own.HEADING]) > DONE_HEADING)] = OVER
        self._memory.keep(obs, memory)
        speed = self._speed(seen, may_turn & (phase == BEFORE), is_clear, pace)
        paths = lane_paths(obs.observations[LANE_WAYS][:, OWN], speed, agilities(seen.own[:, Own.LENGTH]))
        return np.where((phase == TURNING)[:, None, None], kept, paths)

    def decide(self, batch: ActionBatch, seen: Seen) -> tuple[Floats, Ints]:
        """Return accelerations along the lane, and no lane changes; see `Driver`."""
        return self.follow(seen, keeps_to_route=False), np.zeros(len(seen.own), np.int32)

    def _plan(
        self, begins: Bools, seen: Seen, lanes: Floats, pace: Floats, kept: Floats, phase: Floats
    ) -> None:
        """Plan half circles of some vehicles; vehicles without a plan stay in their lanes."""
        rows = np.flatnonzero(begins)
        if not len(rows):
            return
        own, lane = seen.own[rows], lanes[rows]
        states = np.column_stack([own[:, [Own.X, Own.Y, Own.HEADING, Own.SPEED]], np.zeros(len(rows))])
        targets = np.zeros((len(rows), 5))
        targets[:, 1:4], targets[:, 4] = lane[:, 0], pace[rows]
        targets[:, 0] = 0.5 * np.pi * np.hypot(*(targets[:, 1:3] - states[:, :2]).T) / pace[rows]
        plans = self._planner.plan(states, targets)
        # The path ends up to `FARTHEST` from the lane's first point, so the lane goes on with its second.
        times = plans.path[:, -1:, 0] * np.linspace(0.0, 1.0, PATH_POINTS - POINTS + 1)
        turns = plan_paths(resample(plans.path, times))
        turns[:, :3, -POINTS + 1 :] = lane[:, 1:].transpose(0, 2, 1)
        missed = np.hypot(*(plans.path[:, -1, 1:3] - targets[:, 1:3]).T)
        is_planned = (plans.status == PlanStatus.PLANNED) & (missed < FARTHEST)
        kept[rows[is_planned]], phase[rows[is_planned]] = turns[is_planned], TURNING

    def _speed(self, seen: Seen, waits: Bools, is_clear: Bools, pace: Floats) -> Floats:
        """Return target speeds along the lane; those that are about to turn slow down, or stop for others."""
        found = self.follow(seen, keeps_to_route=False)
        slowing = np.where(is_clear, pace - seen.speed, -seen.speed)
        found = np.where(waits, np.minimum(found, np.maximum(slowing, -self.model.decel)), found)
        return target_speed(seen.speed, found)
