"""Vehicles of SUMO that lean to their lane, because they changed lanes while they hardly drove.

With lane changes that take time (`lanechange.duration`), SUMO moves a vehicle's front sideways, even if the
vehicle stands, and turns the vehicle as if its tail were pulled along. Its drivers, however, find the whole
vehicle where its front is: once that is in its new lane, they drive past in the old one, through the tail. So
the tail of a slow vehicle is shown near where SUMO's drivers assume it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Floats, Ints
from smarts.geometry.binding import LateBound, bind
from smarts.geometry.compiling import kernel
from smarts.geometry.segments import project, wrapped
from smarts.providers.gates import chord_pose
from smarts.providers.sumo_library import SumoLibrary
from smarts.roads.lane_graph import LaneGraph
from smarts.types.vehicles import VehicleStates

SLOW = 5.0
"""Faster vehicles do not lean enough to meet others [m/s]."""
REACH, REACH_PER_SPEED = 0.4, 0.25
"""How far a tail may reach over the line into the lane that the vehicle has left [m], and how much farther
for each m/s: a vehicle that moves is past others before they come up."""
HELD = 4.0
"""How much farther for each metre that the front, too, is over the line: SUMO then keeps others away."""


class LaneLines(NamedTuple):
    """What `straighten` reads of a map; arrays as in `LaneGraph`."""

    xy: Floats
    s: Floats
    start: Ints
    width: Floats
    left: Ints
    right: Ints
    is_internal: Bools


class Straightening:
    """Limits how far the tails of one simulation's vehicles reach into lanes that they have left.

    Args:
        library: The copy of libsumo that runs the simulation.
        states: Vehicles of the simulation.
        is_new: Whether SUMO has had the vehicle in a row for one step only, shape (V,).
    """

    def __init__(self, library: SumoLibrary, states: VehicleStates, is_new: Bools) -> None:
        self._library = library
        self._fronts, turned = np.zeros((states.capacity, 2)), np.zeros(states.capacity)
        self._find = bind(find_slow, states, is_new, self._fronts, turned)
        self._straighten = LateBound(straighten, states, turned)
        self._bound_to: LaneGraph | None = None

    def reset(self, roads: LaneGraph) -> None:
        """Begin an episode on a map."""
        self._fronts[:] = np.inf
        if roads is not self._bound_to:
            self._roads = self._bound_to = roads
            parts = roads.point_xy, roads.point_s, roads.point_start
            parts += roads.width, roads.left, roads.right, roads.is_internal
            self._turn = self._straighten.to(LaneLines._make(map(np.array, parts)))

    def apply(self, driven: Mapping[str, int], rows: NDArray[np.intp], values: Floats) -> None:
        """Change SUMO's angles in `values`; arguments as in `DrivenRows.read` and for `fill_rows`."""
        slow = self._find(rows, values)
        if len(slow):
            names, number, find = [*driven], self._roads.lane_of_id, self._library.vehicle.getLaneID
            lanes = np.array([number(find(names[index])) for index in slow.tolist()], np.int32)
            self._turn(rows, values, slow, lanes)


@kernel
def find_slow(
    states: VehicleStates,
    is_new: Bools,
    fronts: Floats,
    turned: Floats,
    rows: NDArray[np.intp],
    values: Floats,
) -> NDArray[np.intp]:
    """Turn vehicles as a step ago, less what their way since then has straightened; return which are slow.

    Args:
        states: Vehicles of one simulation.
        is_new: Whether SUMO had the vehicle in a row not a step ago, shape (V,).
        fronts: Where SUMO had their fronts a step ago [m], inf of those that it did not drive, shape (V, 2);
            written.
        turned: Changes of SUMO's angles [degrees], shape (V,); written.
        rows: The rows of A vehicles.
        values: SUMO's, see `fill_rows`; angles are written.

    Returns:
        Indices of those of the A vehicles that are slow, but do not stand as a step ago.
    """
    count, found = len(rows), 0
    slow, before = np.empty(count, np.intp), fronts.copy()
    # An agent may take a vehicle over, and SUMO take it back or another one in its row.
    fronts[:] = np.inf
    for index in range(count):
        row, x, y = rows[index], values[2 * index], values[2 * index + 1]
        way = math.hypot(x - before[row, 0], y - before[row, 1])
        # So swings in a tail that is pulled along.
        turned[row] *= 0.0 if is_new[row] else max(1.0 - way / states.length[row], 0.0)
        if turned[row] != 0.0:
            values[2 * count + index] += turned[row]
        if (is_new[row] or way > 0.0) and values[3 * count + index] < SLOW:
            slow[found] = index
            found += 1
        fronts[row, 0], fronts[row, 1] = x, y
    return slow[:found]


