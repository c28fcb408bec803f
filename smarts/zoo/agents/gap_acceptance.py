"""The agent `gap-acceptance-v0`: solves scenarios with the benchmark's observation and lane actions."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from smarts.agents.benchmark import benchmark_interface
from smarts.agents.interface import AgentInterface
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.dynamics.car_following import braked_way
from smarts.observations.arrays import VECTOR
from smarts.observations.lists import feature_list
from smarts.observations.neighbors import NEIGHBOR_VALUES
from smarts.observations.scales import GOAL_SCALE, RADIUS, SPEED_SCALE, expanded
from smarts.types.actions import LaneAction
from smarts.zoo.driving import DRIVER, STEP, Memory

Floats = NDArray[np.float64]

_FEATURES = feature_list("benchmark")
_SIZE_WITHOUT_INDEX = max(place.stop for place in _FEATURES.layout(0).values())
"""Size of the benchmark's observation without the numbers that say which of the agents one is."""

HORIZON = 5.0
"""Horizon of vehicles with the right of way [s]."""
SHORT_HORIZON = 2.5
"""Horizon of vehicles that should give way [s]."""
FOLLOWING_HORIZON = 8.0
"""Horizon of leaders: until the vehicle has stopped [s]."""
TIMES = np.arange(0.0, FOLLOWING_HORIZON + 0.01, 0.25)
"""[s]"""
DECISION = 0.5
"""Time between decisions [s]."""
SPEEDING_UP = 2.5
"""[m/s^2]"""
BRAKING = 2.5
"""Deceleration of slow_down [m/s^2]."""
LEADERS_BRAKING = 4.5
"""Deceleration that leaders are assumed to have, SUMO's default [m/s^2]."""
MOST_SPEED = 13.0
"""[m/s]"""
JUNCTION_SPEED = 6.0
"""Near junctions, and where a lane change is due [m/s]."""
CURVE_ACCELERATION = 2.5
"""Lateral acceleration at which curves are driven [m/s^2]."""
CURVE = 4
"""Length over which a curve is measured [m]."""
LOWEST_SPEED = 2.0
"""Lowest speed while waiting for a gap in the lane to the side [m/s]."""
LENGTH = 5.0
"""Assumed length of every vehicle [m]."""
DISC = 1.1
"""Radius of the discs that approximate a vehicle [m]."""
DISC_PLACES = np.array([-1.7, 0.0, 1.7])
"""Places of the discs' centres along the vehicle [m]."""
SAFE = 0.6
"""Distance to keep from others [m]."""
SAFE_STANDING = 0.3
"""Distance to keep from standing vehicles after a long wait [m]."""
SLACK = 0.15
"""A vehicle counts if it comes nearer than now by this, so that vehicles beside can be passed [m]."""
LANE = 3.2
"""[m]"""
OVERDUE = 80.0
"""Distance to the goal within which a lane change is due [m]."""
OTHERS_SPEEDING_UP = 2.0
"""Acceleration that vehicles which may go first are assumed to have [m/s^2]."""
OTHERS_SPEED = 7.0
"""Speed up to which they accelerate [m/s]."""
URGENT = 30.0
"""Distance to the goal within which smaller gaps are accepted [m]."""
LAST_PLACE = 22.0
"""Distance to the goal at which it stops and waits for a gap [m]."""
MAX_WAIT_DECISIONS = 10
"""Decisions at rest after which the first to arrive claims the right of way."""


class GapAcceptance(BatchAgent):
    """Slows down if it would come near the predicted place of another vehicle, else keeps going.

    Behind a leader it keeps the distance in which it can stop if the leader brakes (Gipps, 1981). Right of
    way: oncoming traffic before left turns, right before left; vehicles without it are avoided if they come
    too near. It changes lanes if the goal lies beside a straight road and that lane is free.
    """

    interface: ClassVar[AgentInterface] = benchmark_interface(
        max_episode_steps=None, vehicle_model="kinematic", done_criteria=DRIVER.done_criteria
    )
    observation: ClassVar[str] = "benchmark"
    period: ClassVar[int] = 5
    step_length: ClassVar[float] = STEP

    def __init__(self) -> None:
        self._waited = Memory(1)

    def act(self, obs: ActionBatch) -> NDArray:
        """Return allowed lane actions, shape (N,)."""
        waited, seen = self._waited.of(obs), obs.observations[VECTOR]
        actions = np.empty(len(seen), np.int64)
        for row in range(len(seen)):
            actions[row], waited[row] = choose(seen[row], obs.action_mask[row], int(waited[row, 0]))
        self._waited.keep(obs, waited)
        return actions


