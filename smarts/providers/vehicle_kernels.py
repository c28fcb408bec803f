"""Compiled: between the rows of the world and the rows of the fleet."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.dynamics.free_motion import SLACK
from smarts.geometry.boxes import Mover, may_meet
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import inside_outline, wrapped
from smarts.types.actions import CommandMode
from smarts.types.agent_states import AgentStatus

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]

FASTEST = 100.0
"""What a vehicle that is commanded by poses drives at most [m/s]: farther poses are not jumped to."""
STAYS = 1.0
"""Who could be touched remains in Bullet until it is this much farther away [m]: to come and go costs as
much as a step."""

_ACTIVE, _PLACE = int(AgentStatus.ACTIVE), int(CommandMode.PLACE)

NOWHERE = -1
BY_POSES = -2
"""Of the slot that an agent's row of the fleet is for: it holds no vehicle, or one that goes by poses."""


class AgentGroups(NamedTuple):
    """Which agents' vehicles are moved how, shape (B, A)."""

    active: Bools
    """AgentStates that drive in this step."""
    by_poses: Bools
    """Those of them whose vehicle is put where the commands say."""
    driven: Bools
    """Those of them whose vehicle the fleet moves."""
    in_bullet: Bools
    """Those of these whose vehicle is in Bullet."""


@kernel
def part_agents(
    state: NDArray[np.int8], is_bullet: Bools, groups: AgentGroups, mode: NDArray[np.int8], env_mask: Bools
) -> tuple[int, int]:
    """Part the agents by how their vehicles are moved; return how many go by poses, how many are driven.

    Args:
        state: A `AgentStatus`, shape (B, A).
        is_bullet: Whether the agent's vehicles are modelled in Bullet, shape (A,).
        groups: Written.
        mode: A `CommandMode`, shape (B, A).
        env_mask: Shape (B,).
    """
    placed = driven = 0
    for b in range(state.shape[0]):
        for a in range(state.shape[1]):
            is_active = env_mask[b] and state[b, a] == _ACTIVE
            is_placed = is_active and mode[b, a] == _PLACE
            is_driven = is_active and not is_placed
            groups.active[b, a], groups.by_poses[b, a] = is_active, is_placed
            groups.driven[b, a], groups.in_bullet[b, a] = is_driven, is_driven and is_bullet[a]
            placed += is_placed
            driven += is_driven
    return placed, driven


@kernel
def find_changes(
    slot: Ints,
    generation: Ints,
    held_slot: Ints,
    held_generation: Ints,
    wanted: Ints,
    active: Bools,
    by_poses: Bools,
    env_mask: Bools,
) -> bool:
    """Write which slot each agent's row of the fleet is to be for; tell if any is for another vehicle now.

    Args:
        slot: Of the agents' vehicles, shape (B, A), as are the following.
        generation: Of the agents' vehicles.
        held_slot: What the fleet holds, a slot, `NOWHERE` or `BY_POSES`.
        held_generation: Of that vehicle.
        wanted: Written; what the fleet is to hold.
        active: AgentStates that drive.
        by_poses: Those of them that are told their poses.
        env_mask: Shape (B,).
    """
    any_change = False
    for b in range(active.shape[0]):
        for a in range(active.shape[1]):
            wanted[b, a] = held_slot[b, a]
            if not env_mask[b]:
                continue
            if not active[b, a]:
                wanted[b, a] = NOWHERE
            elif by_poses[b, a]:
                wanted[b, a] = BY_POSES
            else:
                wanted[b, a] = slot[b, a]
                any_change = any_change or generation[b, a] != held_generation[b, a]
            any_change = any_change or wanted[b, a] != held_slot[b, a]
    return any_change


