"""Contacts: which vehicles touched, by their footprints at every sub-step of the step."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.geometry.boxes import Pose, box_gaps, contact_direction
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import interpolate_angle
from smarts.sim.columns import columns_of
from smarts.types.events import Contacts
from smarts.types.seats import SeatState
from smarts.types.world import World

Bools = NDArray[np.bool_]
Bytes = NDArray[np.int8]
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]

FRONT, LEFT, REAR, RIGHT = range(4)

_ACTIVE = int(SeatState.ACTIVE)
_SHADOWING = int(SeatState.SHADOWING)


class Footprints(NamedTuple):
    """The columns of `VehicleStates` that say where a vehicle's box is, shape (B, V)."""

    alive: Bools
    generation: Ints
    position: Floats
    heading: Floats
    length: Floats
    width: Floats


class SeatSlots(NamedTuple):
    """The columns of `Seats` that say which vehicle an agent has, shape (B, A)."""

    state: Bytes
    slot: Ints


class ContactColumns(NamedTuple):
    """`Contacts`."""

    partner: Ints
    partner_generation: Ints
    substep: Bytes
    closing_speed: Floats
    side: Bytes
    touching: Bools


class Boxes(NamedTuple):
    """Where the boxes of all vehicles are during a step: all that a pose at a sub-step follows from."""

    now: Footprints
    before: Footprints
    tracks: Floats
    """Poses of the seats' vehicles after each sub-step, shape (B, A, S, 3); none at a reset."""
    seat: Ints
    """The seat whose track a slot's vehicle follows, -1 if it moves evenly, shape (V,); of one simulation."""
    substeps: int
    """S, or 1 where there are no tracks."""


class FootprintContacts:
    """Finds contacts by the separating-axis theorem, at each sub-step, between oriented boxes.

    Vehicles that agents drive are where their tracks say. All others move evenly from their pose a step ago
    to their pose now, and turn the shorter way; those that have just come stand where they are. So vehicles
    that pass through each other within a step are found, too.
    """

    def __init__(self, world: World) -> None:
        worlds, seats = world.seats.slot.shape
        self._contacts = Contacts.allocate(worlds, seats, world.vehicles.capacity)
        self._columns = columns_of(self._contacts, ContactColumns)
        self._now = columns_of(world.vehicles, Footprints)
        self._before = columns_of(world.before, Footprints)
        self._seats = columns_of(world.seats, SeatSlots)
        self._seat_of = np.full(world.vehicles.capacity, -1, np.int32)
        self._dt = world.dt

    def find(self, world: World, tracks: Floats, rows: Bools) -> Contacts:
        """Return the first contact of each seat's vehicle during the step.

        Args:
            world: The one that this was made for.
            tracks: x, y [m], heading [rad] after each sub-step, shape (B, A, S, 3). With S = 0 only the
                present counts.
            rows: Which simulations made the step, shape (B,).
        """
        substeps = max(1, tracks.shape[2])
        boxes = Boxes(self._now, self._before, tracks, self._seat_of, substeps)
        find_contacts(boxes, self._seats, rows, self._dt / substeps, self._columns)
        return self._contacts


@kernel
def find_contacts(boxes: Boxes, seats: SeatSlots, rows: Bools, dt: float, out: ContactColumns) -> None:
    """Write the contacts of all seats; those of simulations that made no step have none.

    Args:
        boxes: All vehicles.
        seats: Who drives.
        rows: Which simulations made the step, shape (B,).
        dt: Length of a sub-step [s].
        out: Written.
    """
    worlds, count = seats.slot.shape
    capacity = boxes.now.alive.shape[1]
    near, reach = np.empty(capacity, np.int32), np.empty(capacity)
    out.partner[:] = -1
    out.partner_generation[:] = 0
    out.substep[:] = 0
    out.closing_speed[:] = 0.0
    out.side[:] = 0
    out.touching[:] = False
    for row in range(worlds):
        if not rows[row]:
            continue
        boxes.seat[:] = -1
        for seat in range(count):
            if seats.state[row, seat] == _ACTIVE and seats.slot[row, seat] >= 0:
                boxes.seat[seats.slot[row, seat]] = seat
        alive = 0
        for slot in range(capacity):
            if boxes.now.alive[row, slot]:
                near[alive] = slot
                reach[slot] = _reach(boxes, row, slot)
                alive += 1
        for seat in range(count):
            if seats.state[row, seat] in (_ACTIVE, _SHADOWING) and seats.slot[row, seat] >= 0:
                _meet(boxes, row, seat, seats.slot[row, seat], near[:alive], reach, dt, out)


