"""Kernels with a driver's speeds: `smarts.dynamics.car_following` for a vehicle that follows or stops."""

from __future__ import annotations

from smarts.dynamics import car_following as cf
from smarts.geometry.compiling import kernel
from smarts.providers.native.state import Car, Lane, Traffic


@kernel
def follow(n: Traffic, car: Car, gap: float, speed: float, leader: Car, leader_speed: float) -> float:
    """Return a driver's speed after a step behind a leader; `gap` is less the least gap."""
    return cf.follow_speed(
        n.types[car.type], gap, speed, leader_speed, n.types[leader.type].decel, car.desired
    )


@kernel
def stop(n: Traffic, car: Car, gap: float) -> float:
    """Return a driver's speed after a step before a place where it stops."""
    kind = n.types[car.type]
    return cf.stop_speed(kind, gap, car.speed, kind.decel, car.desired)


@kernel
def desired_speed(n: Traffic, car: Car, lane: Lane) -> float:
    """Return a driver's speed on a free lane."""
    return min(lane.speed * car.factor, n.types[car.type].max_speed)
