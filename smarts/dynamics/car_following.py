"""Car following as functions of numbers: the models of Krauss and IDM, as SUMO computes them.

Speeds that a driver may have at the end of a step, gaps, and times of arrival. In the ballistic rule a
vehicle drives a step with its mean speed, and a speed below 0 means that it stops within the step; in Euler's
it drives the step with its new speed.

Sources: `MSCFModel.cpp`, `MSCFModel_Krauss.cpp` and `MSCFModel_IDM.cpp` of SUMO; Krauss,
"Microscopic modeling of traffic flow", 1998; Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000) 1805.
"""

from __future__ import annotations

import math

from smarts.geometry.compiling import kernel

SLACK = 1e-3
"""Subtracted from gaps, against rounding [m]."""
EMERGENCY = 1.2
"""Factor of the needed deceleration, where it is harder than a driver's."""
IDM_STEP = 0.25
"""Longest step in which IDM is integrated [s]."""


@kernel
def brake_gap(speed: float, decel: float, tau: float, dt: float, ballistic: bool) -> float:
    """Return the distance driven until a vehicle stands that reacts after `tau` [s] [m]."""
    if speed <= 0.0:
        return 0.0
    if ballistic:
        return speed * (tau + 0.5 * speed / decel)
    steps = int(speed / (decel * dt))
    return dt * (steps * speed - 0.5 * decel * dt * steps * (steps + 1)) + speed * tau


@kernel
def secure_gap(
    speed: float,
    leader_speed: float,
    decel: float,
    leader_decel: float,
    tau: float,
    dt: float,
    ballistic: bool,
) -> float:
    """Return the gap at which a driver can stop behind a leader that brakes as hard as it can [m]."""
    own = brake_gap(speed, decel, tau, dt, ballistic)
    return max(0.0, own - brake_gap(leader_speed, max(decel, leader_decel), 0.0, dt, ballistic))


@kernel
def safe_stop_speed(gap: float, speed: float, decel: float, tau: float, dt: float, ballistic: bool) -> float:
    """Return the highest speed after a step from which a driver stops within a gap [m/s].

    Args:
        gap: [m]
        speed: Now [m/s].
        decel: [m/s^2]
        tau: Time until it brakes [s].
        dt: Length of a step [s].
        ballistic: The rule of integration.
    """
    if not ballistic:
        return _stop_speed_euler(gap - SLACK, decel, tau, dt)
    gap, speed = max(0.0, gap - SLACK), max(0.0, speed)
    if speed * tau >= 2.0 * gap:
        if gap == 0.0:
            return -1e6 if speed > 0.0 else 0.0
        return speed - 0.5 * speed * speed / gap * dt
    half = 0.5 * decel * tau
    then = -half + math.sqrt(half * half + decel * (2.0 * gap - tau * speed))
    return speed + (then - speed) / tau * dt


@kernel
def _stop_speed_euler(gap: float, decel: float, tau: float, dt: float) -> float:
    """Return the highest speed from which a driver stops within a gap, with whole steps of braking [m/s]."""
    if gap < 0.0:
        return 0.0
    loss = decel * dt
    root = math.sqrt(dt * dt + 4.0 * (dt * (2.0 * gap / loss - tau) + tau * tau))
    steps = math.floor(0.5 - (tau - 0.5 * root) / dt)
    driven = 0.5 * steps * (steps - 1) * loss * dt + steps * loss * tau
    return steps * loss + (gap - driven) / (steps * dt + tau)


@kernel
def insertion_stop_speed(gap: float, decel: float, tau: float, dt: float, ballistic: bool) -> float:
    """Return the highest speed with which a vehicle may appear before a gap in which it has to stop [m/s]."""
    if not ballistic:
        return _stop_speed_euler(gap - SLACK, decel, tau, dt)
    reaction = decel * tau
    return -reaction + math.sqrt(reaction * reaction + 2.0 * decel * max(0.0, gap - SLACK))


@kernel
def free_speed(
    speed: float, target: float, distance: float, decel: float, reaction: float, dt: float, ballistic: bool
) -> float:
    """Return the highest speed after a step from which a driver slows down in time to a target [m/s].

    Args:
        speed: Now [m/s].
        target: [m/s]
        distance: [m]
        decel: [m/s^2]
        reaction: Time between its decisions [s], 0 for a vehicle that appears.
        dt: Length of a step [s].
        ballistic: The rule of integration.
    """
    if ballistic:
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
def krauss_stop_speed(
    gap: float, speed: float, decel: float, hardest: float, reaction: float, dt: float, ballistic: bool
) -> float:
    """Return the highest speed after a step of a driver that stops within a gap [m/s].

    Args:
        gap: [m]
        speed: Now [m/s].
        decel: [m/s^2]
        hardest: In an emergency [m/s^2].
        reaction: Time between its decisions [s].
        dt: Length of a step [s].
        ballistic: The rule of integration.
    """
    safe = safe_stop_speed(gap, speed, decel, reaction, dt, ballistic)
    return _relaxed(safe, gap, speed, 0.0, decel, hardest, 1.0, dt, ballistic)