@kernel
def straighten(
    states: VehicleStates,
    turned: Floats,
    lines: LaneLines,
    rows: NDArray[np.intp],
    values: Floats,
    slow: NDArray[np.intp],
    lanes: Ints,
) -> None:
    """Turn vehicles about their fronts, to where their tails reach no farther than they may.

    Args:
        states: Vehicles of one simulation.
        turned: As for `find_slow`; written.
        lines: Lines of the map.
        rows: The rows of A vehicles.
        values: SUMO's, see `fill_rows`; angles are written.
        slow: Which of them are slow, shape (N,).
        lanes: On which their fronts are, shape (N,).
    """
    count = len(rows)
    for number in range(len(slow)):
        index, lane = slow[number], lanes[number]
        row, speed = rows[index], values[3 * count + index]
        if lines.is_internal[lane]:
            continue
        begin, end = lines.start[lane], lines.start[lane + 1]
        length, width, line = states.length[row], states.width[row], 0.5 * lines.width[lane]
        station, offset = _place(lines, begin, end, values[2 * index], values[2 * index + 1])
        if station < length:
            continue
        heading = (90.0 - values[2 * count + index]) * (math.pi / 180.0)
        lean = wrapped(heading - chord_pose(lines.xy, lines.s, begin, end, station, length, offset)[2])
        side = 1.0 if lean > 0.0 else -1.0
        if (lines.right[lane] if lean > 0.0 else lines.left[lane]) < 0:
            continue
        # How far the front is towards the side on which the tail is.
        over = -side * offset
        room = line + REACH + REACH_PER_SPEED * speed + HELD * max(over + 0.5 * width - line, 0.0)
        most = most_lean(length, width, room - over)
        if abs(lean) > most:
            turn = side * (abs(lean) - most) * (180.0 / math.pi)
            turned[row] += turn
            values[2 * count + index] += turn


@kernel
def most_lean(length: float, width: float, room: float) -> float:
    """Return by how much a vehicle may be turned about its front so that its tail stays within `room`.

    Args:
        length: Length of the vehicle [m].
        width: Width of the vehicle [m].
        room: Room from the middle of its front to either side [m].
    """
    # A corner of the tail is length * sin(lean) + width / 2 * cos(lean) aside.
    corner, at_rest = math.hypot(length, 0.5 * width), math.atan2(0.5 * width, length)
    return max(math.asin(min(max(room / corner, 0.0), 1.0)) - at_rest, 0.0)


@kernel
def _place(lines: LaneLines, begin: int, end: int, x: float, y: float) -> tuple[float, float]:
    """Return arc length and offset to the left of a point's nearest place on a line [m, m]."""
    nearest, station, offset = np.inf, 0.0, 0.0
    for point in range(begin, end - 1):
        a, b = lines.xy[point], lines.xy[point + 1]
        share, square, cross = project(x, y, a[0], a[1], b[0], b[1])
        if square < nearest:
            span = lines.s[point + 1] - lines.s[point]
            nearest, station, offset = square, lines.s[point] + share * span, cross / max(span, 1e-9)
    return station, offset