def choose(observation: NDArray[np.float32], mask: NDArray[np.bool_], waited: int) -> tuple[int, int]:
    """Return an allowed lane action, and for how many decisions the vehicle has stood.

    Args:
        observation: The vector "benchmark".
        mask: Allowed lane actions, shape (4,).
        waited: What was returned at the decision before, 0 at the first.
    """
    layout = layout_of(observation)
    now = {name: observation[place].astype(np.float64) for name, place in layout.items()}
    speed, arrival = float(now["speed"][0]) * SPEED_SCALE, float(now["arrival_order"][0])
    waited = (waited + 1) * bool(speed < 0.5)
    others = _others(now, speed)
    errors = now["heading_errors"]
    path = _path(errors)
    is_first = arrival <= 0.0
    claims = waited > (MAX_WAIT_DECISIONS if is_first else 3 * MAX_WAIT_DECISIONS)
    horizons = _horizons(others, turns_left=errors.max() > 0.3, yields=not is_first, claims=claims)
    ways = _ways(others, may_speed_up=not is_first and not claims)
    ahead = float(expanded(now["goal"][0], GOAL_SCALE))
    wish = _wish(now, mask)
    if wish is not None and _is_free(others, speed, wish, arrival, is_urgent=ahead < URGENT):
        crosses = ~_goes_along(others)
        if _time_to_conflict(path, _driven(speed, SPEEDING_UP), ways[crosses], horizons[crosses]) == np.inf:
            return wish, waited
    most = _most_speed(others, speed, wish, arrival, ahead, now["agent_index"])
    if speed > most:
        return LaneAction.slow_down, waited
    safe = SAFE_STANDING if claims else SAFE
    leads = _goes_along(others) & (others[:, 0] > 0.0)
    stops, until = _stopping(others[leads]), np.full(leads.sum(), FOLLOWING_HORIZON)

    def conflict(alone: Floats, behind: Floats) -> float:
        crossing = _time_to_conflict(path, alone, ways[~leads], horizons[~leads], safe)
        return min(crossing, _time_to_conflict(path, behind, stops, until, safe))

    slowed, fastest = _driven(speed, -BRAKING), min(most + SPEEDING_UP * DECISION, _curve_speed(errors))
    going = conflict(_driven(speed, SPEEDING_UP, fastest), _followed(speed))
    is_better = going == np.inf or going > conflict(slowed, slowed)
    return (LaneAction.keep_lane if is_better else LaneAction.slow_down), waited


def layout_of(observation: NDArray[np.float32]) -> dict[str, slice]:
    """Return the place of each feature in a vector "benchmark"."""
    return _layout(len(observation) - _SIZE_WITHOUT_INDEX)


@cache
def _layout(agents: int) -> dict[str, slice]:
    """Return the place of each feature in the observation of one of several agents."""
    return _FEATURES.layout(agents)


def _wish(now: Mapping[str, Floats], mask: NDArray[np.bool_]) -> int | None:
    """Return the allowed lane change that leads towards the goal on a straight road, if any does."""
    ahead, aside = expanded(now["goal"], GOAL_SCALE)
    is_straight = np.abs(now["heading_errors"]).max() < 0.08
    if not is_straight or ahead < 0.0 or not 0.6 * LANE < abs(aside) < 5 * LANE:
        return None
    change = LaneAction.change_lane_left if aside > 0 else LaneAction.change_lane_right
    return change if mask[change] else None


def _most_speed(
    others: Floats, speed: float, wish: int | None, arrival: float, ahead: float, number: NDArray
) -> float:
    """Return the highest speed before a junction, and while a lane change is due [m/s]."""
    most = JUNCTION_SPEED if arrival >= 0.0 else np.inf
    if wish is None or ahead >= OVERDUE:
        return most
    # After another decision of speeding up it can still stop at the last place.
    gain = SPEEDING_UP * DECISION
    in_time = np.sqrt(2 * BRAKING * max(0.0, ahead - LAST_PLACE - (speed + gain) * DECISION)) - gain
    is_even = int(np.argmax(number)) % 2 == 0
    return min(most, _speed_to_let_by(others, wish, is_even), in_time)


def _speed_to_let_by(others: Floats, change: int, is_even: bool) -> float:
    """Return how fast to go, at most, so that a gap opens in the lane to the side [m/s].

    Of two vehicles that want each other's lane, the one behind falls back; of two side by side, the odd one.
    """
    side = 1.0 if change == LaneAction.change_lane_left else -1.0
    beside = others[(side * others[:, 1] > 0.4 * LANE) & (side * others[:, 1] < 2.4 * LANE)]
    if not len(beside):
        return JUNCTION_SPEED
    x = beside[np.argmin(np.abs(beside[:, 0])), 0]
    falls_back = x > 1.0 or (x > -1.0 and not is_even)
    return LOWEST_SPEED if falls_back else JUNCTION_SPEED


def _is_free(others: Floats, speed: float, change: int, arrival: float, *, is_urgent: bool) -> bool:
    """Return whether the lane to the side is free, now and soon, and this is no place before a junction.

    A vehicle that stops between two lanes before a junction is hit from behind. Where the change is urgent,
    it may be made there too, and others are expected to brake.
    """
    if arrival >= 0.0 and not is_urgent:
        return False
    side = 1.0 if change == LaneAction.change_lane_left else -1.0
    for x, y, vx, _ in others:
        if not 0.4 * LANE < side * y < 2.4 * LANE:
            continue
        closing = speed - vx if x > 0 else vx - speed
        if abs(x) < LENGTH + 2.0 + max(0.0, closing) * (1.0 if is_urgent else 2.0):
            return False
    return True


