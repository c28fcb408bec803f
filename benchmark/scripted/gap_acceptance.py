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
    expanded,
)
from smarts.env.adapters.situation import ARRIVAL, SITUATION
from smarts.types.actions import LaneAction
from smarts.types.episode import EpisodeStart

Floats = NDArray[np.float64]

HORIZON = 5.0
"""How far ahead those are followed who go first [s]."""
SHORT_HORIZON = 2.5
"""How far ahead those are followed who should give way [s]."""
TIMES = np.arange(0.0, HORIZON + 0.01, 0.25)
"""[s]"""
SPEEDING_UP = 2.5
"""[m/s^2]"""
BRAKING = 2.5
"""Of slow_down [m/s^2]."""
MOST_SPEED = 13.0
"""[m/s]"""
JUNCTION_SPEED = 6.0
"""Near junctions, and where a lane change is due [m/s]."""
LOWEST_SPEED = 2.0
"""While waiting for a gap in the lane to the side [m/s]."""
LENGTH = 5.0
"""Of every vehicle, for want of better knowledge [m]."""
DISC = 1.1
"""Radius of the discs that stand for a vehicle [m]."""
DISC_PLACES = np.array([-1.7, 0.0, 1.7])
"""Of their centres along it [m]."""
SAFE = 0.6
"""Distance to keep from others [m]."""
SAFE_STANDING = 0.3
"""Distance to keep from those who stand, once one has waited for long [m]."""
SLACK = 0.15
"""By which somebody must come nearer than now to count, so that one can pass those beside one [m]."""
LANE = 3.2
"""[m]"""
OVERDUE = 80.0
"""Distance to the goal within which a lane change is due [m]."""
OTHERS_SPEEDING_UP = 2.0
"""Of those who may be about to go first [m/s^2]."""
OTHERS_SPEED = 7.0
"""Up to which they do [m/s]."""
URGENT = 30.0
"""Distance to the goal within which smaller gaps will do [m]."""
LAST_PLACE = 12.0
"""Distance to the goal at which to stop and wait for a gap [m]."""
PATIENCE = 10
"""Decisions at rest after which who came first claims the right of way."""


