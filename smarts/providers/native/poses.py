"""Kernels that write vehicles' poses: both ends of a vehicle are on its lanes, as SUMO shows them."""

from __future__ import annotations

import math

from smarts.geometry.compiling import kernel
from smarts.geometry.segments import segment_at, wrapped
from smarts.providers.native.driving import desired_speed
from smarts.providers.native.occupancy import is_driven
from smarts.providers.native.planning import DURATION
from smarts.providers.native.state import TAILS, Demand, Traffic
from smarts.roads.kernels import centre_at, height_at


@kernel
def write_poses(n: Traffic, d: Demand, b: int, is_new: bool) -> None:
    """Write the engine's vehicles into their columns; without rates of turning if all are new."""
    for slot in range(n.state.vehicles.alive.shape[1]):
        if is_driven(n, b, slot):
            _write_pose(n, d, b, slot, is_new or n.driven.next_action[b, slot] == -math.inf)


@kernel
def _write_pose(n: Traffic, d: Demand, b: int, slot: int, is_new: bool) -> None:
    v, driven, roads = n.state.vehicles, n.driven, n.roads
    lane, front, length = d.ways.lane[driven.row[b, slot]], driven.front[b, slot], v.length[b, slot]
    x, y, along, height = _point(n, lane, front, driven.offset[b, slot])
    tail, back = lane, front - length
    for place in range(TAILS):
        behind = driven.tails[b, slot, place]
        if back >= 0.0 or behind < 0:
            break
        tail = behind
        back += n.lane_length[behind]
    back_x, back_y, _, back_height = _point(n, tail, back, driven.offset[b, slot])
    heading = math.atan2(y - back_y, x - back_x)
    if math.hypot(x - back_x, y - back_y) < 0.5 * length:
        heading = along
    turned = 0.0 if is_new else wrapped(heading - v.heading[b, slot])
    yaw_rate = turned / n.state.dt
    v.position[b, slot, 0] = x - 0.5 * length * math.cos(heading)
    v.position[b, slot, 1] = y - 0.5 * length * math.sin(heading)
    v.height[b, slot], v.heading[b, slot] = 0.5 * (height + back_height), heading
    v.yaw_acceleration[b, slot] = 0.0 if is_new else (yaw_rate - v.yaw_rate[b, slot]) / n.state.dt
    v.yaw_rate[b, slot] = yaw_rate
    v.lateral_acceleration[b, slot] = v.speed[b, slot] * yaw_rate
    v.lateral_speed[b, slot] = driven.side[b, slot] * roads.lane_width[lane] / DURATION
    v.desired_speed[b, slot] = desired_speed(n, d, b, slot, lane)


@kernel
def _point(n: Traffic, lane: int, s: float, offset: float) -> tuple[float, float, float, float]:
    """Return x, y [m], heading [rad] and height [m] of a place on a lane, some way to its left."""
    roads = n.roads
    point = segment_at(roads.point_s, roads.point_start[lane], roads.point_start[lane + 1], s)
    x, y, heading = centre_at(roads, point, s)
    return x - offset * math.sin(heading), y + offset * math.cos(heading), heading, height_at(roads, point, s)