def _others(now: Mapping[str, Floats], speed: float) -> Floats:
    """Return x, y [m], vx, vy [m/s] of each neighbour in the vehicle's frame, shape (K, 4)."""
    rows = now["neighbors"].reshape(-1, NEIGHBOR_VALUES)
    rows = rows[rows[:, 0] > 0.0]
    velocities = expanded(rows[:, 3:5], SPEED_SCALE)
    velocities[:, 0] += speed
    return np.column_stack([expanded(rows[:, 1:3], RADIUS), velocities])


def _path(errors: Floats) -> Floats:
    """Return points of the path ahead in the vehicle's frame, one a metre, straight on after the last [m]."""
    angles = np.arcsin(errors)
    angles = np.concatenate([angles, np.full(60, angles[-1])])
    steps = np.column_stack([np.cos(angles), np.sin(angles)])
    return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])


def _curve_speed(errors: Floats) -> float:
    """Return the speed in the sharpest curve of the path ahead [m/s]."""
    angles = np.arcsin(errors)
    curvature = np.abs(angles[CURVE:] - angles[:-CURVE]).max() / CURVE
    return float(np.sqrt(CURVE_ACCELERATION / max(curvature, 1e-6)))


def _driven(speed: float, acceleration: float, most: float = np.inf) -> Floats:
    """Return the distance driven at each of `TIMES` [m], accelerating up to `most` [m/s]."""
    if acceleration < 0.0:
        return braked_way.py_func(speed, -acceleration, TIMES)
    faster = np.minimum(TIMES, max(0.0, min(MOST_SPEED, most) - speed) / acceleration)
    return speed * TIMES + acceleration * (0.5 * faster**2 + faster * (TIMES - faster))


def _followed(speed: float) -> Floats:
    """Return the distance driven at each of `TIMES` when braking begins at the next decision [m]."""
    first, most = np.minimum(TIMES, DECISION), speed + SPEEDING_UP * DECISION
    braked = braked_way.py_func(most, BRAKING, np.maximum(TIMES - DECISION, 0.0))
    return speed * first + 0.5 * SPEEDING_UP * first**2 + braked


def _stopping(leaders: Floats) -> Floats:
    """Return places of vehicles that brake to a standstill at each of `TIMES`, shape (K, 1, T, 2) [m]."""
    speed = np.hypot(leaders[:, 2], leaders[:, 3])[:, None]
    factors = braked_way.py_func(speed, LEADERS_BRAKING, TIMES) / np.maximum(speed, 1e-9)
    return leaders[:, None, None, :2] + factors[:, None, :, None] * leaders[:, None, None, 2:]


def _goes_along(others: Floats) -> NDArray[np.bool_]:
    """Return which vehicles drive in the same direction or stand."""
    vx, vy = others[:, 2], others[:, 3]
    return (np.abs(vy) < 0.5 * np.abs(vx)) & (vx > 0.0) | (np.hypot(vx, vy) < 0.5)


def _horizons(others: Floats, *, turns_left: bool, yields: bool, claims: bool) -> Floats:
    """Return the horizon of each vehicle [s]."""
    vx, vy = others[:, 2], others[:, 3]
    is_ahead = _goes_along(others)
    is_oncoming = (vx < 0.0) & (np.abs(vy) < -vx)
    from_the_right = ~is_ahead & ~is_oncoming & (vy > 0.0)
    goes_first = is_ahead | (is_oncoming & turns_left) | from_the_right | yields
    return np.where(goes_first & ~(claims & ~is_ahead), HORIZON, SHORT_HORIZON)


def _ways(others: Floats, *, may_speed_up: bool) -> Floats:
    """Return predicted places of vehicles at each of `TIMES` in the vehicle's frame, shape (K, 2, T, 2) [m].

    Two predictions each: constant speed, and accelerating for crossing vehicles that may.
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
    """Return when the first vehicle comes too near, infinity without one [s].

    A vehicle is three discs in a row along its way. The heading of a standing vehicle is unknown: it is that
    of the nearest part of the own path.
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
            # A vehicle that is too near already must not come nearer; passing or leaving is allowed.
            kept = 2 * DISC + (from_standing if stands else SAFE)
            near = (distance < min(kept, distance[0] - SLACK)) & (horizon >= TIMES)
            if near.any():
                soonest = min(soonest, float(TIMES[np.argmax(near)]))
    return soonest


def _discs(centres: Floats, ways: Floats) -> Floats:
    """Return the centres of a vehicle's discs at each time, shape (T, 3, 2)."""
    return centres[:, None] + DISC_PLACES[:, None] * ways[:, None]
