"""Contacts: vehicles that touch within a step, by their footprints, and by their bodies in Bullet."""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Bools, Floats, Ints
from smarts.geometry.binding import LateBound, bind
from smarts.geometry.boxes import Pose, box_gaps, contact_direction, facing
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import interpolate_angle, wrapped
from smarts.roads.levels import meets
from smarts.sim.places import was_there
from smarts.sim.traffic_overlaps import count_overlaps
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Contacts
from smarts.types.tracks import Tracks
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State, World

FRONT, LEFT, REAR, RIGHT = range(4)

HalfSize = tuple[float, float]
"""Half the length and half the width of a footprint [m]."""

SHORTEST_LOOK = 1 / 64
"""Overlaps that last a shorter part of a sub-step may go unseen: 1 cm of the way at 60 m/s."""

_ACTIVE = int(AgentStatus.ACTIVE)
_SHADOWING = int(AgentStatus.SHADOWING)
_LEAVING = int(AgentStatus.LEAVING)


class FootprintContacts:
    """Finds contacts between oriented boxes by the separating-axis theorem, at and between ends of sub-steps.

    Vehicles that Bullet has kept apart touch, too, although their footprints may never overlap: a car that
    brakes dives, a bus in a bend rolls, and their bodies then reach beyond their footprints.

    Vehicles that agents drive are where their tracks say, and move evenly in between. All others move evenly
    from their pose a step ago to their pose now, and turn the shorter way; those that have just come stand
    where they are. So vehicles that pass through each other within a step, or a corner within a sub-step,
    are found, too.
    """

    def __init__(self, world: World) -> None:
        worlds, agents = world.agents.slot.shape
        self.contacts = Contacts.allocate(worlds, agents, world.vehicles.capacity)
        self._find = LateBound(find_contacts, world.state, self.contacts)
        self._count_overlaps = bind(count_overlaps, world.state, world.traffic_overlaps)

    def find(self, tracks: Tracks, env_mask: Bools) -> Contacts:
        """Return the first contact of each agent's vehicle during the step; count overlaps among traffic.

        Args:
            tracks: How the agents' vehicles have moved. Where they have not yet, only the present counts.
            env_mask: Which simulations made the step, shape (B,).
        """
        self._find.to(tracks)(env_mask)
        self._count_overlaps(env_mask)
        return self.contacts


@kernel
def find_contacts(state: State, out: Contacts, tracks: Tracks, env_mask: Bools) -> None:
    """Write the contacts of all agents; agents of simulations that made no step have none.

    Args:
        state: State of the world.
        out: Written.
        tracks: How the agents' vehicles have moved; without sub-steps at a reset.
        env_mask: Which simulations made the step, shape (B,).
    """
    # Arrays by themselves: to take one out of a tuple costs more than to read from it.
    now, before, agents, poses = state.vehicles, state.before, state.agents, tracks.poses
    position, length, width = now.position, now.length, now.width
    status, slots, touching, partner = agents.state, agents.slot, out.touching, out.partner
    capacity, substeps = position.shape[1], max(1, poses.shape[2])
    near, reach = np.empty(capacity, np.int32), np.empty(capacity)
    agent_id_of = np.empty(capacity, np.int32)
    path, path2 = np.empty((substeps + 1, 3)), np.empty((substeps + 1, 3))
    partner[:] = -1
    out.partner_generation[:] = 0
    out.substep[:] = 0
    out.closing_speed[:] = 0.0
    out.side[:] = 0
    touching[:] = False
    for row in np.flatnonzero(env_mask):
        alive = _survey(state, poses, row, near, reach, agent_id_of)
        for agent_id in range(status.shape[1]):
            slot = slots[row, agent_id]
            if slot < 0 or status[row, agent_id] not in (_ACTIVE, _SHADOWING, _LEAVING):
                continue
            _follow(now, before, poses, row, slot, agent_id_of[slot], path)
            first = np.inf
            for number in range(alive):
                other = near[number]
                dx = position[row, other, 0] - position[row, slot, 0]
                dy = position[row, other, 1] - position[row, slot, 1]
                far = reach[slot] + reach[other]
                is_touched = tracks.touched[row, agent_id, other] != 0
                if not is_touched and dx * dx + dy * dy > far * far:
                    continue
                held, held_speed = _held_apart(now, before, tracks, row, agent_id, other)
                if not meets(now, row, slot, other) or (held < 0 and dx * dx + dy * dy > far * far):
                    continue
                _follow(now, before, poses, row, other, agent_id_of[other], path2)
                size = 0.5 * length[row, slot], 0.5 * width[row, slot]
                size2 = 0.5 * length[row, other], 0.5 * width[row, other]
                substep, until = _first_overlap(path, size, path2, size2)
                if substep < 0 and held < 0:
                    continue
                touching[row, agent_id, other] = True
                if held >= 0 and (substep < 0 or held <= substep):
                    substep, when, closing_speed = held, 0.0, held_speed
                    side = _side_facing(path[held + 1], size, path2[held + 1], size2)
                else:
                    when, closing_speed, side = _impact(
                        path, size, path2, size2, substep, until, state.dt / substeps
                    )
                    # Bullet may have slowed them down within that sub-step already.
                    closing_speed = max(closing_speed, held_speed)
                if substep + when < first:
                    first = substep + when
                    partner[row, agent_id] = other
                    out.partner_generation[row, agent_id] = now.generation[row, other]
                    out.substep[row, agent_id] = substep
                    out.closing_speed[row, agent_id] = closing_speed
                    out.side[row, agent_id] = side


