"""Kernels that find places on the road, for batches of poses on several maps at once.

Axis letters: E poses, M maps. Lanes that a kernel over E poses takes or writes are numbered within their own
map; inside, lanes are numbered across all maps.
"""

from __future__ import annotations

import math

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.geometry.frames import FARTHEST
from smarts.geometry.segments import cell_number, interpolate_angle, project, segment_at
from smarts.roads.arrays import MOST_CANDIDATES, Roads, RouteTable
from smarts.roads.lane_graph import HEIGHT_REACH

HEADING_COST = 10.0
"""Cost of a lane of the opposite direction among lanes that overlap [m of distance]."""
OFF_ROUTE_COST = 3.0
"""Cost of a lane off the route among lanes that overlap [m of distance]."""
END_TOLERANCE = 1e-6
"""Tolerance beyond a lane's end, against rounding where two lanes meet [m]."""
_OTHER_LEVEL = 1e12
"""Cost of a segment at another height, beside its squared distance [m^2]."""


@kernel
def find_row(table: RouteTable, corridor: int, lane: int, hint: float) -> int:
    """Return the row of a lane in a corridor, -1 if it has none.

    Of several rows (a route that comes by twice) it is the one whose distances are nearest to `hint` [m]; the
    first if the hint is NaN.
    """
    low, high = table.start[corridor], table.start[corridor + 1]
    last = high
    while low < high:
        middle = (low + high) // 2
        if table.lane[table.by_lane[middle]] < lane:
            low = middle + 1
        else:
            high = middle
    best, best_gap = -1, np.inf
    while low < last and table.lane[table.by_lane[low]] == lane:
        row = int(table.by_lane[low])
        gap = max(0.0, table.begin[row] - hint, hint - table.end[row])
        if best < 0 or gap < best_gap:
            best, best_gap = row, gap
        low += 1
    return best


@kernel
def lane_length(roads: Roads, lane: int) -> float:
    """Return the arc length of a lane's centreline [m]; the lane is numbered across all maps."""
    return float(roads.point_s[roads.point_start[lane + 1] - 1])


@kernel
def is_somewhere(x: float, y: float) -> bool:
    """Return whether a position is finite and within `FARTHEST`; NaN compares false."""
    return abs(x) < FARTHEST and abs(y) < FARTHEST


@kernel
def cell_at(roads: Roads, world: int, x: float, y: float) -> int:
    """Return the number across all maps of the cell that holds a point, -1 outside the grid."""
    column = cell_number(x, roads.grid_origin[world, 0], roads.grid_size[world])
    row = cell_number(y, roads.grid_origin[world, 1], roads.grid_size[world])
    columns, rows = roads.grid_shape[world]
    if column < 0 or row < 0 or column >= columns or row >= rows:
        return -1
    return roads.cell_base[world] + row * columns + column


@kernel
def is_level(height: float, other: float) -> bool:
    """Return whether two heights [m] are near enough to meet; NaN, unknown, is near all."""
    return not abs(height - other) > HEIGHT_REACH


@kernel
def nearest_segment(
    roads: Roads, first: int, last: int, x: float, y: float, height: float
) -> tuple[int, float, float, float]:
    """Return the nearest of the segments that begin at points `first` to `last`, and `project` onto it.

    Those near `height` [m] come before all others: a ramp may lead over itself.
    """
    best, best_share, best_square, best_cross, least = first, 0.0, np.inf, 0.0, np.inf
    for point in range(first, last + 1):
        a, b = roads.point_xy[point], roads.point_xy[point + 1]
        share, square, cross = project(x, y, a[0], a[1], b[0], b[1])
        if square < least:
            cost = square if is_level(roads.point_z[point], height) else square + _OTHER_LEVEL
            if cost < least:
                best, best_share, best_square, best_cross, least = point, share, square, cross, cost
    return best, best_share, best_square, best_cross


@kernel
def nearest_in_run(roads: Roads, run: int, x: float, y: float, height: float) -> tuple[int, float]:
    """Return the segment of a run nearest to a point, and the square of its distance [m^2].

    The distance is infinite if the segment is not near `height` [m].
    """
    point, _, square, _ = nearest_segment(roads, roads.run[run, 1], roads.run[run, 2] - 1, x, y, height)
    return point, square if is_level(roads.point_z[point], height) else np.inf


