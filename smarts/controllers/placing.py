"""Kernels that plan and follow a motion between two poses, a cubic or a straight line."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Bools, Floats
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import interpolate_angle, wrapped_half_open
from smarts.types.actions import Actions, CommandMode, Commands
from smarts.types.world import State

BEGIN, TARGET, TIME, STEP, PLAN = 0, 4, 8, 9, 10
"""Columns of a plan: begin and target (each x, y [m], heading [rad], speed [m/s]), time [s], first step; and
their number."""

_PLACE = int(CommandMode.PLACE)
_SLOWEST = 0.05
"""Below this speed, the heading is interpolated instead of taken from the motion [m/s]."""


@kernel
def make_plan(
    x: float, y: float, heading: float, speed: float, target: Floats, step: int, plan: Floats
) -> None:
    """Write the cubic plan from a pose and speed to `target`: x, y [m], heading [rad], time [s].

    The final speed is the plan's mean speed, so that successive plans of equal length and time keep a
    constant speed. (With the final speed of constant acceleration, each plan would over-correct the one
    before.) The initial speed is at most three times the mean: beyond that, a cubic overshoots its end
    (Fritsch and Carlson, Monotone piecewise cubic interpolation, 1980).
    """
    time = target[3]
    plan[0], plan[1], plan[2], plan[3] = x, y, heading, speed
    plan[4], plan[5], plan[6] = target[0], target[1], wrapped_half_open(target[2])
    mean = math.hypot(target[0] - x, target[1] - y) / time
    plan[3], plan[7] = min(speed, 3.0 * mean), mean
    plan[8], plan[9] = time, step


@kernel
def make_straight_plan(
    x: float, y: float, heading: float, change: Floats, time: float, step: int, plan: Floats
) -> None:
    """Write the plan that moves a pose by `change` (x, y [m], heading [rad]) at constant speed, then stops.

    The speed is the longitudinal component at the mean heading; it is negative backwards.
    """
    plan[0], plan[1], plan[2] = x, y, wrapped_half_open(heading)
    plan[4], plan[5], plan[6] = x + change[0], y + change[1], wrapped_half_open(heading + change[2])
    between = interpolate_angle(plan[2], plan[6], 0.5)
    plan[3] = (change[0] * math.cos(between) + change[1] * math.sin(between)) / time
    plan[7], plan[8], plan[9] = 0.0, time, step


@kernel
def follow_straight_plan(plan: Floats, step: int, dt: float, poses: Floats) -> None:
    """Write x, y, heading, speed of a straight plan at the end of each sub-step, shape (S, 4).

    After the plan's end the vehicle stands still.
    """
    substeps = len(poses)
    for k in range(substeps):
        now = (step - plan[STEP]) * dt + (k + 1) * dt / substeps
        is_over = now > plan[TIME] + 1e-9
        u = min(now / plan[TIME], 1.0)
        for axis in range(2):
            begin, end = plan[BEGIN + axis], plan[TARGET + axis]
            poses[k, axis] = end if u == 1.0 else begin + u * (end - begin)
        poses[k, 2] = interpolate_angle(plan[BEGIN + 2], plan[TARGET + 2], u)
        poses[k, 3] = 0.0 if is_over else plan[BEGIN + 3]


@kernel
def follow_plan(plan: Floats, step: int, dt: float, poses: Floats) -> None:
    """Write x, y, heading, speed of a cubic plan at the end of each sub-step, shape (S, 4).

    After the plan's end the vehicle continues straight.
    """
    substeps = len(poses)
    for k in range(substeps):
        now = (step - plan[STEP]) * dt + (k + 1) * dt / substeps
        _pose_at(plan, now, poses[k])


@kernel
def _pose_at(plan: Floats, now: float, pose: Floats) -> None:
    """Write x, y, heading, speed of a cubic plan at time `now` [s] since its beginning."""
    time = plan[TIME]
    if now >= time - 1e-9:
        way = (now - time) * plan[TARGET + 3]
        heading = plan[TARGET + 2]
        pose[0] = plan[TARGET] + way * math.cos(heading)
        pose[1] = plan[TARGET + 1] + way * math.sin(heading)
        pose[2], pose[3] = heading, plan[TARGET + 3]
        return
    u = now / time
    rate_x, rate_y = 0.0, 0.0
    for axis in range(2):
        begin, end = plan[BEGIN + axis], plan[TARGET + axis]
        out = _component(plan[BEGIN + 2], axis) * plan[BEGIN + 3] * time
        into = _component(plan[TARGET + 2], axis) * plan[TARGET + 3] * time
        pose[axis] = (
            (2.0 * u**3 - 3.0 * u**2 + 1.0) * begin
            + (u**3 - 2.0 * u**2 + u) * out
            + (3.0 * u**2 - 2.0 * u**3) * end
            + (u**3 - u**2) * into
        )
        rate = (
            (6.0 * u**2 - 6.0 * u) * (begin - end)
            + (3.0 * u**2 - 4.0 * u + 1.0) * out
            + (3.0 * u**2 - 2.0 * u) * into
        ) / time
        if axis == 0:
            rate_x = rate
        else:
            rate_y = rate
    speed = math.hypot(rate_x, rate_y)
    between = interpolate_angle(plan[BEGIN + 2], plan[TARGET + 2], u)
    heading = wrapped_half_open(math.atan2(rate_y, rate_x)) if speed > _SLOWEST else between
    if math.cos(heading - between) < 0.0:
        # The vehicle moves backwards; its heading is not reversed.
        heading, speed = wrapped_half_open(heading + math.pi), -speed
    pose[2], pose[3] = heading, speed


@kernel
def _component(heading: float, axis: int) -> float:
    return math.cos(heading) if axis == 0 else math.sin(heading)


@kernel
def place_by_targets(
    state: State, relative: bool, plans: Floats, actions: Actions, commands: Commands, chosen: Bools
) -> None:
    """Write the poses of chosen agents' vehicles on their way to their targets.

    Args:
        state: The state of the world.
        relative: Whether targets are changes of the current pose, to be reached at the agent's next decision.
        plans: Plans of all agents, written for fresh actions, shape (B, A, PLAN).
        actions: Targets of all agents.
        commands: Mode and poses are written.
        chosen: The agents, shape (B, A).
    """
    vehicles = state.vehicles
    target = np.empty(4)
    for b in range(chosen.shape[0]):
        for a in range(chosen.shape[1]):
            if not chosen[b, a]:
                continue
            commands.mode[b, a] = _PLACE
            plan, v = plans[b, a], state.agents.slot[b, a]
            x, y = vehicles.position[b, v, 0], vehicles.position[b, v, 1]
            if actions.fresh[b, a] and relative:
                time = state.dt * max(state.agents.period[b, a], 1)
                make_straight_plan(
                    x, y, vehicles.heading[b, v], actions.values[b, a, :3], time, state.step[b], plan
                )
            elif actions.fresh[b, a]:
                for i in range(4):
                    target[i] = actions.values[b, a, i]
                target[3] = max(target[3], state.dt)
                make_plan(x, y, vehicles.heading[b, v], vehicles.speed[b, v], target, state.step[b], plan)
            if relative:
                follow_straight_plan(plan, state.step[b], state.dt, commands.poses[b, a])
            else:
                follow_plan(plan, state.step[b], state.dt, commands.poses[b, a])
