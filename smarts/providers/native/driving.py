"""Kernels with a driver's speeds and gaps: `smarts.dynamics.car_following` by the vehicle's type."""

from __future__ import annotations

from smarts.dynamics.car_following import (
    brake_gap,
    free_speed,
    idm_speed,
    krauss_follow_speed,
    krauss_stop_speed,
    secure_gap,
)
from smarts.geometry.compiling import kernel
from smarts.providers.native.state import Demand, Traffic, Types

DECEL = 4.5
"""Deceleration that drivers expect of other providers' vehicles [m/s^2]."""
ACCEL = 2.6
"""Their acceleration, likewise [m/s^2]."""
ROAD_END = 1e6
"""Gap where there is no leader, for IDM [m]."""


@kernel
def desired_speed(n: Traffic, d: Demand, b: int, slot: int, lane: int) -> float:
    """Return a driver's speed on a free lane [m/s]."""
    return min(n.roads.lane_speed[lane] * n.driven.factor[b, slot], d.types.max_speed[n.driven.type[b, slot]])


@kernel
def reaction_of(types: Types, t: int, dt: float) -> float:
    """Return the time between a type's decisions [s]."""
    return max(types.reaction[t], dt)


@kernel
def decel_of(n: Traffic, d: Demand, b: int, slot: int) -> float:
    """Return the deceleration that others expect of a vehicle [m/s^2]."""
    if n.state.vehicles.owner[b, slot] != n.owner:
        return DECEL
    return float(d.types.decel[n.driven.type[b, slot]])


@kernel
def highest_next(types: Types, t: int, speed: float, dt: float) -> float:
    """Return the highest speed after a step [m/s]."""
    return min(speed + types.accel[t] * dt, types.max_speed[t])


@kernel
def lowest_next(types: Types, t: int, speed: float, dt: float, ballistic: bool) -> float:
    """Return the lowest speed after a step without an emergency [m/s]; below 0: a stop within it."""
    decel = max(types.decel[t], min(types.hardest[t], 1.5)) if types.is_idm[t] else types.decel[t]
    lowest = speed - decel * dt
    return lowest if ballistic else max(lowest, 0.0)


@kernel
def follow_speed(
    n: Traffic,
    d: Demand,
    b: int,
    slot: int,
    speed: float,
    gap: float,
    leader_speed: float,
    leader_decel: float,
) -> float:
    """Return a driver's speed after a step behind a leader [m/s]; `gap` is less the least gap [m]."""
    types, t, dt = d.types, n.driven.type[b, slot], n.state.dt
    if types.is_idm[t]:
        desired = desired_speed(n, d, b, slot, d.ways.lane[n.driven.row[b, slot]])
        least = types.min_gap[t]
        return idm_speed(
            gap + least, speed, leader_speed, desired, types.accel[t], types.decel[t], types.tau[t], least, dt
        )
    found = krauss_follow_speed(
        gap,
        speed,
        leader_speed,
        types.decel[t],
        types.hardest[t],
        leader_decel,
        types.tau[t],
        dt,
        n.ballistic[b],
    )
    return min(found, highest_next(types, t, speed, dt))


@kernel
def stop_speed(n: Traffic, d: Demand, b: int, slot: int, speed: float, gap: float, decel: float) -> float:
    """Return a driver's speed after a step before a place where it stops [m/s]; `decel` is what it allows."""
    types, t, dt = d.types, n.driven.type[b, slot], n.state.dt
    if types.is_idm[t] and gap >= 0.01:
        desired = desired_speed(n, d, b, slot, d.ways.lane[n.driven.row[b, slot]])
        found = idm_speed(gap, speed, 0.0, desired, types.accel[t], types.decel[t], types.tau[t], 0.0, dt)
        if speed >= 1e-3 or found >= 1e-3:
            return found
    reaction = reaction_of(types, t, dt)
    found = krauss_stop_speed(gap, speed, decel, types.hardest[t], reaction, dt, n.ballistic[b])
    return min(found, highest_next(types, t, speed, dt))


@kernel
def slow_to(n: Traffic, d: Demand, b: int, slot: int, speed: float, target: float, distance: float) -> float:
    """Return a driver's speed after a step before a place that it passes at a speed, at most [m/s]."""
    types, t, dt = d.types, n.driven.type[b, slot], n.state.dt
    if types.is_idm[t]:
        gap = ROAD_END if speed <= target else distance
        leader = target if speed <= target else 0.0
        found = idm_speed(gap, speed, leader, target, types.accel[t], types.decel[t], types.tau[t], 0.0, dt)
        return max(found, min(target, speed)) if speed > target else found
    return free_speed(speed, target, distance, types.decel[t], reaction_of(types, t, dt), dt, n.ballistic[b])


@kernel
def braking_distance(n: Traffic, d: Demand, b: int, slot: int, speed: float, tau: float) -> float:
    """Return the distance in which a driver stops that reacts after `tau` [s] [m]."""
    return brake_gap(speed, d.types.decel[n.driven.type[b, slot]], tau, n.state.dt, n.ballistic[b])


@kernel
def needed_gap(
    n: Traffic, d: Demand, b: int, slot: int, speed: float, leader_speed: float, leader_decel: float
) -> float:
    """Return the gap that a driver needs behind a leader [m]."""
    decel, tau = DECEL, 1.0
    if n.state.vehicles.owner[b, slot] == n.owner:
        decel, tau = d.types.decel[n.driven.type[b, slot]], d.types.tau[n.driven.type[b, slot]]
    return secure_gap(speed, leader_speed, decel, leader_decel, tau, n.state.dt, n.ballistic[b])


@kernel
def least_gap(n: Traffic, d: Demand, b: int, slot: int) -> float:
    """Return the gap that a driver keeps when it stands [m]."""
    if n.state.vehicles.owner[b, slot] != n.owner:
        return 2.5
    return float(d.types.min_gap[n.driven.type[b, slot]])
