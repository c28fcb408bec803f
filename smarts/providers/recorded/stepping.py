"""The kernels of a step of recorded traffic, for all simulations.

First each vehicle decides by what all were at the step's begin, then all move, so that the order of the slots
does not matter.
"""

from __future__ import annotations

from smarts.arrays import Bools, Ints
from smarts.geometry.boxes import Pose, box_gaps
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import wrapped
from smarts.providers.recorded import following
from smarts.providers.recorded.following import ACCEL, DECEL, HARDEST, is_driven
from smarts.providers.recorded.state import Course, Entry, Recorded
from smarts.recordings.gaps import place_at
from smarts.types.vehicles import VehicleKind

SLACK = 1e-6
"""Tolerance of comparisons of times [s]."""
ROOM = 0.3
"""A vehicle enters so far from others that are not where the log has them, at least [m]."""
ON_PLACE, ON_PACE = 0.1, 0.2
"""A vehicle is back on schedule with so little difference of place [m] and speed [m/s]."""
MOST_OFFSET, MOST_TURN = 1.5, 0.2
"""Largest offset from a path [m] and angle to it [rad] of a vehicle that joins it."""
Box = tuple[Pose, float, float]
"""Pose, half length, half width [m]."""
_ON_LOG, _FOLLOWS = int(Course.ON_LOG), int(Course.FOLLOWS)
_DELAYED, _DONE = int(Entry.DELAYED), int(Entry.DONE)
_PEDESTRIAN = int(VehicleKind.PEDESTRIAN)


@kernel
def step(n: Recorded, env_mask: Bools, rows: Ints, tracks: Ints, left_rows: Ints, left: Ints) -> tuple:
    """Advance the simulations in a mask.

    Args:
        n: Recorded traffic.
        env_mask: The simulations, shape (B,).
        rows: Written: the simulations of tracks whose vehicles enter.
        tracks: Written: these tracks.
        left_rows: Written: the simulations of vehicles that have left; their slots are still to be cleared.
        left: Written: their slots.

    Returns:
        How many enter, and how many have left.
    """
    count = gone = 0
    for b in range(len(env_mask)):
        if env_mask[b]:
            for slot in range(n.used[b]):
                if is_driven(n, b, slot):
                    _decide(n, b, slot)
            for slot in range(n.used[b]):
                if is_driven(n, b, slot) and not _moves(n, b, slot):
                    n.vehicles.alive[b, slot] = False
                    left_rows[gone], left[gone] = b, slot
                    gone += 1
            count = find_due(n, b, rows, tracks, count)
    return count, gone


@kernel
def find_new(n: Recorded, env_mask: Bools, rows: Ints, slots: Ints) -> int:
    """Let go of vehicles that others drive, list vehicles new to the engine, and return their number."""
    v, count = n.vehicles, 0
    for b in range(len(env_mask)):
        for slot in range(n.used[b]):
            if not env_mask[b] or is_driven(n, b, slot):
                continue
            n.cars[b, slot].course = 0
            if v.alive[b, slot] and v.owner[b, slot] == n.owner:
                rows[count], slots[count] = b, slot
                count += 1
    return count


@kernel
def _keeps_log(n: Recorded, b: int, track: int) -> bool:
    """Return whether a track's vehicle stays where the log has it: all in mode "log", and pedestrians."""
    return not n.sims[b].reacts or n.paths.kind[track] == _PEDESTRIAN


@kernel
def _decide(n: Recorded, b: int, slot: int) -> None:
    """Write a vehicle's course and speed of the step."""
    car, sim = n.cars[b, slot], n.sims[b]
    now = sim.begin + n.step[b] * n.dt
    car.next_course = car.course
    if car.course == _ON_LOG:
        if _keeps_log(n, b, car.track):
            return
        s = place_at(n.paths, car.track, now - n.dt)[4]
        is_over = now > n.paths.end[car.track] + SLACK and n.paths.is_cut[car.track]
        if not is_over and following.acceleration(n, b, slot, car.track, s, True) >= 0.0:
            return
        car.next_course = _FOLLOWS
        _join_track(n, b, slot)
    elif car.path != car.track and car.track >= 0:
        _join_track(n, b, slot)
    _follow(n, b, slot)