@kernel
def show_vehicles(
    slot: Ints,
    poses: Floats,
    velocity: Floats,
    yaw_rate: Floats,
    acceleration: Floats,
    steering: Floats,
    controls: Floats,
    dt: float,
    tracks: Floats,
    columns: tuple[Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats],
    agents: tuple[Floats, Floats, Floats, Floats],
    driven: Bools,
) -> None:
    """Write the motion of the driven agents' vehicles into their rows of the world.

    Args:
        slot: Shape (B, A).
        poses: Of the fleet, shape (E, S, 3).
        velocity: Forward and left [m/s], shape (E, 2).
        yaw_rate: [rad/s], shape (E,).
        acceleration: Forward and left [m/s^2], shape (E, 2).
        steering: [rad], shape (E,).
        controls: Throttle, brake, steering of the last sub-step, shape (E, 3).
        dt: Step [s].
        tracks: Written, shape (B, A, S, 3).
        columns: Written: position, heading, speed, lateral_speed, acceleration, lateral_acceleration,
            yaw_rate, yaw_acceleration of the world, shape (B, V).
        agents: Written: throttle, brake, steering, travelled, shape (B, A).
        driven: AgentStates whose vehicle the fleet moves, shape (B, A).
    """
    position, heading, speed, lateral_speed, forward_acc, lateral_acc, yaw_rates, yaw_acc = columns
    throttle, brake, angle, distance_travelled = agents
    egos, last = driven.shape[1], poses.shape[1] - 1
    for b in range(driven.shape[0]):
        for a in range(egos):
            if not driven[b, a]:
                continue
            e, v = b * egos + a, slot[b, a]
            way = 0.0
            x, y = position[b, v, 0], position[b, v, 1]
            for substep in range(last + 1):
                way += math.hypot(poses[e, substep, 0] - x, poses[e, substep, 1] - y)
                x, y = poses[e, substep, 0], poses[e, substep, 1]
                for column in range(3):
                    tracks[b, a, substep, column] = poses[e, substep, column]
            position[b, v, 0], position[b, v, 1] = x, y
            heading[b, v] = poses[e, last, 2]
            speed[b, v], lateral_speed[b, v] = velocity[e, 0], velocity[e, 1]
            forward_acc[b, v], lateral_acc[b, v] = acceleration[e, 0], acceleration[e, 1]
            yaw_acc[b, v] = (yaw_rate[e] - yaw_rates[b, v]) / dt
            yaw_rates[b, v] = yaw_rate[e]
            throttle[b, a], brake[b, a] = max(controls[e, 0], 0.0), controls[e, 1]
            angle[b, a] = steering[e]
            distance_travelled[b, a] += way


@kernel
def place_vehicles(
    slot: Ints,
    dt: float,
    tracks: Floats,
    columns: tuple[Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats],
    agents: tuple[Floats, Floats, Floats, Floats],
    placed: Bools,
    poses: Floats,
) -> None:
    """Put vehicles where their commands say, or on the straight way there as far as `FASTEST` takes them.

    Args:
        slot: Shape (B, A).
        dt: Step [s].
        tracks: See `show_vehicles`, as are the others.
        columns: Written.
        agents: Written.
        placed: Shape (B, A).
        poses: x, y [m], heading [rad], speed [m/s] after each sub-step, shape (B, A, S, 4).
    """
    position, heading, speed, lateral_speed, forward_acc, lateral_acc, yaw_rates, yaw_acc = columns
    throttle, brake, angle, distance_travelled = agents
    agents_each, last = placed.shape[1], poses.shape[2] - 1
    for b in range(placed.shape[0]):
        for a in range(agents_each):
            if not placed[b, a]:
                continue
            v = slot[b, a]
            way, reach = 0.0, FASTEST * dt / (last + 1)
            x, y, now = position[b, v, 0], position[b, v, 1], poses[b, a, last, 3]
            turn = wrapped(poses[b, a, last, 2] - heading[b, v])
            for substep in range(last + 1):
                pose = poses[b, a, substep]
                far = math.hypot(pose[0] - x, pose[1] - y)
                if far > reach:
                    # There as fast as it may, and on in the next steps.
                    x, y = x + reach / far * (pose[0] - x), y + reach / far * (pose[1] - y)
                    now = math.copysign(FASTEST, pose[3])
                else:
                    x, y = pose[0], pose[1]
                way += min(far, reach)
                tracks[b, a, substep, 0], tracks[b, a, substep, 1] = x, y
                tracks[b, a, substep, 2] = pose[2]
            now = min(max(now, -FASTEST), FASTEST)
            position[b, v, 0], position[b, v, 1] = x, y
            heading[b, v] = poses[b, a, last, 2]
            forward_acc[b, v] = (now - speed[b, v]) / dt
            speed[b, v], lateral_speed[b, v] = now, 0.0
            lateral_acc[b, v] = speed[b, v] * turn / dt
            yaw_acc[b, v] = (turn / dt - yaw_rates[b, v]) / dt
            yaw_rates[b, v] = turn / dt
            throttle[b, a], brake[b, a], angle[b, a] = 0.0, 0.0, 0.0
            distance_travelled[b, a] += way


