"""Kernels that copy between rows of the world and rows of the fleet."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Floats, Ints
from smarts.dynamics import Motion
from smarts.dynamics.free_motion import SLACK
from smarts.geometry.boxes import Mover, may_meet
from smarts.geometry.compiling import kernel
from smarts.geometry.rings import inside_rings
from smarts.geometry.segments import wrapped
from smarts.roads.levels import meets
from smarts.types.actions import CommandMode, Commands
from smarts.types.agent_states import AgentStatus
from smarts.types.tracks import Tracks
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State

FASTEST = 100.0
"""Maximum speed of vehicles that are commanded by poses [m/s]."""
STAYS = 1.0
"""Additional distance at which a box is removed from Bullet [m]: adding and removing costs as much as a
step."""

_ACTIVE, _LEAVING = int(AgentStatus.ACTIVE), int(AgentStatus.LEAVING)
_PLACE = int(CommandMode.PLACE)

NOWHERE = -1
BY_POSES = -2
"""Values of `FleetSlots.slot`: the agent's row of the fleet is empty; its vehicle is moved by poses."""


class AgentGroups(NamedTuple):
    """Agents grouped by how their vehicles move, shape (B, A)."""

    active: Bools
    """Agents that drive in this step."""
    by_poses: Bools
    """Active agents whose vehicles are placed by commands."""
    driven: Bools
    """Active agents whose vehicles are moved by the fleet."""
    in_bullet: Bools
    """Driven agents whose vehicles are in Bullet."""


class FleetSlots(NamedTuple):
    """The vehicle in each agent's row of the fleet, shape (B, A)."""

    slot: Ints
    """A slot, `NOWHERE` or `BY_POSES`."""
    generation: Ints
    """Generation of the vehicle in that slot."""
    target_slot: Ints
    """The slot that the row should hold in this step."""


class FrictionPatches(NamedTuple):
    """Friction patches on M maps, in CSR form."""

    usual: float
    """Friction outside patches."""
    start: Ints
    """CSR offsets of each map's patches, shape (M + 1,)."""
    patch: Floats
    """Rows (begin [s], end [s], friction), shape (P, 3)."""
    ring_start: Ints
    """CSR offsets of each patch's rings, shape (P + 1,)."""
    vertex_start: Ints
    """CSR offsets of each ring's vertices, shape (R + 1,)."""
    vertex: Floats
    """Vertices of all rings [m], shape (V, 2)."""


@kernel
def group_agents(
    state: State, is_bullet: Bools, groups: AgentGroups, commands: Commands, env_mask: Bools
) -> tuple[int, int]:
    """Group the agents by how their vehicles move; return the numbers of placed and of driven vehicles.

    Args:
        state: The state of the world.
        is_bullet: Whether each agent's vehicles use the model "bullet", shape (A,).
        groups: The groups, written.
        commands: Commands of the controllers.
        env_mask: The simulations to step, shape (B,).
    """
    placed = driven = 0
    for b in range(groups.active.shape[0]):
        for a in range(groups.active.shape[1]):
            is_active = env_mask[b] and state.agents.state[b, a] in (_ACTIVE, _LEAVING)
            is_placed = is_active and commands.mode[b, a] == _PLACE
            is_driven = is_active and not is_placed
            groups.active[b, a], groups.by_poses[b, a] = is_active, is_placed
            groups.driven[b, a], groups.in_bullet[b, a] = is_driven, is_driven and is_bullet[a]
            placed += is_placed
            driven += is_driven
    return placed, driven


@kernel
def find_changes(state: State, groups: AgentGroups, fleet_slots: FleetSlots, env_mask: Bools) -> bool:
    """Write the slot that each fleet row should hold; return whether any row changes its vehicle.

    Args:
        state: The state of the world.
        groups: The agents by group.
        fleet_slots: The fleet's vehicles; `target_slot` is written.
        env_mask: The simulations to step, shape (B,).
    """
    agents, slot, target_slot = state.agents, fleet_slots.slot, fleet_slots.target_slot
    any_change = False
    for b in range(slot.shape[0]):
        for a in range(slot.shape[1]):
            target_slot[b, a] = slot[b, a]
            if not env_mask[b]:
                continue
            if not groups.active[b, a]:
                target_slot[b, a] = NOWHERE
            elif groups.by_poses[b, a]:
                target_slot[b, a] = BY_POSES
            else:
                target_slot[b, a] = agents.slot[b, a]
                any_change = any_change or agents.generation[b, a] != fleet_slots.generation[b, a]
            any_change = any_change or target_slot[b, a] != slot[b, a]
    return any_change