@kernel
def _join_track(n: Recorded, b: int, slot: int) -> None:
    """Let a vehicle follow its own track's path from where it is, if it is near it."""
    v, track = n.vehicles, n.cars[b, slot].track
    x, y = v.position[b, slot, 0], v.position[b, slot, 1]
    s, offset, turn = following.nearest_place(n, track, x, y, v.heading[b, slot])
    if abs(offset) <= MOST_OFFSET and abs(turn) <= MOST_TURN:
        following.join(n, b, slot, track, s, offset, turn)


@kernel
def _follow(n: Recorded, b: int, slot: int) -> None:
    """Write the speed of a vehicle that follows a path, and whether it is back on schedule."""
    car, sim, paths = n.cars[b, slot], n.sims[b], n.paths
    now, speed = sim.begin + n.step[b] * n.dt, n.vehicles.speed[b, slot]
    has_schedule = car.path == car.track and now <= paths.end[car.path] + SLACK
    there = before = log_speed = 0.0
    wanted = following.pace_at(paths, car.path, car.s)
    if has_schedule:
        before = place_at(paths, car.track, now - n.dt)[4]
        there = place_at(paths, car.track, now)[4]
        log_speed = (there - before) / n.dt
        wanted = following.scheduled_speed(paths, car, before, log_speed)
    free = min(speed + ACCEL * n.dt, max(speed - DECEL * n.dt, wanted))
    allowed = following.acceleration(n, b, slot, car.path, car.s, False)
    car.next_speed = max(0.0, min(free, speed + n.dt * max(allowed, -HARDEST)))
    if not has_schedule or abs(car.s + car.next_speed * n.dt - there) > ON_PLACE:
        return
    if abs(car.next_speed - log_speed) > ON_PACE or abs(following.offset_of(car)[0]) > ON_PLACE:
        return
    if following.acceleration(n, b, slot, car.path, car.s, True) >= 0.0:
        car.next_course = _ON_LOG


@kernel
def _moves(n: Recorded, b: int, slot: int) -> bool:
    """Move a vehicle by what it has decided; return False if it leaves instead."""
    car, paths = n.cars[b, slot], n.paths
    car.course = car.next_course
    if car.course == _ON_LOG:
        now = n.sims[b].begin + n.step[b] * n.dt
        if now > paths.end[car.track] + SLACK:
            return False
        x, y, heading, speed, car.s = place_at(paths, car.track, now)
        _write(n, b, slot, (x, y, heading), speed, False)
        return True
    car.s += car.next_speed * n.dt
    if car.s >= paths.point_s[paths.point[car.path + 1] - 1]:
        return False
    _write(n, b, slot, following.pose_on_path(paths, car), car.next_speed, False)
    return True


@kernel
def find_due(n: Recorded, b: int, rows: Ints, tracks: Ints, count: int) -> int:
    """List the tracks whose vehicles enter a simulation now, behind `count` others; return their number."""
    sim, paths, first = n.sims[b], n.paths, count
    now, at_reset = sim.begin + n.step[b] * n.dt, n.step[b] == 0
    while sim.next < sim.last and paths.begin[sim.next] <= now + SLACK:
        if paths.end[sim.next] < now - SLACK:
            n.entry[b, sim.next - sim.first] = _DONE
        sim.next += 1
    present = 0
    for slot in range(n.used[b]):
        present += n.vehicles.alive[b, slot]
    for track in range(sim.oldest, sim.next):
        if n.entry[b, track - sim.first] == _DONE:
            sim.oldest += track == sim.oldest
            continue
        if _keeps_log(n, b, track) and paths.end[track] < now - SLACK:
            n.entry[b, track - sim.first] = _DONE
            continue
        is_full = present + count - first >= min(sim.limit, n.vehicles.alive.shape[1])
        if is_full:
            sim.is_full = True
        if not is_full and _has_room(n, b, track, tracks, first, count):
            rows[count], tracks[count] = b, track
            count += 1
        elif at_reset:
            # In the middle of its way it would later appear beside or before what has stood in its place.
            n.entry[b, track - sim.first] = _DONE
            sim.held_back += 1
        else:
            sim.held_back += n.entry[b, track - sim.first] != _DELAYED
            n.entry[b, track - sim.first] = _DELAYED
    return count


@kernel
def _entry_pose(n: Recorded, b: int, track: int) -> tuple[float, float, float, float, float]:
    """Return x, y, heading, speed, arc length with which a vehicle enters: the log's, or its first."""
    sim = n.sims[b]
    waits = n.entry[b, track - sim.first] == _DELAYED and not _keeps_log(n, b, track)
    now = n.paths.begin[track] if waits else sim.begin + n.step[b] * n.dt
    return place_at(n.paths, track, now)