@kernel
def place_on(roads: Roads, lane: int, point: int, x: float, y: float) -> tuple[float, float, float]:
    """Return s, t [m] and overshoot [m] of a position projected onto the segment that begins at `point`.

    The overshoot is how far the position lies before the begin or behind the end of the whole lane.
    """
    a, b = roads.point_xy[point], roads.point_xy[point + 1]
    share, square, cross = project(x, y, a[0], a[1], b[0], b[1])
    length = math.hypot(b[0] - a[0], b[1] - a[1])
    overshoot = 0.0
    if share < 0.0 and point == roads.point_start[lane]:
        overshoot = -share * length
    elif share > 1.0 and point == roads.point_start[lane + 1] - 2:
        overshoot = (share - 1.0) * length
    # Behind an end the distance is not square to the lane any more; the offset still is.
    t = cross / length if overshoot > 0.0 else math.copysign(math.sqrt(square), cross)
    span = roads.point_s[point + 1] - roads.point_s[point]
    return roads.point_s[point] + min(1.0, max(0.0, share)) * span, t, overshoot


@kernel
def _heading_at(roads: Roads, point: int, s: float) -> float:
    span = roads.point_s[point + 1] - roads.point_s[point]
    share = min(1.0, max(0.0, (s - roads.point_s[point]) / span))
    return interpolate_angle(roads.point_heading[point], roads.point_heading[point + 1], share)


@kernel
def _gather(
    roads: Roads,
    cell: int,
    x: float,
    y: float,
    height: float,
    mask: int,
    lanes: Ints,
    points: Ints,
    squares: Floats,
) -> int:
    """List the lanes near a cell, each with its segment nearest to the point; return how many."""
    count = 0
    for run in range(roads.run_start[cell], roads.run_start[cell + 1]):
        lane = roads.run[run, 0]
        if not mask >> roads.lane_kind[lane] & 1:
            continue
        point, square = nearest_in_run(roads, run, x, y, height)
        # Runs are ordered by lane, so a lane's runs follow each other.
        if count and lanes[count - 1] == lane:
            if square < squares[count - 1]:
                points[count - 1], squares[count - 1] = point, square
        elif count < MOST_CANDIDATES:
            lanes[count], points[count], squares[count] = lane, point, square
            count += 1
    return count


@kernel
def _choose(
    roads: Roads,
    table: RouteTable,
    corridor: int,
    heading: float,
    x: float,
    y: float,
    count: int,
    lanes: Ints,
    points: Ints,
    squares: Floats,
) -> int:
    """Return the place in the list of the lane that a vehicle at this pose is on, -1 if it is on none."""
    on_road_lane = False
    for place in range(count):
        lane = lanes[place]
        overshoot = place_on(roads, lane, points[place], x, y)[2]
        half = 0.5 * roads.lane_width[lane]
        # A vehicle that cuts a corner keeps its lane inside a junction, though it has left the lane's area.
        reach = 2.0 * half if roads.lane_inside[lane] else half
        if overshoot > END_TOLERANCE or squares[place] > reach * reach:
            squares[place] = np.inf
        elif not roads.lane_inside[lane]:
            on_road_lane = True
    best, best_cost = -1, np.inf
    for place in range(count):
        lane = lanes[place]
        half = 0.5 * roads.lane_width[lane]
        if on_road_lane and squares[place] > half * half:
            continue
        cost = math.sqrt(squares[place])
        if not math.isnan(heading) and cost < best_cost:
            s = place_on(roads, lane, points[place], x, y)[0]
            turn = heading - _heading_at(roads, points[place], s)
            cost += HEADING_COST * 0.5 * (1.0 - math.cos(turn))
        if corridor >= 0 and cost < best_cost and find_row(table, corridor, lane, np.nan) < 0:
            cost += OFF_ROUTE_COST
        if cost < best_cost:
            best, best_cost = place, cost
    return best


