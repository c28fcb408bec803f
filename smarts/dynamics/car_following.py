"""Car following as functions of numbers: the models of Krauss and IDM, as SUMO computes them.

Speeds that a driver may have at the end of a step, gaps, and times of arrival. In the ballistic rule a
vehicle drives a step with its mean speed, and a speed below 0 means that it stops within the step; in Euler's
it drives the step with its new speed. Distances are in m, times in s, speeds in m/s.

Sources: `MSCFModel.cpp`, `MSCFModel_Krauss.cpp` and `MSCFModel_IDM.cpp` of SUMO; Krauss,
"Microscopic modeling of traffic flow", 1998; Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000) 1805.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from smarts.geometry.compiling import kernel

SLACK = 1e-3
"""Subtracted from gaps, against rounding [m]."""
EMERGENCY = 1.2
"""Factor of the needed deceleration, where it is harder than a driver's."""
IDM_STEP = 0.25
"""Longest step in which IDM is integrated [s]."""


class Driver(NamedTuple):
    """Parameters of a driver and its integration; kernels take any record with these fields."""

    accel: float
    """Largest acceleration [m/s^2]."""
    decel: float
    """Comfortable deceleration, as are gaps planned [m/s^2]."""
    hardest: float
    """Deceleration in an emergency [m/s^2]."""
    tau: float
    """Time headway [s]."""
    sigma: float
    """Krauss's imperfection, from 0 to 1."""
    min_gap: float
    """Gap to a standing leader [m]."""
    max_speed: float
    reaction: float
    """Time between decisions, at least a step [s]."""
    dt: float
    """Length of a step [s]."""
    is_idm: bool = False
    ballistic: bool = False
    """The rule of integration."""


@kernel
def brake_gap(k: Driver, speed: float, decel: float, tau: float) -> float:
    """Return the distance driven until a vehicle stands that brakes after `tau`."""
    if speed <= 0.0:
        return 0.0
    if k.ballistic:
        return speed * (tau + 0.5 * speed / decel)
    steps = int(speed / (decel * k.dt))
    return k.dt * (steps * speed - 0.5 * decel * k.dt * steps * (steps + 1)) + speed * tau


@kernel
def braked_way(speed: Any, decel: Any, seconds: Any) -> Any:
    """Return the distance driven in some time while braking evenly to a standstill; see `idm_free`."""
    moving = np.minimum(seconds, speed / decel)
    return speed * moving - 0.5 * decel * (moving * moving)


@kernel
def secure_gap(k: Driver, speed: float, leader_speed: float, leader_decel: float) -> float:
    """Return the gap at which a driver can stop behind a leader that brakes as hard as it can."""
    own = brake_gap(k, speed, k.decel, k.tau)
    return max(0.0, own - brake_gap(k, leader_speed, max(k.decel, leader_decel), 0.0))


@kernel
def safe_stop_speed(k: Driver, gap: float, speed: float, decel: float, tau: float) -> float:
    """Return the highest speed after a step from which a driver that brakes after `tau` stops in a gap."""
    if not k.ballistic:
        return _stop_speed_euler(gap - SLACK, decel, tau, k.dt)
    gap, speed = max(0.0, gap - SLACK), max(0.0, speed)
    if speed * tau >= 2.0 * gap:
        if gap == 0.0:
            return -1e6 if speed > 0.0 else 0.0
        return speed - 0.5 * speed * speed / gap * k.dt
    half = 0.5 * decel * tau
    then = -half + math.sqrt(half * half + decel * (2.0 * gap - tau * speed))
    return speed + (then - speed) / tau * k.dt


@kernel
def _stop_speed_euler(gap: float, decel: float, tau: float, dt: float) -> float:
    """Return the highest speed from which a driver stops within a gap, with whole steps of braking."""
    if gap < 0.0:
        return 0.0
    loss = decel * dt
    root = math.sqrt(dt * dt + 4.0 * (dt * (2.0 * gap / loss - tau) + tau * tau))
    steps = math.floor(0.5 - (tau - 0.5 * root) / dt)
    driven = 0.5 * steps * (steps - 1) * loss * dt + steps * loss * tau
    return steps * loss + (gap - driven) / (steps * dt + tau)


@kernel
def insertion_stop_speed(k: Driver, gap: float) -> float:
    """Return the highest speed with which a vehicle may appear before a gap in which it has to stop."""
    if not k.ballistic:
        return _stop_speed_euler(gap - SLACK, k.decel, k.tau, k.dt)
    reaction = k.decel * k.tau
    return -reaction + math.sqrt(reaction * reaction + 2.0 * k.decel * max(0.0, gap - SLACK))