@kernel
def _can_brake(n: Recorded, b: int, track: int) -> bool:
    """Return whether a vehicle that enters brakes in time; in mode "log" only if it comes late."""
    sim, paths = n.sims[b], n.paths
    if paths.kind[track] == _PEDESTRIAN:
        return True
    is_late = n.entry[b, track - sim.first] == _DELAYED
    if not sim.reacts and not is_late:
        return True
    x, y, _, speed, s = _entry_pose(n, b, track)
    body = x, y, 0.5 * paths.length[track], 0.5 * paths.width[track], paths.headway[track], speed
    ignores = not (sim.reacts and is_late)
    return following.allowed_acceleration(n, b, -1, body, track, s, ignores) >= -DECEL


@kernel
def _has_room(n: Recorded, b: int, track: int, listed: Ints, first: int, end: int) -> bool:
    """Return whether a track's vehicle can enter beside all vehicles, and the tracks listed to enter now."""
    v = n.vehicles
    own = _entry_box(n, b, track)
    for slot in range(n.used[b]):
        if v.alive[b, slot]:
            on_log = is_driven(n, b, slot) and n.cars[b, slot].course == _ON_LOG
            pose = v.position[b, slot, 0], v.position[b, slot, 1], v.heading[b, slot]
            other = pose, 0.5 * v.length[b, slot], 0.5 * v.width[b, slot]
            if _gap(own, other) < (0.0 if on_log else ROOM):
                return False
    for place in range(first, end):
        if _gap(own, _entry_box(n, b, listed[place])) < 0.0:
            return False
    return _can_brake(n, b, track)


@kernel
def _gap(box: Box, other: Box) -> float:
    """Return the gap between two boxes [m], below 0 if they overlap."""
    return max(box_gaps(box[0], box[1], box[2], other[0], other[1], other[2]))


@kernel
def _entry_box(n: Recorded, b: int, track: int) -> Box:
    """Return the pose with which a track's vehicle enters, half its length and half its width."""
    x, y, heading, _, _ = _entry_pose(n, b, track)
    return (x, y, heading), float(0.5 * n.paths.length[track]), float(0.5 * n.paths.width[track])


@kernel
def enter(n: Recorded, b: int, slot: int, track: int) -> None:
    """Begin to drive a vehicle that has got its slot in this step."""
    sim, car = n.sims[b], n.cars[b, slot]
    x, y, heading, speed, s = _entry_pose(n, b, track)
    is_late = n.entry[b, track - sim.first] == _DELAYED
    car.course = _FOLLOWS if is_late and not _keeps_log(n, b, track) else _ON_LOG
    car.generation, car.track = n.vehicles.generation[b, slot], track
    following.join(n, b, slot, track, s, 0.0, 0.0)
    n.entry[b, track - sim.first] = _DONE
    _write(n, b, slot, (x, y, heading), speed, True)


@kernel
def take(n: Recorded, b: int, slot: int, p: int, s: float, offset: float, turn: float) -> None:
    """Begin to drive a vehicle that another provider has driven, on a path; see `join`."""
    car, v = n.cars[b, slot], n.vehicles
    if car.generation != v.generation[b, slot]:
        car.generation, car.track = v.generation[b, slot], -1
    car.course = _FOLLOWS
    following.join(n, b, slot, p, s, offset, turn)


@kernel
def _write(n: Recorded, b: int, slot: int, pose: Pose, speed: float, is_new: bool) -> None:
    """Write a vehicle's motion; rates are by its motion in the step before, 0 if it is new."""
    v, car, heading = n.vehicles, n.cars[b, slot], wrapped(pose[2])
    yaw_rate = 0.0 if is_new else wrapped(heading - v.heading[b, slot]) / n.dt
    v.acceleration[b, slot] = 0.0 if is_new else (speed - v.speed[b, slot]) / n.dt
    v.yaw_acceleration[b, slot] = 0.0 if is_new else (yaw_rate - v.yaw_rate[b, slot]) / n.dt
    v.position[b, slot, 0], v.position[b, slot, 1] = pose[0], pose[1]
    v.heading[b, slot], v.speed[b, slot], v.yaw_rate[b, slot] = heading, speed, yaw_rate
    v.lateral_acceleration[b, slot], v.lateral_speed[b, slot] = speed * yaw_rate, 0.0
    v.desired_speed[b, slot] = following.pace_at(n.paths, car.path, car.s)