@kernel
def write_motion(
    state: State, motion: Motion, controls: Floats, tracks: Tracks, groups: AgentGroups, ground: Floats
) -> bool:
    """Write the motion of the driven agents' vehicles into the world and into `tracks`.

    Args:
        state: The state of the world; the vehicles' motion and the agents' actuators and distances are
            written.
        motion: Motion of the fleet.
        controls: Throttle, brake, steering of the last sub-step, shape (E, 3).
        tracks: Poses are written.
        groups: The agents by group.
        ground: Height at which each vehicle of the fleet drives [m], shape (E,).

    Returns:
        Whether the road under one of them has another height.
    """
    vehicles, agents, poses = state.vehicles, state.agents, motion.substeps
    egos, last, is_lifted = groups.driven.shape[1], poses.shape[1] - 1, False
    for b in range(groups.driven.shape[0]):
        for a in range(egos):
            if not groups.driven[b, a]:
                continue
            e, v = b * egos + a, agents.slot[b, a]
            way = 0.0
            x, y = vehicles.position[b, v, 0], vehicles.position[b, v, 1]
            for substep in range(last + 1):
                way += math.hypot(poses[e, substep, 0] - x, poses[e, substep, 1] - y)
                x, y = poses[e, substep, 0], poses[e, substep, 1]
                for column in range(3):
                    tracks.poses[b, a, substep, column] = poses[e, substep, column]
            vehicles.position[b, v, 0], vehicles.position[b, v, 1] = x, y
            vehicles.heading[b, v] = poses[e, last, 2]
            vehicles.speed[b, v], vehicles.lateral_speed[b, v] = motion.velocity[e, 0], motion.velocity[e, 1]
            vehicles.acceleration[b, v] = motion.acceleration[e, 0]
            vehicles.lateral_acceleration[b, v] = motion.acceleration[e, 1]
            vehicles.yaw_acceleration[b, v] = (motion.yaw_rate[e] - vehicles.yaw_rate[b, v]) / state.dt
            vehicles.yaw_rate[b, v] = motion.yaw_rate[e]
            agents.throttle[b, a], agents.brake[b, a] = max(controls[e, 0], 0.0), controls[e, 1]
            agents.steering[b, a] = motion.steering[e]
            agents.distance_travelled[b, a] += way
            is_lifted |= vehicles.height[b, v] != ground[e]
    return is_lifted


@kernel
def place_vehicles(state: State, tracks: Tracks, groups: AgentGroups, commands: Commands) -> None:
    """Place vehicles at the poses of their commands, or on the straight line to these, limited by `FASTEST`.

    Args:
        state: The state of the world; the vehicles' motion and the agents' actuators and distances are
            written.
        tracks: Poses are written.
        groups: The agents by group.
        commands: The poses after each sub-step.
    """
    vehicles, agents, poses, dt = state.vehicles, state.agents, commands.poses, state.dt
    last = poses.shape[2] - 1
    for b in range(groups.by_poses.shape[0]):
        for a in range(groups.by_poses.shape[1]):
            if not groups.by_poses[b, a]:
                continue
            v = agents.slot[b, a]
            way, reach = 0.0, FASTEST * dt / (last + 1)
            x, y, now = vehicles.position[b, v, 0], vehicles.position[b, v, 1], poses[b, a, last, 3]
            turn = wrapped(poses[b, a, last, 2] - vehicles.heading[b, v])
            for substep in range(last + 1):
                pose = poses[b, a, substep]
                far = math.hypot(pose[0] - x, pose[1] - y)
                if far > reach:
                    # Move towards the pose at the maximum speed; continue in the next sub-steps.
                    x, y = x + reach / far * (pose[0] - x), y + reach / far * (pose[1] - y)
                    now = math.copysign(FASTEST, pose[3])
                else:
                    x, y = pose[0], pose[1]
                way += min(far, reach)
                tracks.poses[b, a, substep, 0], tracks.poses[b, a, substep, 1] = x, y
                tracks.poses[b, a, substep, 2] = pose[2]
            now = min(max(now, -FASTEST), FASTEST)
            vehicles.position[b, v, 0], vehicles.position[b, v, 1] = x, y
            vehicles.heading[b, v] = poses[b, a, last, 2]
            vehicles.acceleration[b, v] = (now - vehicles.speed[b, v]) / dt
            vehicles.speed[b, v], vehicles.lateral_speed[b, v] = now, 0.0
            vehicles.lateral_acceleration[b, v] = vehicles.speed[b, v] * turn / dt
            vehicles.yaw_acceleration[b, v] = (turn / dt - vehicles.yaw_rate[b, v]) / dt
            vehicles.yaw_rate[b, v] = turn / dt
            agents.throttle[b, a], agents.brake[b, a], agents.steering[b, a] = 0.0, 0.0, 0.0
            agents.distance_travelled[b, a] += way


