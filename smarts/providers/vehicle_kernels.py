"""Compiled: between the rows of the world and the rows of the fleet."""

from __future__ import annotations

import math
from typing import NamedTuple

from smarts.arrays import Bools, Floats, Ints
from smarts.dynamics import Motion
from smarts.dynamics.free_motion import SLACK
from smarts.geometry.boxes import Mover, may_meet
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import inside_outline, wrapped
from smarts.types.actions import CommandMode, Commands
from smarts.types.agent_states import AgentStatus
from smarts.types.tracks import Tracks
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State

FASTEST = 100.0
"""Largest speed of a vehicle commanded by poses [m/s]; it does not jump to farther poses."""
STAYS = 1.0
"""A vehicle that could be touched stays in Bullet until it is this much farther away [m]: to come and go
costs as much as a step."""

_ACTIVE, _PLACE = int(AgentStatus.ACTIVE), int(CommandMode.PLACE)

NOWHERE = -1
BY_POSES = -2
"""Slot of a fleet row that holds no vehicle, or one commanded by poses."""


class AgentGroups(NamedTuple):
    """Groups of agents by how their vehicles are moved, shape (B, A)."""

    active: Bools
    """Agents that drive in this step."""
    by_poses: Bools
    """Agents whose vehicle is placed by commanded poses."""
    driven: Bools
    """Agents whose vehicle the fleet moves."""
    in_bullet: Bools
    """Agents whose vehicle is in Bullet."""


class HeldVehicles(NamedTuple):
    """The vehicle of each agent's fleet row, shape (B, A)."""

    slot: Ints
    """A slot, `NOWHERE` or `BY_POSES`."""
    generation: Ints
    """Of the vehicle in that slot."""
    target_slot: Ints
    """The slot that the row is to be for in this step."""


class FrictionPatches(NamedTuple):
    """Patches of the road with a friction of their own, on M maps."""

    usual: float
    """Friction where no patch is."""
    start: Ints
    """CSR of the patches of each map, shape (M + 1,)."""
    patch: Floats
    """Rows (begin [s], end [s], friction)."""
    ring_start: Ints
    """CSR of each patch's rings."""
    vertex_start: Ints
    """CSR of the rings' vertices."""
    vertex: Floats
    """[m], shape (., 2)."""


@kernel
def group_agents(
    state: State, is_bullet: Bools, groups: AgentGroups, commands: Commands, env_mask: Bools
) -> tuple[int, int]:
    """Group the agents by how their vehicles move; return how many go by poses, how many are driven.

    Args:
        state: Of the world.
        is_bullet: Whether the agent's vehicles are modelled in Bullet, shape (A,).
        groups: Written.
        commands: Of the controllers.
        env_mask: Which simulations make the step, shape (B,).
    """
    placed = driven = 0
    for b in range(groups.active.shape[0]):
        for a in range(groups.active.shape[1]):
            is_active = env_mask[b] and state.agents.state[b, a] == _ACTIVE
            is_placed = is_active and commands.mode[b, a] == _PLACE
            is_driven = is_active and not is_placed
            groups.active[b, a], groups.by_poses[b, a] = is_active, is_placed
            groups.driven[b, a], groups.in_bullet[b, a] = is_driven, is_driven and is_bullet[a]
            placed += is_placed
            driven += is_driven
    return placed, driven


@kernel
def find_changes(state: State, groups: AgentGroups, held: HeldVehicles, env_mask: Bools) -> bool:
    """Write the slot that each fleet row should hold; return whether any row changes its vehicle.

    Args:
        state: Of the world.
        groups: Of the agents.
        held: `target_slot` is written.
        env_mask: Which simulations make the step, shape (B,).
    """
    agents, slot, target_slot = state.agents, held.slot, held.target_slot
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
                any_change = any_change or agents.generation[b, a] != held.generation[b, a]
            any_change = any_change or target_slot[b, a] != slot[b, a]
    return any_change


@kernel
def show_vehicles(
    state: State, motion: Motion, controls: Floats, tracks: Tracks, groups: AgentGroups
) -> None:
    """Write the motion of the driven agents' vehicles into their rows of the world, and their tracks.

    Args:
        state: Of the world; motion of vehicles, actuators and distance of agents are written.
        motion: Of the fleet.
        controls: Throttle, brake, steering of the last sub-step, shape (E, 3).
        tracks: The poses are written.
        groups: Of the agents.
    """
    vehicles, agents, poses = state.vehicles, state.agents, motion.substeps
    egos, last = groups.driven.shape[1], poses.shape[1] - 1
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


@kernel
def place_vehicles(state: State, tracks: Tracks, groups: AgentGroups, commands: Commands) -> None:
    """Put vehicles where their commands say, or on the straight way there as far as `FASTEST` takes them.

    Args:
        state: Of the world; motion of vehicles, actuators and distance of agents are written.
        tracks: The poses are written.
        groups: Of the agents.
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
                    # There as fast as it may, and on in the next steps.
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
    """Mark the road users outside Bullet that a Bullet vehicle may touch in this step; return whether any is.

    Args:
        state: Of the world.
        motion: Of the fleet.
        groups: Of the agents.
        boxed: Whether the vehicle could be touched in the step before, shape (B, V); written.
        env_mask: Which simulations make the step, shape (B,).
    """
    vehicles, slot, in_bullet = state.vehicles, state.agents.slot, groups.in_bullet
    any_found = False
    for b in range(env_mask.shape[0]):
        if not env_mask[b]:
            continue
        count = _end_of(in_bullet[b])
        for v in range(vehicles.alive.shape[1]):
            slack = SLACK + (STAYS if boxed[b, v] else 0.0)
            boxed[b, v] = False
            is_other = vehicles.alive[b, v]
            for a in range(count):
                if in_bullet[b, a] and slot[b, a] == v:
                    is_other = False
            if not is_other:
                continue
            one = _mover(vehicles, b, v)
            for a in range(count):
                if not in_bullet[b, a]:
                    continue
                within = slack + motion.overhang[b * slot.shape[1] + a]
                if may_meet(one, _mover(vehicles, b, slot[b, a]), state.dt, within):
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
def _mover(vehicles: VehicleStates, b: int, v: int) -> Mover:
    """Return a vehicle's footprint under way."""
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
        state: Of the world.
        patches: Of all maps.
        driven: Which agents' vehicles, shape (B, A).
        wheels: Where the wheels stand [m], shape (E, 4, 2).
        friction: Written, shape (E, 4).
    """
    egos = driven.shape[1]
    for b in range(driven.shape[0]):
        time, world = state.step[b] * state.dt, state.map[b]
        for a in range(egos):
            if not driven[b, a]:
                continue
            for wheel in range(4):
                x, y = wheels[b * egos + a, wheel, 0], wheels[b * egos + a, wheel, 1]
                found = patches.usual
                for p in range(patches.start[world], patches.start[world + 1]):
                    if patches.patch[p, 0] <= time < patches.patch[p, 1] and _is_inside(patches, p, x, y):
                        found = patches.patch[p, 2]
                friction[b * egos + a, wheel] = found


@kernel
def _is_inside(patches: FrictionPatches, patch: int, x: float, y: float) -> bool:
    """Return whether a point is in an odd number of a patch's rings."""
    inside = False
    for ring in range(patches.ring_start[patch], patches.ring_start[patch + 1]):
        if inside_outline(x, y, patches.vertex, patches.vertex_start[ring], patches.vertex_start[ring + 1]):
            inside = not inside
    return inside
