"""Kernels of vehicles that follow a path: how they join it, where they are on it, and how fast they drive.

A vehicle that is behind its schedule drives faster than the log, one that is ahead slower, and no vehicle
drives faster than the intelligent driver model behind what is on its path; without a leader, nothing of that
model is left. Source of the interaction: Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000) 1805.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from smarts.dynamics.car_following import SLACK, idm_interaction
from smarts.geometry.boxes import Pose
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import project, segment_at, wrapped
from smarts.providers.native.state import Record
from smarts.providers.recorded.state import Course, Recorded
from smarts.recordings.gaps import DEFAULT_HEADWAY, STANDING_GAP, gap_on_path
from smarts.recordings.paths import Paths
from smarts.roads.levels import meets

ACCEL, DECEL, HARDEST = 2.0, 3.0, 8.0
"""A driver's acceleration, its deceleration without need, and its hardest one [m/s^2]."""
SLOPE = 0.8
"""How much faster than the log a vehicle drives that is a metre late [1/s]."""
SOON = 1.0
"""Vehicles give way to others that will be on their path, and ahead of them, after this time [s]."""
LEAST_BLEND, BLEND_TIME = 15.0, 2.0
"""A vehicle reaches the middle of its path within this distance [m] or time [s], whichever is longer."""
MISALIGNED = 0.5
"""Parts of a path that differ more from a vehicle's heading are not near it [rad]."""
Body: TypeAlias = tuple[float, float, float, float, float, float]
"""x, y of the centre, half length, half width [m], headway [s], speed [m/s]."""
_ON_LOG = int(Course.ON_LOG)


@kernel
def is_driven(n: Recorded, b: int, slot: int) -> bool:
    """Return whether the engine drives the vehicle in a slot, which may have changed hands meanwhile."""
    v, car = n.vehicles, n.cars[b, slot]
    is_own = v.alive[b, slot] and v.owner[b, slot] == n.owner
    return is_own and car.course > 0 and car.generation == v.generation[b, slot]


@kernel
def nearest_place(n: Recorded, p: int, x: float, y: float, heading: float) -> tuple[float, float, float]:
    """Return the place of a pose on a path: arc length, offset to the left [m], angle to the path [rad]."""
    paths, best, s, offset, turn = n.paths, np.inf, 0.0, np.inf, 0.0
    for point in range(paths.point[p], paths.point[p + 1] - 1):
        ax, ay = paths.point_x[point], paths.point_y[point]
        bx, by = paths.point_x[point + 1], paths.point_y[point + 1]
        share, square, cross = project(x, y, ax, ay, bx, by)
        share = min(1.0, max(0.0, share))
        along = paths.point_turn[point] + share * (paths.point_turn[point + 1] - paths.point_turn[point])
        angle = wrapped(heading - along)
        cost = square + (1e9 if abs(angle) > MISALIGNED else 0.0)
        if cost < best:
            best, turn = cost, angle
            s = paths.point_s[point] + share * (paths.point_s[point + 1] - paths.point_s[point])
            offset = math.copysign(math.sqrt(square), cross)
    return s, offset, turn


@kernel
def join(n: Recorded, b: int, slot: int, p: int, s: float, offset: float, turn: float) -> None:
    """Let a vehicle follow a path from a place on; see `nearest_place`."""
    car, speed = n.cars[b, slot], n.vehicles.speed[b, slot]
    car.path, car.s, car.joined = p, s, s
    car.offset, car.slope = offset, math.tan(max(-MISALIGNED, min(MISALIGNED, turn)))
    car.blend = max(LEAST_BLEND, BLEND_TIME * speed)


@kernel
def offset_of(car: Record) -> tuple[float, float]:
    """Return a vehicle's offset to the left of its path [m], and its slope; a cubic that ends flat at 0."""
    u = min(1.0, max(0.0, (car.s - car.joined) / car.blend))
    offset = (2.0 * u - 3.0) * u * u * car.offset + car.offset
    offset += ((u - 2.0) * u + 1.0) * u * car.blend * car.slope
    slope = 6.0 * (u - 1.0) * u * car.offset / car.blend + ((3.0 * u - 4.0) * u + 1.0) * car.slope
    return offset, slope


@kernel
def pace_at(paths: Paths, p: int, s: float) -> float:
    """Return how fast a vehicle drives at a place of a path on a free road [m/s]."""
    return float(paths.point_pace[segment_at(paths.point_s, paths.point[p], paths.point[p + 1], s)])