@kernel
def krauss_follow_speed(
    gap: float,
    speed: float,
    leader_speed: float,
    decel: float,
    hardest: float,
    leader_decel: float,
    tau: float,
    dt: float,
    ballistic: bool,
) -> float:
    """Return the highest speed after a step of a driver that could stop behind its leader [m/s].

    Args:
        gap: To the leader, less the least one [m].
        speed: Now [m/s].
        leader_speed: [m/s]
        decel: [m/s^2]
        hardest: In an emergency [m/s^2].
        leader_decel: [m/s^2]
        tau: Time headway [s].
        dt: Length of a step [s].
        ballistic: The rule of integration.
    """
    lowest = speed - hardest * dt
    if gap < 0.0:
        return lowest if ballistic else max(lowest, 0.0)
    braking = brake_gap(leader_speed, max(decel, leader_decel), 0.0, dt, ballistic)
    safe = safe_stop_speed(gap + braking, speed, decel, tau, dt, ballistic)
    safe = _relaxed(safe, gap, speed, leader_speed, decel, hardest, leader_decel, dt, ballistic)
    return max(safe, lowest) if ballistic else safe


@kernel
def _relaxed(
    safe: float,
    gap: float,
    speed: float,
    leader_speed: float,
    decel: float,
    hardest: float,
    leader_decel: float,
    dt: float,
    ballistic: bool,
) -> float:
    """Return a safe speed, raised to what an emergency braking that suffices leads to [m/s]."""
    needed = (speed - safe) / dt
    if decel == hardest or needed <= decel + SLACK:
        return safe
    enough = hardest
    if gap > 0.0:
        enough = 0.5 * speed * speed / (gap + 0.5 * leader_speed * leader_speed / leader_decel)
        if enough > leader_decel:
            enough = 0.5 * (speed * speed - leader_speed * leader_speed) / gap
    raised = speed - min(max(EMERGENCY * enough, decel), needed) * dt
    return raised if ballistic else max(raised, 0.0)


@kernel
def dawdled_speed(speed: float, sigma: float, accel: float, draw: float, dt: float) -> float:
    """Return Krauss's speed of a driver that accelerates imperfectly [m/s]; `draw` is from [0, 1)."""
    if speed < 0.0:
        return speed
    return max(0.0, speed - sigma * min(speed, accel) * draw * dt)


@kernel
def idm_acceleration(
    gap: float,
    speed: float,
    leader_speed: float,
    desired: float,
    accel: float,
    decel: float,
    tau: float,
    least: float,
) -> float:
    """Return the acceleration of the intelligent driver model [m/s^2].

    Args:
        gap: To the leader, bumper to bumper [m].
        speed: [m/s]
        leader_speed: [m/s]
        desired: Speed on a free road [m/s].
        accel: Largest acceleration [m/s^2].
        decel: Comfortable deceleration [m/s^2].
        tau: Time headway [s].
        least: Gap to a standing leader [m].
    """
    wanted = speed * tau + 0.5 * speed * (speed - leader_speed) / math.sqrt(accel * decel)
    wanted = least + max(0.0, wanted)
    gap, share = max(gap, SLACK), speed / max(desired, SLACK)
    return accel * (1.0 - (share * share) * (share * share) - (wanted * wanted) / (gap * gap))


@kernel
def idm_speed(
    gap: float,
    speed: float,
    leader_speed: float,
    desired: float,
    accel: float,
    decel: float,
    tau: float,
    least: float,
    dt: float,
) -> float:
    """Return the speed after a step of the intelligent driver model [m/s]; see `idm_acceleration`."""
    count = max(1, int(dt / IDM_STEP + 0.5))
    part = dt / count
    for _ in range(count):
        speed = max(
            0.0, speed + part * idm_acceleration(gap, speed, leader_speed, desired, accel, decel, tau, least)
        )
        gap -= max(0.0, part * (speed - leader_speed))
    return speed


@kernel
def soonest_arrival(distance: float, speed: float, arrival_speed: float, accel: float, decel: float) -> float:
    """Return the least time in which a vehicle comes to a place that it passes with a speed [s]."""
    rate = accel if arrival_speed >= speed else -decel
    change = (arrival_speed - speed) / rate
    way = 0.5 * change * (arrival_speed + speed)
    return change + max(0.0, distance - way) / max(speed, arrival_speed, 0.1)


@kernel
def speed_after(distance: float, speed: float, accel: float, most: float) -> float:
    """Return the speed of a vehicle that has accelerated over a distance, up to the highest one [m/s]."""
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