@kernel
def find_touchable(
    slot: Ints,
    alive: Bools,
    position: Floats,
    heading: Floats,
    speed: Floats,
    lateral_speed: Floats,
    yaw_rate: Floats,
    length: Floats,
    width: Floats,
    overhang: Floats,
    dt: float,
    boxed: Bools,
    in_bullet: Bools,
    env_mask: Bools,
) -> bool:
    """Write which road users that are not in Bullet a vehicle in there may touch in this step; tell if any.

    Args:
        slot: Shape (B, A).
        alive: Shape (B, V), as are the following.
        position: [m], shape (B, V, 2).
        heading: [rad]
        speed: [m/s]
        lateral_speed: [m/s]
        yaw_rate: [rad/s]
        length: [m]
        width: [m]
        overhang: How far the bodies of the agents' vehicles may reach beyond their footprints [m], shape (B *
            A,).
        dt: Length of the step [s].
        boxed: Whether it could be touched in the step before; written.
        in_bullet: AgentStates whose vehicle is in Bullet, shape (B, A).
        env_mask: Shape (B,).
    """
    any_found = False
    for b in range(env_mask.shape[0]):
        if not env_mask[b]:
            continue
        for v in range(alive.shape[1]):
            slack = SLACK + (STAYS if boxed[b, v] else 0.0)
            boxed[b, v] = False
            is_other = alive[b, v]
            for a in range(slot.shape[1]):
                if in_bullet[b, a] and slot[b, a] == v:
                    is_other = False
            if not is_other:
                continue
            columns = position[b], heading[b], speed[b], lateral_speed[b], yaw_rate[b], length[b], width[b]
            one = _mover(columns, v)
            for a in range(slot.shape[1]):
                if not in_bullet[b, a]:
                    continue
                within = slack + overhang[b * slot.shape[1] + a]
                if may_meet(one, _mover(columns, slot[b, a]), dt, within):
                    boxed[b, v] = any_found = True
                    break
    return any_found


@kernel
def _mover(columns: tuple[Floats, ...], v: int) -> Mover:
    """Return a vehicle's footprint under way."""
    position, heading, speed, lateral_speed, yaw_rate, length, width = columns
    cos, sin = math.cos(heading[v]), math.sin(heading[v])
    velocity = speed[v] * cos - lateral_speed[v] * sin, speed[v] * sin + lateral_speed[v] * cos
    pose = position[v, 0], position[v, 1], heading[v]
    return pose, 0.5 * length[v], 0.5 * width[v], velocity[0], velocity[1], yaw_rate[v]


@kernel
def look_up_friction(
    driven: Bools,
    maps: Ints,
    step: Ints,
    dt: float,
    wheels: Floats,
    usual: float,
    patch_start: Ints,
    patch: Floats,
    ring_start: Ints,
    vertex_start: Ints,
    vertex: Floats,
    friction: Floats,
) -> None:
    """Write the friction under each wheel of the driven vehicles, shape (E, 4).

    Args:
        driven: Shape (B, A).
        maps: Map of each simulation, shape (B,).
        step: Of each episode, shape (B,).
        dt: [s]
        wheels: Where the wheels stand [m], shape (E, 4, 2).
        usual: Where there is no patch.
        patch_start: CSR of the patches of each map, shape (M + 1,).
        patch: Rows (begin [s], end [s], friction).
        ring_start: CSR of each patch's rings; a point in an odd number of them is in the patch.
        vertex_start: CSR of the rings' vertices.
        vertex: [m]
        friction: Written.
    """
    egos = driven.shape[1]
    for b in range(driven.shape[0]):
        time = step[b] * dt
        for a in range(egos):
            if not driven[b, a]:
                continue
            for wheel in range(4):
                x, y = wheels[b * egos + a, wheel, 0], wheels[b * egos + a, wheel, 1]
                found = usual
                for p in range(patch_start[maps[b]], patch_start[maps[b] + 1]):
                    if not patch[p, 0] <= time < patch[p, 1]:
                        continue
                    inside = False
                    for ring in range(ring_start[p], ring_start[p + 1]):
                        if inside_outline(x, y, vertex, vertex_start[ring], vertex_start[ring + 1]):
                            inside = not inside
                    if inside:
                        found = patch[p, 2]
                friction[b * egos + a, wheel] = found
