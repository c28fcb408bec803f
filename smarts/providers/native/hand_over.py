"""Kernels with which vehicles change hands between native traffic and others."""

from __future__ import annotations

from smarts.arrays import Bools, Ints
from smarts.geometry.compiling import kernel
from smarts.providers.native.departing import begin_driving
from smarts.providers.native.driving import DECEL, decel_of, follow_speed
from smarts.providers.native.junctions import is_first
from smarts.providers.native.occupancy import clear_lists, entry_ahead, is_driven, list_vehicles, rearmost
from smarts.providers.native.state import Demand, Traffic
from smarts.types.transfers import Refusal

BRAKING = 4.5
"""A vehicle is not taken where its driver would brake harder [m/s^2]."""
_NONE, _SPEED, _SIDEWAYS, _MINOR = (
    int(Refusal.NONE),
    int(Refusal.SPEED),
    int(Refusal.SIDEWAYS),
    int(Refusal.WITHOUT_PRIORITY),
)


@kernel
def find_new(n: Traffic, env_mask: Bools, rows: Ints, slots: Ints) -> int:
    """Forget vehicles that others drive now, list vehicles new to the engine, and return their number."""
    v, count = n.state.vehicles, 0
    for b in range(len(env_mask)):
        if not env_mask[b]:
            continue
        for slot in range(v.alive.shape[1]):
            is_own = v.alive[b, slot] and v.owner[b, slot] == n.owner
            if not is_own:
                n.driven.generation[b, slot] = -1
            elif n.driven.generation[b, slot] != v.generation[b, slot]:
                rows[count], slots[count] = b, slot
                count += 1
    return count


@kernel
def take_over(
    n: Traffic, d: Demand, b: int, slot: int, t: int, row: int, front: float, offset: float, factor: float
) -> None:
    """Begin to drive a vehicle that another provider has driven; its tail may be on the lane before.

    Args:
        n: Native traffic.
        d: What scenarios want.
        b: The simulation.
        slot: The vehicle.
        t: Its type.
        row: Row of its lane.
        front: Arc length of its front on it [m].
        offset: Offset to the left of the lane [m].
        factor: Its speed factor.
    """
    begin_driving(n, b, slot, t, row, front, factor)
    n.driven.offset[b, slot], n.driven.next_action[b, slot] = offset, 0.0
    lane = d.ways.lane[row]
    if front < n.state.vehicles.length[b, slot] and n.predecessor_start[lane] < n.predecessor_start[lane + 1]:
        n.driven.tails[b, slot, 0] = n.predecessor[n.predecessor_start[lane]]


@kernel
def would_brake(
    n: Traffic, d: Demand, b: int, slot: int, t: int, row: int, front: float, factor: float
) -> int:
    """Return `Refusal.SPEED` if a driver would have to brake hard for its leader; see `take_over`."""
    list_vehicles(n, d, b, True)
    ways, room, driven, lane = d.ways, n.occupancy, n.driven, d.ways.lane[row]
    seen, entry = -front, entry_ahead(n, lane, front, slot)
    if entry < 0 and ways.next[row] >= 0:
        seen += n.lane_length[lane]
        entry = rearmost(n, ways.lane[ways.next[row]], slot)
    found, speed = _NONE, max(n.state.vehicles.speed[b, slot], 0.0)
    if entry >= 0:
        before = driven.type[b, slot], driven.row[b, slot], driven.factor[b, slot]
        driven.type[b, slot], driven.row[b, slot], driven.factor[b, slot] = t, row, factor
        gap = seen + room.back[entry] - d.types.min_gap[t]
        decel = decel_of(n, d, b, room.slot[entry])
        safe = follow_speed(n, d, b, slot, speed, gap, room.pace[entry], decel)
        if safe < speed - max(BRAKING, d.types.decel[t]) * n.state.dt:
            found = _SPEED
        driven.type[b, slot], driven.row[b, slot], driven.factor[b, slot] = before
    clear_lists(n)
    return found


@kernel
def refusal_to_give(n: Traffic, d: Demand, b: int, slot: int) -> int:
    """Return why an agent cannot take a vehicle now: it changes lanes, or crosses without priority."""
    if not is_driven(n, b, slot):
        return _NONE
    if n.driven.side[b, slot] != 0:
        return _SIDEWAYS
    row, speed = n.driven.row[b, slot], n.state.vehicles.speed[b, slot]
    lane = d.ways.lane[row]
    if n.roads.lane_inside[lane]:
        return _NONE if is_first(n, lane) else _MINOR
    left, needed = (
        n.lane_length[lane] - n.driven.front[b, slot],
        0.5 * speed * speed / DECEL + n.state.dt * speed,
    )
    following = d.ways.next[row]
    if left < needed and following >= 0 and not is_first(n, d.ways.lane[following]):
        return _MINOR
    return _NONE