class GapAcceptancePolicy:
    """Slows down when going on would bring it near the predicted place of another, and goes on otherwise.

    The right of way: oncoming traffic goes before who turns left, the right before the left; others still
    have to be avoided if they come too near. It changes lanes when its goal lies to the side of a straight
    road and the lane there is free.
    """

    def begin(self, episode: EpisodeStart, agent: int) -> None:
        """Forget the last episode."""
        self._waited = 0

    def act(self, observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> int:
        """Return a legal action."""
        now = observation[(FRAMES - 1) * FEATURES : FRAMES * FEATURES].astype(np.float64)
        speed, arrival = now[SPEED] * SPEED_SCALE, float(observation[ARRIVAL])
        self._waited = self._waited + 1 if speed < 0.5 else 0
        others = _others(now, speed)
        wish = _wish(now)
        errors = now[HEADINGS : HEADINGS + WAYPOINTS]
        path = _path(errors)
        is_first = arrival <= 0.0
        claims = self._waited > (PATIENCE if is_first else 3 * PATIENCE)
        horizons = _horizons(others, turns_left=errors.max() > 0.3, yields=not is_first, claims=claims)
        ways = _ways(others, may_speed_up=not is_first and not claims)
        driven = _driven(speed, SPEEDING_UP)
        ahead = float(expanded(now[GOAL], GOAL_SCALE))
        is_urgent = ahead < URGENT
        # Who stops between two lanes, before a junction, is run into from behind.
        may_change = wish is not None and mask[wish] and (arrival < 0.0 or is_urgent)
        if wish is not None and may_change and _is_free(others, speed, wish, is_urgent):
            crosses = ~_goes_along(others)
            if _time_to_conflict(path, driven, ways[crosses], horizons[crosses]) == np.inf:
                return wish
        if speed > JUNCTION_SPEED and arrival >= 0.0:
            return LaneAction.slow_down
        if wish is not None and mask[wish] and ahead < OVERDUE:
            is_even = int(np.argmax(observation[FRAMES * FEATURES : -SITUATION])) % 2 == 0
            in_time = np.sqrt(2 * BRAKING * max(0.0, ahead - LAST_PLACE))
            if speed > min(_speed_to_let_by(others, wish, is_even), in_time):
                return LaneAction.slow_down
        safe = SAFE_STANDING if claims else SAFE
        going = _time_to_conflict(path, driven, ways, horizons, safe)
        slowing = _time_to_conflict(path, _driven(speed, -BRAKING), ways, horizons, safe)
        is_better = going == np.inf or going > slowing
        return LaneAction.keep_lane if is_better else LaneAction.slow_down


def _wish(now: Floats) -> int | None:
    """Return the lane change that leads towards the goal on a straight road, if any does."""
    ahead, aside = expanded(now[GOAL : GOAL + 2], GOAL_SCALE)
    is_straight = np.abs(now[HEADINGS : HEADINGS + WAYPOINTS]).max() < 0.08
    if not is_straight or ahead < 0.0 or not 0.6 * LANE < abs(aside) < 5 * LANE:
        return None
    return LaneAction.change_lane_left if aside > 0 else LaneAction.change_lane_right


def _speed_to_let_by(others: Floats, change: int, is_even: bool) -> float:
    """Return how fast to go, at most, so that a gap opens in the lane to the side [m/s].

    Of two who want each other's lane, the one behind falls back; of two who are level, the odd one.
    """
    side = 1.0 if change == LaneAction.change_lane_left else -1.0
    beside = others[(side * others[:, 1] > 0.4 * LANE) & (side * others[:, 1] < 2.4 * LANE)]
    if not len(beside):
        return JUNCTION_SPEED
    x = beside[np.argmin(np.abs(beside[:, 0])), 0]
    falls_back = x > 1.0 or (x > -1.0 and not is_even)
    return LOWEST_SPEED if falls_back else JUNCTION_SPEED


def _is_free(others: Floats, speed: float, change: int, is_urgent: bool) -> bool:
    """Return whether nobody is near, or soon will be, in the lane to the side.

    Where it is urgent, others are trusted to brake.
    """
    side = 1.0 if change == LaneAction.change_lane_left else -1.0
    for x, y, vx, _ in others:
        if not 0.4 * LANE < side * y < 2.4 * LANE:
            continue
        closing = speed - vx if x > 0 else vx - speed
        if abs(x) < LENGTH + 2.0 + max(0.0, closing) * (1.0 if is_urgent else 2.0):
            return False
    return True


def _others(now: Floats, speed: float) -> Floats:
    """Return place and velocity of each neighbour as seen from the vehicle: x, y [m], vx, vy [m/s]."""
    rows = now[NEIGHBOURHOOD:FEATURES].reshape(-1, NEIGHBOUR_VALUES)
    rows = rows[rows[:, 0] > 0.0]
    velocities = expanded(rows[:, 3:5], SPEED_SCALE)
    velocities[:, 0] += speed
    return np.column_stack([expanded(rows[:, 1:3], RADIUS), velocities])


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
    return speed * TIMES + acceleration * (0.5 * faster**2 + faster * (TIMES - faster))


def _goes_along(others: Floats) -> NDArray[np.bool_]:
    """Return who drives the same way, or stands."""
    vx, vy = others[:, 2], others[:, 3]
    return (np.abs(vy) < 0.5 * np.abs(vx)) & (vx > 0.0) | (np.hypot(vx, vy) < 0.5)


def _horizons(others: Floats, *, turns_left: bool, yields: bool, claims: bool) -> Floats:
    """Return how far ahead each of the others is followed [s]."""
    vx, vy = others[:, 2], others[:, 3]
    is_ahead = _goes_along(others)
    is_oncoming = (vx < 0.0) & (np.abs(vy) < -vx)
    from_the_right = ~is_ahead & ~is_oncoming & (vy > 0.0)
    goes_first = is_ahead | (is_oncoming & turns_left) | from_the_right | yields
    return np.where(goes_first & ~(claims & ~is_ahead), HORIZON, SHORT_HORIZON)


def _ways(others: Floats, *, may_speed_up: bool) -> Floats:
    """Return where the others may be at each of `TIMES` as seen from the vehicle, shape (K, 2, T, 2) [m].

    There are two ways for each: on at its speed, and, for those who cross, speeding up if they may.
    """
    speed = np.hypot(others[:, 2], others[:, 3])
    gain = np.where(may_speed_up & ~_goes_along(others), OTHERS_SPEEDING_UP, 0.0)
    time = np.minimum(TIMES, (np.maximum(0.0, OTHERS_SPEED - speed) / OTHERS_SPEEDING_UP)[:, None])
    more = gain[:, None] * (0.5 * time**2 + time * (TIMES - time)) / np.maximum(speed, 0.1)[:, None]
    factors = np.stack([np.broadcast_to(TIMES, more.shape), TIMES + more], axis=1)
    return others[:, None, None, :2] + factors[..., None] * others[:, None, None, 2:]


def _time_to_conflict(
    path: Floats, driven: Floats, ways: Floats, horizons: Floats, from_standing: float = SAFE
) -> float:
    """Return when somebody comes too near first, infinity if nobody does [s].

    A vehicle is taken for three discs in a row along its way. How those who stand are turned is not known:
    they are taken to stand along the nearest part of one's own path.
    """
    places = np.clip(driven, 0.0, len(path) - 2.0)
    first = places.astype(int)
    tangents = np.diff(path, axis=0)
    own = _discs(path[first] + (places - first)[:, None] * tangents[first], tangents[first])
    soonest = np.inf
    for both, horizon in zip(ways, horizons, strict=True):
        for there in both:
            way = there[1] - there[0]
            length = np.hypot(way[0], way[1])
            stands = length < 0.5 * TIMES[1]
            way = tangents[np.argmin(np.hypot(*(path[:-1] - there[0]).T))] if stands else way / length
            gaps = own[:, :, None] - _discs(there, np.broadcast_to(way, there.shape))[:, None]
            distance = np.hypot(gaps[..., 0], gaps[..., 1]).min(axis=(1, 2))
            # Who is too near already must not come nearer; going past or away is allowed.
            kept = 2 * DISC + (from_standing if stands else SAFE)
            near = (distance < min(kept, distance[0] - SLACK)) & (horizon >= TIMES)
            if near.any():
                soonest = min(soonest, float(TIMES[np.argmax(near)]))
    return soonest


def _discs(centres: Floats, ways: Floats) -> Floats:
    """Return the centres of a vehicle's discs at each time, shape (T, 3, 2)."""
    return centres[:, None] + DISC_PLACES[:, None] * ways[:, None]
