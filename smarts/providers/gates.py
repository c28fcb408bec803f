"""Kernels of the gates through which vehicles change hands."""

from __future__ import annotations

import math

from smarts.arrays import Bools, Floats, Ints
from smarts.geometry.boxes import box_gaps
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped
from smarts.roads.levels import meets
from smarts.types.vehicles import VehicleStates

NEAR = 0.3
"""A vehicle is not taken over while another is nearer [m]..."""
SOON = 0.2
"""...now or, if both drive on as they do, after this time [s]."""


@kernel
def find_too_close(
    vehicles: VehicleStates, rows: Ints, slots: Ints, least: float, seconds: float, found: Bools
) -> None:
    """Write whether another footprint is near those of N vehicles.

    Args:
        vehicles: Vehicles of B simulations.
        rows: Simulation of each vehicle, shape (N,).
        slots: Slot of each vehicle, shape (N,).
        least: The least distance [m].
        seconds: How far ahead the distance is looked at, too [s].
        found: Written, shape (N,).
    """
    for number in range(len(rows)):
        b, slot = rows[number], slots[number]
        found[number] = False
        for other in range(vehicles.alive.shape[1]):
            if not meets(vehicles, b, slot, other):
                continue
            dx = vehicles.position[b, other, 0] - vehicles.position[b, slot, 0]
            dy = vehicles.position[b, other, 1] - vehicles.position[b, slot, 1]
            reach = 0.5 * (
                math.hypot(vehicles.length[b, slot], vehicles.width[b, slot])
                + math.hypot(vehicles.length[b, other], vehicles.width[b, other])
            )
            reach += least + seconds * (abs(vehicles.speed[b, slot]) + abs(vehicles.speed[b, other]))
            if dx * dx + dy * dy > reach * reach:
                continue
            if _gap(vehicles, b, slot, other, 0.0) < least or _gap(vehicles, b, slot, other, seconds) < least:
                found[number] = True
                break


@kernel
def _gap(vehicles: VehicleStates, b: int, slot: int, other: int, seconds: float) -> float:
    """Return the gap between two footprints after some time of steady motion [m], below 0 if they overlap."""
    return max(
        box_gaps(
            _pose_after(vehicles, b, slot, seconds),
            0.5 * vehicles.length[b, slot],
            0.5 * vehicles.width[b, slot],
            _pose_after(vehicles, b, other, seconds),
            0.5 * vehicles.length[b, other],
            0.5 * vehicles.width[b, other],
        )
    )


@kernel
def _pose_after(vehicles: VehicleStates, b: int, slot: int, seconds: float) -> tuple[float, float, float]:
    """Return the pose of a vehicle that keeps its velocity and its yaw rate for some time [s]."""
    turn = seconds * vehicles.yaw_rate[b, slot]
    course = vehicles.heading[b, slot] + 0.5 * turn
    ahead, aside = seconds * vehicles.speed[b, slot], seconds * vehicles.lateral_speed[b, slot]
    return (
        vehicles.position[b, slot, 0] + ahead * math.cos(course) - aside * math.sin(course),
        vehicles.position[b, slot, 1] + ahead * math.sin(course) + aside * math.cos(course),
        vehicles.heading[b, slot] + turn,
    )


@kernel
def compare_with_chord(
    vehicles: VehicleStates,
    b: int,
    xy: Floats,
    s: Floats,
    slot: int,
    begin: int,
    end: int,
    front: float,
    offset: float,
    seconds: float,
) -> tuple[float, float]:
    """Return how far a vehicle's pose differs from that on a lane, now or after some time, whichever is more.

    Args:
        vehicles: Vehicles of B simulations.
        b: The simulation.
        xy: Points of lanes [m], shape (P, 2).
        s: Arc lengths of the points along their lanes [m], shape (P,).
        slot: The vehicle.
        begin: First point of its lane.
        end: One more than the lane's last point.
        front: Arc length of its front on the lane [m].
        offset: Offset of its front to the left of the lane [m].
        seconds: How long both poses drive on steadily [s].

    Returns:
        Differences of the heading [rad] and of the centre, across the lane [m].
    """
    turn, aside = 0.0, 0.0
    length, ahead = vehicles.length[b, slot], seconds * vehicles.speed[b, slot]
    for after, gone in ((0.0, 0.0), (seconds, ahead)):
        x, y, heading = _pose_after(vehicles, b, slot, after)
        x2, y2, heading2 = chord_pose(xy, s, begin, end, front + gone, length, offset)
        turn = max(turn, abs(wrapped(heading - heading2)))
        aside = max(aside, abs((y - y2) * math.cos(heading2) - (x - x2) * math.sin(heading2)))
    return turn, aside


@kernel
def chord_pose(
    xy: Floats, s: Floats, begin: int, end: int, front: float, length: float, offset: float
) -> tuple[float, float, float]:
    """Return x, y of the centre [m] and heading [rad] of a vehicle both of whose ends follow a line.

    So SUMO shows a vehicle on a lane.

    Args:
        xy: Points of lines [m], shape (P, 2).
        s: Arc lengths of the points along their lines [m], shape (P,).
        begin: First point of the line.
        end: One more than its last point.
        front: Arc length of the vehicle's front [m].
        length: Length of the vehicle [m].
        offset: Offset of the vehicle to the left of the line [m].
    """
    x, y = _beside(xy, s, begin, end, front, offset)
    back_x, back_y = _beside(xy, s, begin, end, front - length, offset)
    heading = math.atan2(y - back_y, x - back_x)
    return x - 0.5 * length * math.cos(heading), y - 0.5 * length * math.sin(heading), heading


@kernel
def _beside(
    xy: Floats, s: Floats, begin: int, end: int, station: float, offset: float
) -> tuple[float, float]:
    """Return the point at an offset to the left of a line; the line is extended straight."""
    point = begin
    while point < end - 2 and s[point + 1] < station:
        point += 1
    dx, dy = xy[point + 1, 0] - xy[point, 0], xy[point + 1, 1] - xy[point, 1]
    span = max(math.hypot(dx, dy), 1e-9)
    dx, dy, ahead = dx / span, dy / span, station - s[point]
    return xy[point, 0] + ahead * dx - offset * dy, xy[point, 1] + ahead * dy + offset * dx