@kernel
def free_speed(k: Driver, speed: float, target: float, distance: float, reaction: float) -> float:
    """Return the highest speed after a step from which a driver slows down in time to a target.

    Args:
        k: The driver.
        speed: Now [m/s].
        target: [m/s]
        distance: [m]
        reaction: Time between its decisions [s], 0 for a vehicle that appears.
    """
    decel, dt = k.decel, k.dt
    if k.ballistic:
        distance -= SLACK
        then = target
        if 0.5 * (speed + target) * reaction < distance:
            half = 0.5 * decel * reaction
            square = (2.0 * distance - reaction * speed) * decel + target * target
            then = -half + math.sqrt(half * half + square)
        return then if reaction == 0.0 else speed + (then - speed) * dt / reaction
    step = target * dt
    if distance < step:
        return target
    loss = decel * dt * dt
    root = math.sqrt((loss + 2.0 * step) * (loss + 2.0 * step) + 8.0 * loss * distance)
    steps = max(0.0, (0.5 * (root - loss) - step) / loss)
    whole = math.floor(steps)
    driven = 0.5 * (whole * whole + whole) * loss + whole * step + (step if steps > whole else 0.0)
    gain = whole + 1.0 if reaction == 0.0 else whole
    return max(0.0, distance - driven) / (whole + 1.0) / dt + gain * decel * dt + target


@kernel
def highest_next(k: Driver, speed: float) -> float:
    """Return the highest speed after a step."""
    return min(speed + k.accel * k.dt, k.max_speed)


@kernel
def lowest_next(k: Driver, speed: float) -> float:
    """Return the lowest speed after a step without an emergency; below 0: a stop within it."""
    decel = max(k.decel, min(k.hardest, 1.5)) if k.is_idm else k.decel
    lowest = speed - decel * k.dt
    return lowest if k.ballistic else max(lowest, 0.0)


@kernel
def stop_speed(k: Driver, gap: float, speed: float, decel: float, desired: float) -> float:
    """Return a driver's speed after a step before a place where it stops.

    Args:
        k: The driver.
        gap: To the place [m].
        speed: Now [m/s].
        decel: Deceleration that it allows [m/s^2].
        desired: Speed on a free road [m/s].
    """
    if k.is_idm and gap >= 0.01:
        found = idm_speed(k, gap, speed, 0.0, desired, 0.0)
        if speed >= 1e-3 or found >= 1e-3:
            return found
    safe = safe_stop_speed(k, gap, speed, decel, k.reaction)
    return min(_relaxed(k, safe, gap, speed, 0.0, decel, 1.0), highest_next(k, speed))


@kernel
def follow_speed(
    k: Driver, gap: float, speed: float, leader_speed: float, leader_decel: float, desired: float
) -> float:
    """Return a driver's speed after a step with which it could stop behind its leader.

    Args:
        k: The driver.
        gap: To the leader, less the least one [m].
        speed: Now [m/s].
        leader_speed: [m/s]
        leader_decel: How hard the leader may brake [m/s^2].
        desired: Speed on a free road [m/s].
    """
    if k.is_idm:
        return idm_speed(k, gap + k.min_gap, speed, leader_speed, desired, k.min_gap)
    lowest, highest = speed - k.hardest * k.dt, highest_next(k, speed)
    if gap < 0.0:
        return min(lowest if k.ballistic else max(lowest, 0.0), highest)
    braking = brake_gap(k, leader_speed, max(k.decel, leader_decel), 0.0)
    safe = safe_stop_speed(k, gap + braking, speed, k.decel, k.tau)
    safe = _relaxed(k, safe, gap, speed, leader_speed, k.decel, leader_decel)
    return min(max(safe, lowest) if k.ballistic else safe, highest)


@kernel
def slow_to(k: Driver, speed: float, target: float, distance: float) -> float:
    """Return a driver's speed after a step before a place that it passes at a speed, at most."""
    if not k.is_idm:
        return free_speed(k, speed, target, distance, k.reaction)
    if speed <= target:
        return idm_speed(k, math.inf, speed, target, target, 0.0)
    return max(idm_speed(k, distance, speed, 0.0, target, 0.0), target)