@kernel
def find_touchable(state: State, motion: Motion, groups: AgentGroups, boxed: Bools, env_mask: Bools) -> bool:
    """Mark the road users outside Bullet that a vehicle in Bullet may touch in this step.

    Args:
        state: The state of the world.
        motion: Motion of the fleet.
        groups: The agents by group.
        boxed: Marks of the last step, overwritten, shape (B, V).
        env_mask: The simulations to step, shape (B,).

    Returns:
        Whether any road user is marked.
    """
    vehicles, slot, in_bullet = state.vehicles, state.agents.slot, groups.in_bullet
    any_found = False
    for b in np.flatnonzero(env_mask):
        count = _end_of(in_bullet[b])
        for v in range(state.used[b]):
            slack = SLACK + (STAYS if boxed[b, v] else 0.0)
            boxed[b, v] = False
            is_other = vehicles.alive[b, v]
            for a in range(count):
                if in_bullet[b, a] and slot[b, a] == v:
                    is_other = False
            if not is_other:
                continue
            for a in range(count):
                if not in_bullet[b, a]:
                    continue
                within = slack + motion.overhang[b * slot.shape[1] + a]
                if _may_touch(vehicles, b, v, slot[b, a], state.dt, within):
                    boxed[b, v] = any_found = True
                    break
    return any_found


@kernel
def _end_of(chosen: Bools) -> int:
    """Return one more than the last chosen index, 0 without one: the columns behind it are mostly vacant."""
    for a in range(len(chosen) - 1, -1, -1):
        if chosen[a]:
            return a + 1
    return 0


@kernel
def _may_touch(vehicles: VehicleStates, b: int, v: int, other: int, dt: float, slack: float) -> bool:
    """Return whether two vehicles may touch within a step, as `may_meet` does."""
    dx = vehicles.position[b, other, 0] - vehicles.position[b, v, 0]
    dy = vehicles.position[b, other, 1] - vehicles.position[b, v, 1]
    farthest = slack + _reach(vehicles, b, v, dt) + _reach(vehicles, b, other, dt)
    # Nearly all are far away, and this bound needs no sines.
    if dx * dx + dy * dy > farthest * farthest or not meets(vehicles, b, other, v):
        return False
    return may_meet(_mover(vehicles, b, v), _mover(vehicles, b, other), dt, slack)


@kernel
def _reach(vehicles: VehicleStates, b: int, v: int, dt: float) -> float:
    """Return a bound on how far from its centre any part of a vehicle comes within a step [m]."""
    size = 0.5 * (vehicles.length[b, v] + vehicles.width[b, v])
    return size + dt * (abs(vehicles.speed[b, v]) + abs(vehicles.lateral_speed[b, v]))


@kernel
def _mover(vehicles: VehicleStates, b: int, v: int) -> Mover:
    """Return a vehicle's moving footprint."""
    cos, sin = math.cos(vehicles.heading[b, v]), math.sin(vehicles.heading[b, v])
    forward, aside = vehicles.speed[b, v], vehicles.lateral_speed[b, v]
    velocity = forward * cos - aside * sin, forward * sin + aside * cos
    pose = vehicles.position[b, v, 0], vehicles.position[b, v, 1], vehicles.heading[b, v]
    size = 0.5 * vehicles.length[b, v], 0.5 * vehicles.width[b, v]
    return pose, size[0], size[1], velocity[0], velocity[1], vehicles.yaw_rate[b, v]


@kernel
def look_up_friction(
    state: State, patches: FrictionPatches, driven: Bools, wheels: Floats, friction: Floats
) -> None:
    """Write the friction under each wheel of the driven vehicles.

    Args:
        state: The state of the world.
        patches: Patches of all maps.
        driven: Agents whose vehicles are in the fleet, shape (B, A).
        wheels: Positions of the wheels [m], shape (E, 4, 2).
        friction: Friction at each wheel, written, shape (E, 4).
    """
    egos = driven.shape[1]
    for b in range(driven.shape[0]):
        time, map_id = state.step[b] * state.dt, state.map[b]
        for a in range(egos):
            if not driven[b, a]:
                continue
            for wheel in range(4):
                x, y = wheels[b * egos + a, wheel, 0], wheels[b * egos + a, wheel, 1]
                found = patches.usual
                for p in range(patches.start[map_id], patches.start[map_id + 1]):
                    is_now = patches.patch[p, 0] <= time < patches.patch[p, 1]
                    first, last = patches.ring_start[p], patches.ring_start[p + 1]
                    if is_now and inside_rings(x, y, patches.vertex, patches.vertex_start, first, last):
                        found = patches.patch[p, 2]
                friction[b * egos + a, wheel] = found
