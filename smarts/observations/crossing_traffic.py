"""The feature `crossing_traffic`."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Floats, Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.feature import Feature
from smarts.observations.scales import SIGHT, SPEED_SCALE, compressed
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length
from smarts.roads.lane_graph import Yields
from smarts.roads.lane_ways import next_row, row_of
from smarts.sensors.nearest import keep_nearest
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State

VEHICLES = 4
VALUES = 5
"""Values of each vehicle: soonness, own distance, its distance, its speed, priority."""
LONGEST_TIME = 10.0
"""Vehicles that come later are left out [s]."""
STANDING = 0.5
"""Vehicles count as at least this fast [m/s]."""

MOST_MEETINGS = 64
"""Most overlaps of a way through a junction."""
_MOST_LANES = 32
PRIORITY = np.zeros(4)
"""By `Yields`: 1 where the agent gives way, -1 where the other does, else 0."""
PRIORITY[Yields.THIS], PRIORITY[Yields.OTHER] = 1.0, -1.0


@kernel
def meetings_ahead(
    state: State, roads: Roads, routes: RouteTable, b: int, a: int, places: Ints, begins: Floats
) -> int:
    """List where lanes overlap an agent's way through the junction ahead or around it; return how many.

    Args:
        state: The state of the world.
        roads: The maps' lanes.
        routes: The agents' routes.
        b: The simulation.
        a: The agent.
        places: Rows of `Roads.conflict_lane`; written.
        begins: Distance of the front bumper to the overlap, negative where it is past its begin [m]; written.
    """
    vehicles, m, slot = state.vehicles, state.map[b], state.agents.slot[b, a]
    base, lane, count = roads.lane_base[m], vehicles.lane[b, slot], 0
    if lane < 0:
        return 0
    row = row_of(routes, m, routes.number[b, a], base + lane, base, state.agents.route_progress[b, a])
    length = vehicles.length[b, slot]
    begin, was_inside = -vehicles.lane_position[b, slot] - 0.5 * length, False
    while row >= 0 and begin <= SIGHT:
        lane = int(routes.lane[row])
        if was_inside and not roads.lane_inside[lane]:
            break
        was_inside = roads.lane_inside[lane]
        if was_inside:
            for place in range(roads.conflict_start[lane], roads.conflict_start[lane + 1]):
                # An overlap that the vehicle has cleared is behind it.
                if begin + roads.conflict_extent[place, 1] + length > 0.0 and count < len(places):
                    places[count] = place
                    begins[count] = begin + roads.conflict_extent[place, 0]
                    count += 1
        begin += lane_length(roads, lane)
        row = next_row(roads, routes, m, row, base)
    return count


@kernel
def first_meeting(
    vehicles: VehicleStates, roads: Roads, routes: RouteTable, m: int, b: int, slot: int, places: Ints
) -> tuple[int, float]:
    """Return which of some overlaps a vehicle comes to first, -1 for none, and its distance to it [m].

    All turns that it may take count. The distance is 0 inside an overlap; those that it has cleared are left
    out.
    """
    half, best, least = 0.5 * vehicles.length[b, slot], -1, np.inf
    rows, centres = np.empty(_MOST_LANES, np.int32), np.empty(_MOST_LANES)
    rows[0], centres[0], left = routes.start[m] + vehicles.lane[b, slot], vehicles.lane_position[b, slot], 1
    while left > 0:
        left -= 1
        row, centre = int(rows[left]), centres[left]
        lane = int(routes.lane[row])
        for i in range(len(places)):
            place = places[i]
            gap = max(0.0, roads.conflict_other_extent[place, 0] - centre - half)
            has_cleared = centre - half > roads.conflict_other_extent[place, 1]
            if roads.conflict_lane[place] == lane and gap < least and not has_cleared:
                best, least = i, gap
        centre -= lane_length(roads, lane)
        if -centre > SIGHT:
            continue
        for entry in range(routes.onward_start[row], routes.onward_start[row + 1]):
            if left < len(rows):
                rows[left], centres[left] = routes.onward[entry], centre
                left += 1
    return best, least


class CrossingTraffic(Feature):
    """The four vehicles that first come to where their lanes overlap the way through the junction ahead.

    Of each: 1 - time / 10 s at its speed, so 1 in the overlap; compressed: distance from the agent's front
    bumper to the overlap, from its front bumper, its speed; 1 if the agent gives way, -1 if the vehicle does,
    0 if the map does not say. All turns that it may take count. Zeros for fewer vehicles within 100 m.
    """

    size = VEHICLES * VALUES

    @staticmethod
    @kernel
    def write(state: State, roads: Roads, routes: RouteTable, b: int, g: int, a: int, out: Singles) -> None:
        """Write an agent's numbers; see `Feature`."""
        vehicles = state.vehicles
        out[:] = 0.0
        places, begins = np.empty(MOST_MEETINGS, np.int32), np.empty(MOST_MEETINGS)
        count = meetings_ahead(state, roads, routes, b, a, places, begins)
        if count == 0:
            return
        slots, times = np.empty(VEHICLES, np.int32), np.empty(VEHICLES)
        found, most = 0, vehicles.alive.shape[1]
        where, gaps = np.empty(most, np.int32), np.empty(most)
        for v in range(most):
            if not vehicles.alive[b, v] or v == state.agents.slot[b, a] or vehicles.lane[b, v] < 0:
                continue
            where[v], gaps[v] = first_meeting(vehicles, roads, routes, state.map[b], b, v, places[:count])
            time = gaps[v] / max(vehicles.speed[b, v], STANDING)
            if where[v] >= 0 and time < LONGEST_TIME:
                found = keep_nearest(slots, times, found, v, time)
        for i in range(found):
            v, first = slots[i], i * VALUES
            out[first] = 1.0 - times[i] / LONGEST_TIME
            out[first + 1] = compressed(begins[where[v]], SIGHT)
            out[first + 2] = compressed(gaps[v], SIGHT)
            out[first + 3] = compressed(vehicles.speed[b, v], SPEED_SCALE)
            out[first + 4] = PRIORITY[roads.conflict_yields[places[where[v]]]]