@kernel
def _held_apart(
    now: VehicleStates, before: VehicleStates, tracks: Tracks, row: int, agent_id: int, other: int
) -> tuple[int, float]:
    """Return in which sub-step Bullet first kept an agent's vehicle from another, and how fast they were.

    Sub-steps count from 0; it is -1 if Bullet did not.
    """
    if tracks.touched[row, agent_id, other] == 0:
        return -1, 0.0
    # A vehicle that came into the slot within the step was not there.
    if was_there(now, before, row, other):
        return tracks.touched[row, agent_id, other] - 1, tracks.touch_speed[row, agent_id, other]
    return -1, 0.0


@kernel
def _survey(state: State, poses: Floats, row: int, near: Ints, reach: Floats, agent_id_of: Ints) -> int:
    """List the vehicles of one simulation, and how far from its present centre each box was at most.

    Args:
        state: State of the world.
        poses: Poses of the agents' tracks.
        row: The simulation.
        near: Written: the slots, in order.
        reach: Written: by slot [m].
        agent_id_of: Written: by slot, the agent whose track the vehicle follows, -1 if it moves evenly.

    Returns:
        How many vehicles there are.
    """
    now, before, agents = state.vehicles, state.before, state.agents
    alive, position, length, width = now.alive, now.position, now.length, now.width
    count = 0
    for slot in range(state.used[row]):
        if alive[row, slot]:
            near[count] = slot
            count += 1
            agent_id_of[slot] = -1
            reach[slot] = 0.5 * math.hypot(length[row, slot], width[row, slot])
            if was_there(now, before, row, slot):
                dx = position[row, slot, 0] - before.position[row, slot, 0]
                reach[slot] += math.hypot(dx, position[row, slot, 1] - before.position[row, slot, 1])
    for agent_id in range(poses.shape[1]):
        slot = agents.slot[row, agent_id]
        if agents.state[row, agent_id] in (_ACTIVE, _LEAVING) and slot >= 0 and poses.shape[2] > 0:
            agent_id_of[slot] = agent_id
            farthest = 0.0
            for substep in range(poses.shape[2]):
                dx = poses[row, agent_id, substep, 0] - position[row, slot, 0]
                farthest = max(
                    farthest, math.hypot(dx, poses[row, agent_id, substep, 1] - position[row, slot, 1])
                )
            reach[slot] = max(reach[slot], farthest + 0.5 * math.hypot(length[row, slot], width[row, slot]))
    return count


@kernel
def _follow(
    now: VehicleStates, before: VehicleStates, poses: Floats, row: int, slot: int, agent_id: int, path: Floats
) -> None:
    """Write a vehicle's poses at the beginning of the step and after each sub-step, shape (S + 1, 3)."""
    x, y, heading = now.position[row, slot, 0], now.position[row, slot, 1], now.heading[row, slot]
    is_new = not was_there(now, before, row, slot)
    last = len(path) - 1
    if agent_id >= 0:
        for i in range(path.shape[1]):
            for step in range(poses.shape[2]):
                path[step + 1, i] = poses[row, agent_id, step, i]
            path[0, i] = path[1, i]
        if not is_new:
            path[0, 0], path[0, 1] = before.position[row, slot]
            path[0, 2] = before.heading[row, slot]
        return
    x0, y0, heading0 = x, y, heading
    if not is_new:
        x0, y0 = before.position[row, slot]
        heading0 = before.heading[row, slot]
    for number in range(last):
        share = number / last
        path[number, 0], path[number, 1] = x0 + share * (x - x0), y0 + share * (y - y0)
        path[number, 2] = interpolate_angle(heading0, heading, share)
    path[last, 0], path[last, 1], path[last, 2] = x, y, heading