@kernel
def pose_on_path(paths: Paths, car: Record) -> Pose:
    """Return the pose of a vehicle on its path."""
    row = segment_at(paths.point_s, paths.point[car.path], paths.point[car.path + 1], car.s)
    share = (car.s - paths.point_s[row]) / (paths.point_s[row + 1] - paths.point_s[row])
    x = paths.point_x[row] + share * (paths.point_x[row + 1] - paths.point_x[row])
    y = paths.point_y[row] + share * (paths.point_y[row + 1] - paths.point_y[row])
    turn = paths.point_turn[row] + share * (paths.point_turn[row + 1] - paths.point_turn[row])
    offset, slope = offset_of(car)
    return x - offset * math.sin(turn), y + offset * math.cos(turn), turn + math.atan(slope)


@kernel
def acceleration(n: Recorded, b: int, slot: int, p: int, s: float, ignores_log: bool) -> float:
    """Return how a vehicle that is there may accelerate for what is on a path; see `allowed_acceleration`."""
    v, track = n.vehicles, n.cars[b, slot].track
    headway = float(n.paths.headway[track]) if track >= 0 else DEFAULT_HEADWAY
    x, y = v.position[b, slot, 0], v.position[b, slot, 1]
    body = x, y, 0.5 * v.length[b, slot], 0.5 * v.width[b, slot], headway, v.speed[b, slot]
    return allowed_acceleration(n, b, slot, body, p, s, ignores_log)


@kernel
def allowed_acceleration(
    n: Recorded, b: int, slot: int, body: Body, p: int, s: float, ignores_log: bool
) -> float:
    """Return how a vehicle may accelerate for what is on a path ahead of it, or will be after `SOON` [m/s^2].

    Args:
        n: Recorded traffic.
        b: The simulation.
        slot: The vehicle's slot, -1 if it has not entered.
        body: The vehicle.
        p: Its path.
        s: Its place on the path [m].
        ignores_log: Whether vehicles are left out that are where the log has them.

    Returns:
        Infinite without a leader, below 0 if the gap to one is too small.
    """
    v, least = n.vehicles, np.inf
    x, y, half_length, half_width, headway, speed = body
    reach = 10.0 + speed * headway + 0.25 * speed * speed
    for other in range(n.used[b]):
        if not v.alive[b, other] or (slot >= 0 and not meets(v, b, slot, other)):
            continue
        is_own = is_driven(n, b, other)
        if ignores_log and is_own and n.cars[b, other].course == _ON_LOG:
            continue
        pose = v.position[b, other, 0], v.position[b, other, 1], v.heading[b, other]
        half_length2, half_width2 = 0.5 * v.length[b, other], 0.5 * v.width[b, other]
        if math.hypot(pose[0] - x, pose[1] - y) > reach + half_length + half_length2:
            continue
        for after in (0.0, SOON):
            if after > 0.0:
                behind, _ = gap_on_path(
                    n.paths, p, s - reach, half_length, half_width, reach, pose, half_length2, half_width2
                )
                if behind < np.inf:
                    break  # it follows on the same path
            gone = after * v.speed[b, other]
            there = pose[0] + gone * math.cos(pose[2]), pose[1] + gone * math.sin(pose[2]), pose[2]
            gap, cosine = gap_on_path(
                n.paths,
                p,
                s + after * speed,
                half_length,
                half_width,
                reach,
                there,
                half_length2,
                half_width2,
            )
            if gap < np.inf:
                along = max(0.0, v.speed[b, other] * cosine)
                # Vehicles of other providers have made this step already.
                gap = max(SLACK, gap if is_own else gap - along * n.dt)
                braking = idm_interaction(ACCEL, DECEL, headway, STANDING_GAP, gap, speed, along)
                least = min(least, ACCEL - braking)
                break
    return least


@kernel
def scheduled_speed(paths: Paths, car: Record, s: float, log_speed: float) -> float:
    """Return how fast a vehicle drives without a leader, to come back on schedule [m/s].

    Args:
        paths: The paths.
        car: The vehicle.
        s: Where the log has it now [m].
        log_speed: How fast the log has it [m/s].
    """
    late = s - car.s
    if late < 0.0:
        return max(0.0, log_speed + max(-2.0, 0.5 * late))
    faster = log_speed + min(SLOPE * late, math.sqrt(2.0 * late))
    return min(faster, max(log_speed, 1.2 * pace_at(paths, car.path, car.s) + 1.0))
