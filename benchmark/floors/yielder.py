"""Gives way to whomever it might meet: proof that a scenario can be won with what agents see and do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smarts.env.adapters.benchmark import FRAMES
from smarts.env.adapters.features import (
    FEATURES,
    GOAL,
    GOAL_SCALE,
    HEADINGS,
    NEIGHBOUR_VALUES,
    NEIGHBOURHOOD,
    RADIUS,
    SPEED,
    SPEED_SCALE,
    WAYPOINTS,
)
from smarts.types.actions import LaneAction
from smarts.types.episode import EpisodeStart

Floats = NDArray[np.float64]

HORIZON = 5.0
"""How far ahead others are followed [s]."""
TIMES = np.arange(0.25, HORIZON + 0.01, 0.25)
"""[s]"""
SPEEDING_UP = 2.5
"""[m/s^2]"""
BRAKING = 2.5
"""Of slow_down [m/s^2]."""
MOST_SPEED = 13.0
"""[m/s]"""
JUNCTION_SPEED = 6.0
"""Near junctions [m/s]."""
LENGTH, WIDTH = 5.0, 1.8
"""Of every vehicle, for want of better knowledge [m]."""
LANE = 3.2
"""[m]"""


class Yielder:
    """Slows down when going on would bring it near the predicted place of another, and goes on otherwise.

    It changes lanes when its goal lies to the side of a straight road and the lane there is free.
    """

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Forget the last episode."""
        self._waited = 0

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return a legal action."""
        now = observation[(FRAMES - 1) * FEATURES : FRAMES * FEATURES].astype(np.float64)
        speed = now[SPEED] * SPEED_SCALE
        others = _others(now, speed)
        path = _path(now[HEADINGS : HEADINGS + WAYPOINTS])
        arrival = float(observation[-1])
        change = self._lane_change(now, others, speed, mask)
        if change is not None:
            return change
        going = _clearance(path, _driven(speed, SPEEDING_UP), others)
        slowing = _clearance(path, _driven(speed, -BRAKING), others)
        self._waited = self._waited + 1 if speed < 0.5 else 0
        needed = 0.6 + 0.15 * max(arrival, 0.0)
        if self._waited > 30:
            needed = 0.3
        if arrival >= 0.0 and speed > JUNCTION_SPEED:
            return LaneAction.slow_down
        return LaneAction.slow_down if going < needed and slowing >= going else LaneAction.keep_lane

    def _lane_change(self, now: Floats, others: Floats, speed: float, mask: NDArray[np.bool_]) -> int | None:
        """Return a lane change towards the goal if it is due, legal and safe."""
        ahead, aside = now[GOAL : GOAL + 2] * GOAL_SCALE
        headings = np.abs(now[HEADINGS : HEADINGS + WAYPOINTS])
        if headings.max() > 0.08 or ahead < 0.0 or not 0.6 * LANE < abs(aside) < 5 * LANE:
            return None
        action = LaneAction.change_lane_left if aside > 0 else LaneAction.change_lane_right
        if not mask[action]:
            return None
        side = 1.0 if aside > 0 else -1.0
        for x, y, vx, _ in others:
            if not 0.4 * LANE < side * y < 1.6 * LANE:
                continue
            closing = speed - vx if x > 0 else vx - speed
            if abs(x) < LENGTH + 2.0 + max(0.0, closing) * 2.0:
                return None
        return action


def _others(now: Floats, speed: float) -> Floats:
    """Return place and velocity of each neighbour as seen from the vehicle: x, y [m], vx, vy [m/s]."""
    rows = now[NEIGHBOURHOOD:FEATURES].reshape(-1, NEIGHBOUR_VALUES)
    rows = rows[rows[:, 0] > 0.0]
    return np.column_stack(
        [rows[:, 1:3] * RADIUS, rows[:, 3] * SPEED_SCALE + speed, rows[:, 4] * SPEED_SCALE]
    )


def _path(errors: Floats) -> Floats:
    """Return the points ahead, one a metre, as seen from the vehicle [m]; straight on behind the last."""
    angles = np.arcsin(errors)
    angles = np.concatenate([angles, np.full(60, angles[-1])])
    steps = np.column_stack([np.cos(angles), np.sin(angles)])
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _driven(speed: float, acceleration: float) -> Floats:
    """Return how far the vehicle has come at each of `TIMES` [m]."""
    if acceleration < 0.0:
        moving = np.minimum(TIMES, speed / -acceleration)
        return speed * moving + 0.5 * acceleration * moving**2
    faster = np.minimum(TIMES, max(0.0, MOST_SPEED - speed) / acceleration)
    top = max(speed, MOST_SPEED) if speed > MOST_SPEED else speed + acceleration * faster
    return speed * faster + 0.5 * acceleration * faster**2 + top * (TIMES - faster)


def _clearance(path: Floats, driven: Floats, others: Floats) -> float:
    """Return the least distance to anybody on the way, between outlines [m]."""
    if not len(others):
        return np.inf
    places = np.minimum(driven, len(path) - 2.0)
    first = places.astype(int)
    share = (places - first)[:, None]
    own = path[first] + share * (path[first + 1] - path[first])
    ways = path[first + 1] - path[first]
    least = np.inf
    for x, y, vx, vy in others:
        there = np.column_stack([x + vx * TIMES, y + vy * TIMES])
        gap = there - own
        along = np.abs((gap * ways).sum(axis=1)) - LENGTH
        across = np.abs(gap[:, 0] * ways[:, 1] - gap[:, 1] * ways[:, 0]) - WIDTH
        moving = abs(vx) + abs(vy) > 0.5
        if moving:
            # Who crosses is long where we are wide.
            turned = abs(ways[:, 0] * vy - ways[:, 1] * vx) / max(np.hypot(vx, vy), 0.1)
            across -= turned * (LENGTH - WIDTH) / 2
        least = min(least, float(np.min(np.maximum(along, across))))
    return least