@kernel
def _nearest_anywhere(
    roads: Roads, world: int, x: float, y: float, height: float, mask: int
) -> tuple[int, int]:
    """Return the lane and the segment nearest to a point however far it is, (-1, -1) if there is no lane."""
    origin, size = roads.grid_origin[world], roads.grid_size[world]
    columns, rows = roads.grid_shape[world]
    column, row = cell_number(x, origin[0], size), cell_number(y, origin[1], size)
    inner_x, inner_y = x - origin[0] - column * size, y - origin[1] - row * size
    margin = min(inner_x, size - inner_x, inner_y, size - inner_y)
    ring = max(0, -column, column - columns + 1, -row, row - rows + 1)
    last_ring = max(column, columns - 1 - column, row, rows - 1 - row)
    best_lane, best_point, best = -1, -1, np.inf
    while ring <= last_ring:
        for r in range(max(0, row - ring), min(rows - 1, row + ring) + 1):
            whole = abs(r - row) == ring
            left, right = (
                (max(0, column - ring), min(columns - 1, column + ring))
                if whole
                else (column - ring, column + ring)
            )
            for c in range(left, right + 1, 1 if whole else 2 * ring):
                if c < 0 or c >= columns:
                    continue
                cell = roads.cell_base[world] + r * columns + c
                for run in range(roads.run_start[cell], roads.run_start[cell + 1]):
                    lane = roads.run[run, 0]
                    if mask >> roads.lane_kind[lane] & 1:
                        point, square = nearest_in_run(roads, run, x, y, height)
                        if square < best:
                            best_lane, best_point, best = lane, point, square
        # All lanes outside the rings so far are at least this far away.
        if math.sqrt(best) <= ring * size + margin:
            break
        ring += 1
    return best_lane, best_point


@kernel
def candidates() -> tuple[Ints, Ints, Floats]:
    """Return room for the lanes near a pose: lanes, segments, squared distances."""
    return (
        np.empty(MOST_CANDIDATES, np.int32),
        np.empty(MOST_CANDIDATES, np.int32),
        np.empty(MOST_CANDIDATES),
    )


@kernel
def place_on_map(
    roads: Roads,
    table: RouteTable,
    world: int,
    x: float,
    y: float,
    height: float,
    heading: float,
    corridor: int,
    mask: int,
    room: tuple[Ints, Ints, Floats],
) -> tuple[int, float, float, float, float]:
    """Return the lane of one pose, s, t, the distance from the centreline and the road's height there [m].

    See `locate`.

    `corridor` is the row of `table` of its route, -1 without one; `room` is from `candidates`.
    """
    if not is_somewhere(x, y):
        return -1, np.nan, np.nan, np.nan, height
    lanes, points, squares = room
    cell = cell_at(roads, world, x, y)
    chosen = -1
    if cell >= 0:
        count = _gather(roads, cell, x, y, height, mask, lanes, points, squares)
        chosen = _choose(roads, table, corridor, heading, x, y, count, lanes, points, squares)
    if chosen >= 0:
        found, point = int(lanes[chosen]), int(points[chosen])
    else:
        found, point = _nearest_anywhere(roads, world, x, y, height, mask)
    if found < 0:
        return -1, np.nan, np.nan, np.nan, height
    s, t, overshoot = place_on(roads, found, point, x, y)
    distance = math.hypot(t, overshoot) if overshoot > 0.0 else abs(t)
    return found - int(roads.lane_base[world]), s, t, distance, height_at(roads, point, s)