@kernel
def _relaxed(
    k: Driver, safe: float, gap: float, speed: float, leader_speed: float, decel: float, leader_decel: float
) -> float:
    """Return a safe speed, raised to what an emergency braking that suffices leads to."""
    needed = (speed - safe) / k.dt
    if decel == k.hardest or needed <= decel + SLACK:
        return safe
    enough = k.hardest
    if gap > 0.0:
        enough = 0.5 * speed * speed / (gap + 0.5 * leader_speed * leader_speed / leader_decel)
        if enough > leader_decel:
            enough = 0.5 * (speed * speed - leader_speed * leader_speed) / gap
    raised = speed - min(max(EMERGENCY * enough, decel), needed) * k.dt
    return raised if k.ballistic else max(raised, 0.0)


@kernel
def dawdled_speed(k: Driver, speed: float, draw: float) -> float:
    """Return Krauss's speed of a driver that accelerates imperfectly; `draw` is from [0, 1)."""
    if speed < 0.0:
        return speed
    return max(0.0, speed - k.sigma * min(speed, k.accel) * draw * k.dt)


@kernel
def idm_free(accel: Any, speed: Any, desired: Any) -> Any:
    """Return the intelligent driver's acceleration on a free road [m/s^2]; its `py_func` takes arrays."""
    share = speed / desired
    return accel * (1.0 - (share * share) * (share * share))


@kernel
def idm_interaction(
    accel: Any, decel: Any, tau: Any, min_gap: Any, gap: Any, speed: Any, leader_speed: Any
) -> Any:
    """Return how much less it is behind a leader [m/s^2]; see `idm_free`.

    Args:
        accel: Largest acceleration [m/s^2].
        decel: Comfortable deceleration [m/s^2].
        tau: Time headway [s].
        min_gap: Gap to a standing leader [m].
        gap: To the leader, bumper to bumper [m].
        speed: [m/s]
        leader_speed: [m/s]
    """
    wanted = speed * tau + speed * (speed - leader_speed) / (2.0 * np.sqrt(accel * decel))
    share = (min_gap + np.maximum(wanted, 0.0)) / gap
    return accel * (share * share)


@kernel
def idm_speed(
    k: Driver, gap: float, speed: float, leader_speed: float, desired: float, min_gap: float
) -> float:
    """Return the speed after a step of the intelligent driver model, for a gap bumper to bumper."""
    count = max(1, int(k.dt / IDM_STEP + 0.5))
    part = k.dt / count
    for _ in range(count):
        change = idm_free(k.accel, speed, max(desired, SLACK))
        change -= idm_interaction(k.accel, k.decel, k.tau, min_gap, max(gap, SLACK), speed, leader_speed)
        speed = max(0.0, speed + part * change)
        gap -= max(0.0, part * (speed - leader_speed))
    return speed


@kernel
def soonest_arrival(k: Driver, distance: float, speed: float, arrival_speed: float) -> float:
    """Return the least time in which a vehicle comes to a place that it passes with a speed."""
    rate = k.accel if arrival_speed >= speed else -k.decel
    change = (arrival_speed - speed) / rate
    way = 0.5 * change * (arrival_speed + speed)
    if distance < way:
        return (math.sqrt(max(speed * speed + 2.0 * rate * distance, 0.0)) - speed) / rate
    return change + (distance - way) / max(speed, arrival_speed, 0.1)


@kernel
def speed_after(distance: float, speed: float, accel: float, most: float) -> float:
    """Return the speed of a vehicle that has accelerated over a distance, up to the highest one."""
    return min(most, math.sqrt(max(0.0, 2.0 * distance * accel + speed * speed)))


@kernel
def delayed_arrival(
    arrival: float, other_arrival: float, other_distance: float, braking: float, dt: float
) -> tuple[float, float]:
    """Return when another vehicle comes to a junction if it brakes once this one has arrived, and how fast.

    Times count from now; `braking` is its deceleration times this driver's impatience.

    Args:
        arrival: Arrival of this vehicle [s].
        other_arrival: Arrival of the other one, if it does not brake [s].
        other_distance: Distance of the other one [m].
        braking: [m/s^2]
        dt: Length of a step [s].

    Returns:
        Time of arrival [s], 30 s later if it can stop; speed there [m/s].
    """
    if math.floor(arrival / dt) == math.floor(other_arrival / dt):
        return other_arrival, -1.0
    between = other_arrival - arrival
    speed = other_distance / (other_arrival + dt)
    left = other_distance - speed * arrival
    if 0.5 * speed * speed / braking <= left:
        return other_arrival + 30.0, 0.0
    slower = speed - between * braking
    root = math.sqrt(max(0.0, 4.0 * slower * slower - 4.0 * braking * braking * between * between))
    late = (slower - 0.5 * root) / braking
    return other_arrival + late, speed - (between + late) * braking