@kernel
def _first_overlap(path: Floats, size: HalfSize, path2: Floats, size2: HalfSize) -> tuple[int, float]:
    """Return the first sub-step in which two vehicles overlap, -1 if there is none, and when in it they do.

    That is 1, its end, unless they are apart again by then.
    """
    corner, corner2 = math.hypot(size[0], size[1]), math.hypot(size2[0], size2[1])
    for number in range(1, len(path)):
        pose, pose2 = _between(path, number - 1, 1.0), _between(path2, number - 1, 1.0)
        dx, dy = pose2[0] - pose[0], pose2[1] - pose[1]
        # How much nearer the two may come to each other within the sub-step.
        nearing = (
            math.hypot(
                dx - path2[number - 1, 0] + path[number - 1, 0],
                dy - path2[number - 1, 1] + path[number - 1, 1],
            )
            + corner * abs(wrapped(pose[2] - path[number - 1, 2]))
            + corner2 * abs(wrapped(pose2[2] - path2[number - 1, 2]))
        )
        reach = corner + corner2 + nearing
        if dx * dx + dy * dy >= reach * reach:
            continue
        gap = max(box_gaps(pose, size[0], size[1], pose2, size2[0], size2[1]))
        if gap < 0.0:
            return number - 1, 1.0
        if gap < nearing:
            when = _clip(path, size, path2, size2, number - 1, nearing)
            if when < 1.0:
                return number - 1, when
    return -1, 1.0


@kernel
def _clip(
    path: Floats, size: HalfSize, path2: Floats, size2: HalfSize, substep: int, nearing: float
) -> float:
    """Return when during a sub-step two vehicles overlap that do not at either end of it, 1 if never.

    By conservative advancement: from each look to the next passes the time that they need at least to meet.
    """
    when = 0.0
    while when < 1.0:
        pose, pose2 = _between(path, substep, when), _between(path2, substep, when)
        gap = max(box_gaps(pose, size[0], size[1], pose2, size2[0], size2[1]))
        if gap < 0.0:
            # An overlap at its begin was reported in the sub-step before.
            return when if when > 0.0 else 1.0
        when += max(gap / nearing, SHORTEST_LOOK)
    return 1.0


@kernel
def _between(path: Floats, substep: int, share: float) -> Pose:
    """Return a vehicle's pose during a sub-step, from 0 at its beginning to 1 at its end."""
    after = path[substep + 1]
    if share == 1.0:
        return after[0], after[1], after[2]
    before = path[substep]
    return (
        before[0] + share * (after[0] - before[0]),
        before[1] + share * (after[1] - before[1]),
        interpolate_angle(before[2], after[2], share),
    )


@kernel
def _impact(
    path: Floats, size: HalfSize, path2: Floats, size2: HalfSize, substep: int, until: float, dt: float
) -> tuple[float, float, int]:
    """Return when during the sub-step two vehicles met (0 to 1), how fast [m/s], and at which side.

    Args:
        path: Path of the first vehicle.
        size: Size of the first vehicle.
        path2: Path of the second vehicle.
        size2: Size of the second vehicle.
        substep: The sub-step in which they met.
        until: When during it they overlapped (0 to 1).
        dt: Sub-step [s].
    """
    old, old2 = _between(path, substep, 0.0), _between(path2, substep, 0.0)
    pose, pose2 = _between(path, substep, until), _between(path2, substep, until)
    gaps_before = box_gaps(old, size[0], size[1], old2, size2[0], size2[1])
    gaps = box_gaps(pose, size[0], size[1], pose2, size2[0], size2[1])
    x, y, when = contact_direction(pose, pose2, gaps_before, gaps)
    approach = (pose[0] - old[0] - pose2[0] + old2[0]) * x + (pose[1] - old[1] - pose2[1] + old2[1]) * y
    return until * when, max(0.0, approach / (until * dt)), _side_towards(pose[2], x, y)


@kernel
def _side_facing(pose: Floats, size: HalfSize, pose2: Floats, size2: HalfSize) -> int:
    """Return the side of a vehicle at which another vehicle is."""
    own, other = (pose[0], pose[1], pose[2]), (pose2[0], pose2[1], pose2[2])
    x, y = facing(own, other, box_gaps(own, size[0], size[1], other, size2[0], size2[1]))
    return _side_towards(pose[2], x, y)


@kernel
def _side_towards(heading: float, x: float, y: float) -> int:
    """Return the side of a vehicle that looks in a direction."""
    cosine, sine = math.cos(heading), math.sin(heading)
    ahead, aside = x * cosine + y * sine, y * cosine - x * sine
    if abs(ahead) < abs(aside):
        return LEFT if aside > 0.0 else RIGHT
    return FRONT if ahead > 0.0 else REAR
