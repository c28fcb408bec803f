"""Kernels that list where others may cross or join a vehicle's way through junctions."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.roads.arrays import Roads, RouteTable
from smarts.roads.kernels import lane_length
from smarts.roads.lane_graph import Yields
from smarts.roads.lane_ways import next_row
from smarts.roads.paces import Performance
from smarts.roads.precedence import BEGIN, CAP, CLEARANCE, END, LANE, LINE, OTHER_BEGIN, OTHER_END, WIDTH

_THIS = int(Yields.THIS)


@kernel
def list_meetings(
    roads: Roads,
    routes: RouteTable,
    m: int,
    row: int,
    begin: float,
    half: float,
    performance: Performance,
    kind: int,
    horizon: float,
    places: Ints,
    meetings: Floats,
    lanes: Ints,
    begins: Floats,
) -> tuple[int, int]:
    """List the own way's lanes and meetings; return how many meetings and lanes.

    Args:
        roads: The maps' lanes.
        routes: The agents' routes.
        m: The map.
        row: Row of the first lane.
        begin: From the front bumper to its begin [m].
        half: Half of the vehicle's length [m].
        performance: Performance of each kind of vehicle.
        kind: The vehicle's.
        horizon: Lines that are farther are left aside [m]; but a junction behind one that is entered counts
            where the vehicle cannot wait between both.
        places: Written: rows of `Roads.conflict_lane`.
        meetings: Written: their columns, see `BEGIN`.
        lanes: Written: the lanes of the way.
        begins: Written: distance of the front bumper to their begins [m].
    """
    count, length, base, cap, left = 0, 0, roads.lane_base[m], np.inf, 2.0 * half + 5.0
    line, way_out = -np.inf, -np.inf
    while row >= 0 and length < len(lanes):
        lane = int(routes.lane[row])
        is_inside = roads.lane_inside[lane]
        was_inside = length > 0 and roads.lane_inside[lanes[length - 1]]
        is_entered = is_inside and not was_inside
        if not is_inside:
            cap = np.inf
            way_out = begin if was_inside else way_out
        if begin > horizon:
            # Of a junction that is entered all lanes count, and the road behind it, as far as it needs.
            if left < 0.0 or (is_entered and begin - way_out > 2.0 * half + CLEARANCE):
                break
            left -= 0.0 if is_inside else lane_length(roads, lane)
        lanes[length], begins[length] = lane, begin
        length += 1
        if is_inside:
            cap = min(cap, performance.pace[lane, kind])
            line = _line_before(roads, places[:count], meetings[:count], begin, line, is_entered)
            for place in range(roads.conflict_start[lane], roads.conflict_start[lane + 1]):
                if count < len(places) and begin + roads.conflict_extent[place, 0] > 0.0:
                    places[count] = place
                    meetings[count, BEGIN] = begin + roads.conflict_extent[place, 0]
                    meetings[count, END] = begin + roads.conflict_extent[place, 1] + 2.0 * half
                    meetings[count, OTHER_BEGIN] = roads.conflict_other_extent[place, 0]
                    meetings[count, OTHER_END] = roads.conflict_other_extent[place, 1]
                    meetings[count, LINE] = line
                    meetings[count, CAP] = cap
                    meetings[count, WIDTH] = roads.lane_width[lane]
                    meetings[count, LANE] = lane
                    count += 1
        begin += lane_length(roads, lane)
        row = next_row(roads, routes, m, row, base)
    return count, length


@kernel
def _line_before(
    roads: Roads, places: Ints, meetings: Floats, begin: float, line: float, is_entered: bool
) -> float:
    """Return the distance to where a vehicle waits for others on a lane inside a junction [m].

    That is where the lane begins, unless the vehicle would stand there in a meeting in which it has to give
    way, or in the junction before this one: then it waits for the others where it waits for that.

    Args:
        roads: The maps' lanes.
        places: Rows in `Roads.conflict_lane` of the meetings before the lane.
        meetings: Their columns, see `precedence.BEGIN`.
        begin: Distance to the lane's begin [m].
        line: Distance to where the vehicle waits on the lane inside a junction before it [m].
        is_entered: Whether the lane is the first one in its junction.
    """
    if line < 0.0:
        return begin
    for i in range(len(places)):
        gives_way = is_entered or roads.conflict_yields[places[i]] == _THIS
        if (
            gives_way
            and meetings[i, BEGIN] < begin < meetings[i, END] + CLEARANCE
            and meetings[i, LINE] == line
        ):
            return line
    return begin
