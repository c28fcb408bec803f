"""The drive of a vehicle of SUMO: car following by Krauss, lane changes at a steady lateral speed."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats
from smarts.geometry.binding import bind
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped
from smarts.planners.paths import resample
from smarts.planners.protocol import Limits, Neighbours, Plans, keep_last

STEP = 0.1
"""SUMO's step [s]."""
STEPS = 60
"""Number of steps of a plan."""
EACH = 3
"""Steps from row to row of a path."""
LANE = 3.2
"""Width of a lane of SUMO's [m]."""
MOST_TURN = math.radians(30.0)
"""A state that is turned farther against the target is not in a lane beside it [rad]."""
BEGUN = 0.5
"""Share of the lateral speed from which on a lane change has begun."""
NOWHERE = 0.05
"""Offset of a vehicle that is in the target's lane [m]."""
EMERGENCY_SHARE = 1.2
"""Braking harder than `decel` is by this share more than needed."""
_TINY = 1e-3
"""SUMO's NUMERICAL_EPS."""


class CarFollowing(NamedTuple):
    """Parameters of Krauss' model under SUMO's names; the defaults are a passenger car's."""

    tau: float = 1.0
    """Time gap to the leader [s]."""
    min_gap: float = 2.5
    """Gap to a standing leader [m]."""
    accel: float = 2.6
    """Largest acceleration [m/s^2]."""
    decel: float = 4.5
    """Largest deceleration [m/s^2], also of the leaders."""
    emergency_decel: float = 9.0
    """The hardest braking if the gap asks for more than `decel` [m/s^2]."""