@kernel
def locate(
    roads: Roads,
    table: RouteTable,
    maps: Ints,
    position: Floats,
    height: Floats,
    heading: Floats,
    route: Ints,
    mask: int,
    lane: Ints,
    s: Floats,
    t: Floats,
    distance: Floats,
) -> None:
    """Find the lane that each pose is on, or the nearest one if it is on none.

    A pose is on a lane if it lies within its width and between its ends. Where several lanes overlap, the
    least cost decides: distance to the centreline, plus `HEADING_COST` * (1 - cos(turn)) / 2, plus
    `OFF_ROUTE_COST` off the route. Inside a junction, lanes take part up to twice their width.

    Args:
        roads: The maps' lanes.
        table: The routes.
        maps: Map of each pose, shape (E,).
        position: [m], shape (E, 2); where it is not finite, the lane is -1.
        height: Height of the road [m], NaN where it is unknown, shape (E,); only lanes near it count.
        heading: [rad], NaN where it is not to matter, shape (E,).
        route: Number in the table counted after the free corridors, -1 where it is not to matter, shape (E,).
        mask: Bit k is set if lanes of kind k count.
        lane: Written: lane within its map, -1 if the map has none of these kinds, shape (E,).
        s: Written: arc length of the foot of the pose [m], shape (E,).
        t: Written: offset from the centreline, positive to the left [m], shape (E,).
        distance: Written: from the centreline [m]; larger than |t| behind a lane's end, shape (E,).
    """
    room = candidates()
    for i in range(len(maps)):
        corridor = table.free + route[i] if route[i] >= 0 else -1
        x, y = position[i, 0], position[i, 1]
        place = place_on_map(roads, table, maps[i], x, y, height[i], heading[i], corridor, mask, room)
        lane[i], s[i], t[i], distance[i], _ = place


@kernel
def project_on_lanes(
    roads: Roads, maps: Ints, lane: Ints, position: Floats, height: Floats, s: Floats, t: Floats
) -> None:
    """Write s and t [m] of positions with respect to given lanes, NaN where the lane is -1; shapes (E,)."""
    for i in range(len(maps)):
        s[i], t[i] = np.nan, np.nan
        if lane[i] < 0:
            continue
        number = roads.lane_base[maps[i]] + lane[i]
        first, last = roads.point_start[number], roads.point_start[number + 1] - 2
        x, y = position[i, 0], position[i, 1]
        point, _, square, _ = nearest_segment(roads, first, last, x, y, height[i])
        if square < np.inf:
            s[i], t[i], _ = place_on(roads, number, point, x, y)


@kernel
def poses_at(
    roads: Roads, maps: Ints, lane: Ints, s: Floats, t: Floats, position: Floats, heading: Floats
) -> None:
    """Write position [m] and heading [rad] at s, t [m] of given lanes, NaN where the lane is -1.

    A lane is extended straight beyond its ends.
    """
    for i in range(len(maps)):
        if lane[i] < 0:
            position[i, 0], position[i, 1], heading[i] = np.nan, np.nan, np.nan
            continue
        number = roads.lane_base[maps[i]] + lane[i]
        x, y, heading[i] = pose_on_lane(roads, number, s[i])
        position[i, 0] = x - t[i] * math.sin(heading[i])
        position[i, 1] = y + t[i] * math.cos(heading[i])


@kernel
def centre_at(roads: Roads, point: int, s: float) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] at arc length s on the line of the segment that begins at `point`."""
    a, b = roads.point_xy[point], roads.point_xy[point + 1]
    share = (s - roads.point_s[point]) / (roads.point_s[point + 1] - roads.point_s[point])
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), _heading_at(roads, point, s)


@kernel
def pose_on_lane(roads: Roads, lane: int, s: float) -> tuple[float, float, float]:
    """Return x, y [m] and heading [rad] of a lane's centreline at `s` [m]; see `centre_at`."""
    return centre_at(
        roads, segment_at(roads.point_s, roads.point_start[lane], roads.point_start[lane + 1], s), s
    )


@kernel
def height_at(roads: Roads, point: int, s: float) -> float:
    """Return the height [m] at arc length s on the line of the segment that begins at `point`."""
    share = (s - roads.point_s[point]) / (roads.point_s[point + 1] - roads.point_s[point])
    return roads.point_z[point] + share * (roads.point_z[point + 1] - roads.point_z[point])


@kernel
def distance_on_row(roads: Roads, table: RouteTable, row: int, s: float) -> float:
    """Return the distance along a route of arc length s on the lane of one of its rows [m]."""
    share = min(1.0, max(0.0, s / lane_length(roads, table.lane[row])))
    return table.begin[row] + share * (table.end[row] - table.begin[row])