@kernel
def _meet(
    boxes: Boxes, row: int, seat: int, slot: int, near: Ints, reach: Floats, dt: float, out: ContactColumns
) -> None:
    """Write whom one seat's vehicle touches."""
    position = boxes.now.position
    first = np.inf
    for other in near:
        dx = position[row, other, 0] - position[row, slot, 0]
        dy = position[row, other, 1] - position[row, slot, 1]
        far = reach[slot] + reach[other]
        if other == slot or dx * dx + dy * dy > far * far:
            continue
        substep = _first_overlap(boxes, row, slot, other)
        if substep < 0:
            continue
        out.touching[row, seat, other] = True
        when, closing_speed, side = _impact(boxes, row, slot, other, substep, dt)
        if substep + when < first:
            first = substep + when
            out.partner[row, seat] = other
            out.partner_generation[row, seat] = boxes.now.generation[row, other]
            out.substep[row, seat] = substep
            out.closing_speed[row, seat] = closing_speed
            out.side[row, seat] = side


@kernel
def _is_new(boxes: Boxes, row: int, slot: int) -> bool:
    """Tell whether the slot held nobody, or somebody else, a step ago."""
    was = boxes.before.alive[row, slot]
    return not was or boxes.before.generation[row, slot] != boxes.now.generation[row, slot]


@kernel
def _pose_at(boxes: Boxes, row: int, slot: int, substep: int) -> Pose:
    """Return the pose after a sub-step; sub-step -1 is the pose at the beginning of the step."""
    now, before, seat = boxes.now, boxes.before, boxes.seat[slot]
    if seat >= 0 and boxes.tracks.shape[2] > 0 and (substep >= 0 or _is_new(boxes, row, slot)):
        track = boxes.tracks[row, seat, max(0, substep)]
        return track[0], track[1], track[2]
    x, y, heading = now.position[row, slot, 0], now.position[row, slot, 1], now.heading[row, slot]
    if _is_new(boxes, row, slot) or substep == boxes.substeps - 1:
        return x, y, heading
    share = (substep + 1) / boxes.substeps
    x0, y0 = before.position[row, slot, 0], before.position[row, slot, 1]
    heading = interpolate_angle(before.heading[row, slot], heading, share)
    return x0 + share * (x - x0), y0 + share * (y - y0), heading


@kernel
def _reach(boxes: Boxes, row: int, slot: int) -> float:
    """Return how far from the vehicle's present centre its box has been during the step, at most [m]."""
    farthest = 0.0
    last = _pose_at(boxes, row, slot, boxes.substeps - 1)
    for substep in range(boxes.substeps - 1):
        x, y, _ = _pose_at(boxes, row, slot, substep)
        farthest = max(farthest, math.hypot(x - last[0], y - last[1]))
        if boxes.seat[slot] < 0:
            # It moves evenly: nowhere is it farther off than at first.
            break
    now = boxes.now
    farthest += math.hypot(last[0] - now.position[row, slot, 0], last[1] - now.position[row, slot, 1])
    return farthest + 0.5 * math.hypot(now.length[row, slot], now.width[row, slot])


@kernel
def _first_overlap(boxes: Boxes, row: int, slot: int, other: int) -> int:
    """Return the first sub-step at whose end two vehicles overlap, -1 if there is none."""
    length, width = boxes.now.length, boxes.now.width
    half_length, half_width = 0.5 * length[row, slot], 0.5 * width[row, slot]
    half_length2, half_width2 = 0.5 * length[row, other], 0.5 * width[row, other]
    reach = math.hypot(half_length, half_width) + math.hypot(half_length2, half_width2)
    for substep in range(boxes.substeps):
        pose, pose2 = _pose_at(boxes, row, slot, substep), _pose_at(boxes, row, other, substep)
        dx, dy = pose2[0] - pose[0], pose2[1] - pose[1]
        if dx * dx + dy * dy >= reach * reach:
            continue
        if max(box_gaps(pose, half_length, half_width, pose2, half_length2, half_width2)) < 0.0:
            return substep
    return -1


@kernel
def _impact(
    boxes: Boxes, row: int, slot: int, other: int, substep: int, dt: float
) -> tuple[float, float, int]:
    """Return when during the sub-step two vehicles met (0 to 1), how fast [m/s], and at which side."""
    length, width = boxes.now.length, boxes.now.width
    half_length, half_width = 0.5 * length[row, slot], 0.5 * width[row, slot]
    half_length2, half_width2 = 0.5 * length[row, other], 0.5 * width[row, other]
    old, old2 = _pose_at(boxes, row, slot, substep - 1), _pose_at(boxes, row, other, substep - 1)
    pose, pose2 = _pose_at(boxes, row, slot, substep), _pose_at(boxes, row, other, substep)
    gaps_before = box_gaps(old, half_length, half_width, old2, half_length2, half_width2)
    gaps = box_gaps(pose, half_length, half_width, pose2, half_length2, half_width2)
    x, y, when = contact_direction(pose, pose2, gaps_before, gaps)
    approach = (pose[0] - old[0] - pose2[0] + old2[0]) * x + (pose[1] - old[1] - pose2[1] + old2[1]) * y
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    ahead, aside = x * cosine + y * sine, y * cosine - x * sine
    if abs(ahead) < abs(aside):
        return when, max(0.0, approach / dt), LEFT if aside > 0.0 else RIGHT
    return when, max(0.0, approach / dt), FRONT if ahead > 0.0 else REAR