class SumoPlanner:
    """Plans what a vehicle of SUMO would drive, without its driver's imperfection (`sigma` 0), for 6 s.

    The lanes are straight and run along the target's heading; the target is in the middle of one of them. The
    vehicle accelerates to the target's speed, as its desired one, behind the leaders in its lane and, while
    it changes lanes, in the target's. A change crosses a lane of 3.2 m in `duration`, as with SUMO's option
    `lanechange.duration`; it waits until the gaps ahead and behind in the target's lane are those that SUMO
    calls secure. A vehicle that already moves to the side continues. The arrival time follows from all
    this: the target's time, and its place along the lane, count for nothing. Planning fails for a vehicle
    that is turned against the target by more than 30 degrees.

    Args:
        limits: The vehicle; of them, only the size and the largest speed count.
        model: The car-following model.
        duration: Duration of a lane change [s].

    After Krauss, "Microscopic modeling of traffic flow", DLR 1998, as in SUMO's `MSCFModel`, with its Euler
    steps of 0.1 s; and `MSAbstractLaneChangeModel`.
    """

    def __init__(
        self, limits: Limits | None = None, model: CarFollowing | None = None, duration: float = 3.0
    ) -> None:
        self._limits = limits or Limits()
        size = np.array([self._limits.length, self._limits.width])
        self._drive = bind(drive, model or CarFollowing(), size, float(duration))

    def plan(
        self,
        states: Floats,
        targets: Floats,
        neighbours: Neighbours | None = None,
        last: Floats | None = None,
        elapsed: float | Floats = 0.0,
    ) -> Plans:
        """Plan a path for each vehicle; see `Planner`."""
        around, limits = neighbours or Neighbours.none(len(states)), self._limits
        paths = np.full((len(states), STEPS // EACH + 1, 5), np.nan)
        times = STEP * np.arange(STEPS + 1)
        for n in range(len(states)):
            seen = np.isfinite(around.path[n]).all(axis=(1, 2)) & np.isfinite(around.size[n]).all(axis=1)
            others = resample(around.path[n, seen], np.tile(times, (seen.sum(), 1)))
            target = targets[n].copy()
            target[4] = min(target[4], limits.speed)
            self._drive(states[n], target, others, around.size[n, seen], paths[n])
        failed = np.asarray(~np.isfinite(paths).all(axis=(1, 2)))
        return keep_last(paths, failed, last, np.broadcast_to(np.asarray(elapsed, float), len(states)))


@kernel
def drive(
    model: CarFollowing,
    size: Floats,
    duration: float,
    state: Floats,
    target: Floats,
    others: Floats,
    sizes: Floats,
    path: Floats,
) -> None:
    """Write the path of one vehicle; nothing if it is in no lane along the target.

    Args:
        model: The car-following model.
        size: The vehicle's length and width, shape (2,).
        duration: Duration of a lane change [s].
        state: x, y, heading, speed, shape (4 or more,).
        target: Time, x, y, heading, speed, shape (5,).
        others: The neighbours' poses at each step, as of paths, shape (K, STEPS + 1, 5).
        sizes: Their lengths and widths, shape (K, 2).
        path: Written, shape (STEPS / EACH + 1, 5).
    """
    cosine, sine = math.cos(target[3]), math.sin(target[3])
    turn, half = wrapped(state[2] - target[3]), 0.5 * size[0]
    dx, dy = state[0] - target[1], state[1] - target[2]
    # Of the middle of the front bumper, which SUMO moves.
    station = dx * cosine + dy * sine + half * math.cos(turn)
    offset = dy * cosine - dx * sine + half * math.sin(turn)
    speed, lateral = max(state[3], 0.0), LANE / duration
    # False for NaN, too.
    if not abs(turn) <= MOST_TURN or not math.isfinite(station + speed + target[4]):
        return
    is_begun = -math.copysign(speed * math.sin(turn), turn * offset) > BEGUN * lateral
    for i in range(STEPS + 1):
        if i % EACH == 0:
            row = path[i // EACH]
            ahead, aside = station - half * math.cos(turn), offset - half * math.sin(turn)
            row[0], row[3], row[4] = i * STEP, wrapped(target[3] + turn), speed
            row[1] = target[1] + ahead * cosine - aside * sine
            row[2] = target[2] + ahead * sine + aside * cosine
        if not is_begun and abs(offset) > NOWHERE:
            is_begun = is_secure(station - half, speed, target, others[:, i], sizes, size, model)
        goal = 0.0 if is_begun else offset
        found = min(speed + STEP * model.accel, max(target[4], speed - STEP * model.decel))
        for k in range(len(others)):
            ahead, aside, length, width, along = in_lane(station - half, target, others[k, i], sizes[k])
            reach = width + 0.5 * size[1]
            if ahead > 0.0 and min(offset, goal) - reach < aside < max(offset, goal) + reach:
                found = min(found, follow_speed(ahead - length - half - model.min_gap, speed, along, model))
        speed = max(found, 0.0)
        way = min(lateral * STEP, abs(offset)) if is_begun and speed > 0.0 else 0.0
        way = -math.copysign(way, offset)
        # The rear is drawn after the front.
        turn = math.atan2(size[0] * math.sin(turn) + way, size[0] * math.cos(turn) + speed * STEP)
        offset, station = offset + way, station + speed * STEP


@kernel
def in_lane(
    place: float, target: Floats, other: Floats, size: Floats
) -> tuple[float, float, float, float, float]:
    """Return a vehicle's place in the frame of the target's lane, half of its extents, and its speed there.

    These are the way from `place` and the offset to the left [m], half of the extents along and across the
    lane [m], and the speed along it, at least 0 [m/s].

    Args:
        place: Station relative to the target [m].
        target: Time, x, y, heading, speed.
        other: The vehicle's pose, as of paths, shape (5,).
        size: Its length and width.
    """
    cosine, sine = math.cos(target[3]), math.sin(target[3])
    dx, dy, turn = other[1] - target[1], other[2] - target[2], other[3] - target[3]
    along, across = 0.5 * abs(math.cos(turn)), 0.5 * abs(math.sin(turn))
    length, width = along * size[0] + across * size[1], across * size[0] + along * size[1]
    speed = max(other[4] * math.cos(turn), 0.0)
    return dx * cosine + dy * sine - place, dy * cosine - dx * sine, length, width, speed


@kernel
def is_secure(
    place: float,
    speed: float,
    target: Floats,
    others: Floats,
    sizes: Floats,
    own: Floats,
    model: CarFollowing,
) -> bool:
    """Return whether the gaps in the target's lane are secure for a lane change (`MSCFModel::getSecureGap`).

    Args:
        place: Station of the vehicle relative to the target [m].
        speed: Speed of the vehicle [m/s].
        target: Time, x, y, heading, speed.
        others: Poses of the neighbours now, as of paths, shape (K, 5).
        sizes: Their lengths and widths, shape (K, 2).
        own: The vehicle's.
        model: Model of all drivers.
    """
    for k in range(len(others)):
        ahead, aside, length, _, its = in_lane(place, target, others[k], sizes[k])
        if abs(aside) > 0.5 * LANE:
            continue
        gap = abs(ahead) - length - 0.5 * own[0] - model.min_gap
        front, rear = (its, speed) if ahead > 0.0 else (speed, its)
        needed = brake_gap(rear, model.decel, model.tau) - brake_gap(front, model.decel, 0.0)
        if gap < max(needed, 0.0):
            return False
    return True


@kernel
def follow_speed(gap: float, speed: float, leader_speed: float, model: CarFollowing) -> float:
    """Return the largest speed in the next step from which the vehicle can stop behind its leader [m/s].

    Args:
        gap: To the leader, less the least gap [m].
        speed: Speed of the vehicle [m/s].
        leader_speed: [m/s]
        model: The car-following model.
    """
    hardest = max(speed - STEP * model.emergency_decel, 0.0)
    if gap <= 0.0:
        return hardest
    safe = stop_speed(gap + brake_gap(leader_speed, model.decel, 0.0), model.decel, model.tau)
    asked = (speed - safe) / STEP
    if asked <= model.decel:
        return safe
    # The time gap alone would ask for more than is needed to stop in time (`calculateEmergencyDeceleration`).
    needed = 0.5 * speed * speed / (gap + 0.5 * leader_speed * leader_speed / model.decel)
    if needed > model.decel:
        needed = 0.5 * (speed * speed - leader_speed * leader_speed) / gap
    return max(speed - STEP * min(max(EMERGENCY_SHARE * needed, model.decel), asked), hardest)


@kernel
def stop_speed(gap: float, decel: float, tau: float) -> float:
    """Return the largest speed in the next step from which a vehicle can stop within a gap.

    It drives at that speed for `tau`, then brakes by `decel` in each step (`maximumSafeStopSpeedEuler`).
    """
    room = gap - _TINY
    if room < 0.0:
        return 0.0
    loss = decel * STEP
    root = math.sqrt(STEP * STEP + 4.0 * (STEP * (2.0 * room / loss - tau) + tau * tau))
    steps = math.floor(0.5 - (tau - 0.5 * root) / STEP)
    way = 0.5 * steps * (steps - 1.0) * loss * STEP + steps * loss * tau
    return steps * loss + (room - way) / (steps * STEP + tau)


@kernel
def brake_gap(speed: float, decel: float, tau: float) -> float:
    """Return the way on which a vehicle stops, after it has driven on for `tau` (`brakeGapEuler`) [m]."""
    loss = decel * STEP
    steps = math.floor(speed / loss)
    return STEP * (steps * speed - loss * steps * (steps + 1.0) / 2.0) + speed * tau
