"""The lane graph: a road map as flat arrays.

Axis letters: L lanes (those inside junctions included), E edges, J junctions, S signals, P points of
centrelines, N lane-to-lane links, C conflicts. A CSR array `x_start` of shape (L + 1,) says that lane i owns
rows `x_start[i]:x_start[i + 1]` of the arrays beside it.
"""

from __future__ import annotations

import enum
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.errors import MapError, nearest_names
from smarts.geometry.frames import wrap_angle

FORMAT = 3
"""Format of the saved file; files of another format are rebuilt."""
OTHER_LENGTH, SHORTEST_OTHER = 0.02, 0.5
"""A road's given length is another than its lanes' if it differs by more than this share and this far [m]."""
SHORTEST = 0.1
"""Length of SUMO's shortest lanes [m]."""
HEIGHT_REACH = 3.0
"""Roads and vehicles that differ by more in height do not meet [m]."""
OPPOSITE = -0.7
"""Cosine of the angle between two lanes that lead in other directions, at most."""


class LaneKind(enum.IntEnum):
    """The most general traffic that a lane is open to."""

    CAR = 0
    """Open to passenger cars, and usually to everything."""
    BUS = 1
    """Open to buses but not to cars."""
    BICYCLE = 2
    """Open to bicycles but to no car or bus."""
    FOOT = 3
    """Sidewalks, pedestrian crossings and waiting areas."""
    RAIL = 4
    SHOULDER = 5
    CLOSED = 6
    """Open to no road user above."""


class ConflictKind(enum.IntEnum):
    """Kinds of conflicts between two lanes."""

    CROSS = 0
    """They lead into different lanes."""
    MERGE = 1
    """They lead into the same lane."""


class Yields(enum.IntEnum):
    """Which traffic of two lanes that conflict has to give way, by signs and rules; lights come on top."""

    NEITHER = 0
    """The map does not say, as where two lanes merge like a zip, or where lights decide."""
    THIS = 1
    """This lane's."""
    OTHER = 2
    """The other lane's."""
    BOTH = 3
    """Each to the other, at all-way stops: all have to stop, then they take turns."""


@dataclass(frozen=True, eq=False)
class LaneGraph:
    """A road map. Lanes of one edge are consecutive rows, from the rightmost (index 0) to the leftmost.

    Lanes inside junctions are lanes like others: a path from road to road is road lane, junction lane, in
    some left turns a second junction lane after the waiting point, road lane. Positions s along a lane are
    arc lengths of its centreline as drawn; `sumo_length` converts to the positions of the map's file,
    `driven_length` to those of SUMO.
    """

    lane_ids: tuple[str, ...]
    edge_ids: tuple[str, ...]
    junction_ids: tuple[str, ...]
    signal_ids: tuple[str, ...]

    lane_edge: Ints
    """Edge of each lane, shape (L,)."""
    lane_index: Ints
    """Place across the road, 0 is the rightmost, shape (L,)."""
    lane_junction: Ints
    """Junction that the lane lies in, -1 for road lanes, shape (L,)."""
    length: Floats
    """Arc length of the centreline [m], shape (L,)."""
    sumo_length: Floats
    """Length that the map gives [m], by which scenarios' positions reckon: s * sumo_length / length, shape
    (L,)."""
    width: Floats
    """[m], shape (L,)."""
    speed_limit: Floats
    """[m/s], shape (L,)."""
    left: Ints
    """Next lane to the left in the same direction, -1 where there is none, shape (L,)."""
    right: Ints
    """Next lane to the right in the same direction, -1 where there is none, shape (L,)."""
    opposite: Ints
    """Lane of the other direction that may be used for overtaking, -1 where there is none, shape (L,)."""
    is_internal: Bools
    """Whether the lane lies inside a junction, shape (L,)."""
    kind: Bytes
    """A `LaneKind`, shape (L,)."""
    signal: Ints
    """Signal that governs entering this junction lane, -1 where none does, shape (L,)."""
    signal_link: Ints
    """Index among that signal's lights, -1 for none, shape (L,)."""

    point_start: Ints
    """CSR of the centreline's points, shape (L + 1,)."""
    point_xy: Floats
    """[m], at most a metre apart, every vertex of the map's own centreline among them, shape (P, 2)."""
    point_z: Floats
    """Height above the map's origin [m], shape (P,)."""
    point_heading: Floats
    """Smoothed direction of the centreline [rad], shape (P,)."""
    point_s: Floats
    """Arc length from the lane's begin, in the plane [m], shape (P,)."""

    successor_start: Ints
    """CSR of the lanes that a lane leads into, shape (L + 1,)."""
    successor: Ints
    """Shape (N,)."""
    predecessor_start: Ints
    """CSR of the lanes that lead into a lane, shape (L + 1,)."""
    predecessor: Ints
    """Shape (N,)."""

    conflict_start: Ints
    """CSR of the junction lanes whose traffic may meet this lane's, shape (L + 1,)."""
    conflict_lane: Ints
    """The other lane, shape (C,)."""
    conflict_kind: Bytes
    """A `ConflictKind`, shape (C,)."""
    conflict_yields: Bytes
    """A `Yields`, shape (C,)."""
    conflict_extent: Floats
    """Extent of the overlap along this lane, from and to [m], shape (C, 2)."""
    conflict_other_extent: Floats
    """The same along the other lane [m], shape (C, 2)."""

    edge_first_lane: Ints
    """Row of the edge's rightmost lane, shape (E,)."""
    edge_lane_count: Ints
    """Shape (E,)."""
    edge_is_internal: Bools
    """Whether the edge lies inside a junction, shape (E,)."""
    edge_is_roundabout: Bools
    """Whether the edge is part of a roundabout's ring, shape (E,)."""
    edge_from: Ints
    """Junction where the edge begins, -1 for edges inside junctions, shape (E,)."""
    edge_to: Ints
    """Junction where the edge ends, -1 for edges inside junctions, shape (E,)."""

    junction_start: Ints
    """CSR of the junctions' outlines, shape (J + 1,)."""
    junction_xy: Floats
    """Vertices of the outlines [m]; a junction without area has none, shape (., 2)."""
    junction_z: Floats
    """Height [m], shape (J,)."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value.flags.writeable = False

    @cached_property
    def _edge_numbers(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.edge_ids)}

    @cached_property
    def _lane_numbers(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.lane_ids)}

    @cached_property
    def driven_length(self) -> Floats:
        """Length by which SUMO drives [m]: its position is s * driven_length / length, shape (L,).

        It is the one that the map gives, but for roads where this is not that of their lanes as drawn, on
        average: vehicles are as long as they are, so SUMO's gaps between them have to be those on the map.
        """
        count = np.maximum(self.edge_lane_count, 1)
        drawn = (np.bincount(self.lane_edge, self.length, len(count)) / count)[self.lane_edge]
        differs = np.abs(self.sumo_length - drawn) > np.maximum(OTHER_LENGTH * drawn, SHORTEST_OTHER)
        return np.where(differs & ~self.is_internal, np.maximum(drawn, SHORTEST), self.sumo_length)

    @property
    def road_edges(self) -> tuple[str, ...]:
        """Ids of the edges that are not inside junctions."""
        return tuple(
            name for name, inside in zip(self.edge_ids, self.edge_is_internal, strict=True) if not inside
        )

    def edge_number(self, edge_id: str) -> int:
        """Return the row of an edge.

        Raises:
            MapError: There is no such edge; the remedy names the nearest ones.
        """
        number = self._edge_numbers.get(edge_id)
        if number is None:
            raise MapError(f"there is no edge '{edge_id}'", remedy=nearest_names(edge_id, self.road_edges))
        return number

    def lane_number(self, edge_id: str, index: int) -> int:
        """Return the row of an edge's lane, `index` counted from the right.

        Raises:
            MapError: There is no such edge or lane.
        """
        edge = self.edge_number(edge_id)
        count = int(self.edge_lane_count[edge])
        if not 0 <= index < count:
            lanes = "only lane 0" if count == 1 else f"lanes 0..{count - 1}"
            raise MapError(
                f"edge '{edge_id}' has no lane {index}",
                remedy=f"edge '{edge_id}' has {lanes}, counted from the right",
            )
        return int(self.edge_first_lane[edge]) + index

    def lane_of_id(self, lane_id: str) -> int:
        """Return the row of the lane with SUMO's id, such as "approach_0".

        Raises:
            MapError: There is no such lane.
        """
        number = self._lane_numbers.get(lane_id)
        if number is None:
            raise MapError(f"there is no lane '{lane_id}'", remedy=nearest_names(lane_id, self.lane_ids))
        return number

    def edge_lanes(self, edge: int) -> range:
        """Return the rows of an edge's lanes, from the right."""
        first = int(self.edge_first_lane[edge])
        return range(first, first + int(self.edge_lane_count[edge]))

    def successors(self, lane: int) -> Ints:
        """Return the lanes that a lane leads into."""
        return self.successor[self.successor_start[lane] : self.successor_start[lane + 1]]

    def predecessors(self, lane: int) -> Ints:
        """Return the lanes that lead into a lane."""
        return self.predecessor[self.predecessor_start[lane] : self.predecessor_start[lane + 1]]

    def ways_from(self, lane: int, usable: Bools | None = None) -> Iterator[list[int]]:
        """Yield the ways from a lane through the junction at its end: lanes inside it, and the one behind.

        Args:
            lane: Its end.
            usable: Which lanes may be used; None for all.
        """
        for following in self.successors(lane).tolist():
            if usable is not None and not usable[following]:
                continue
            onward = self.ways_from(following, usable) if self.is_internal[following] else [[]]
            yield from ([following, *way] for way in onward)

    def way_across(self, lane: int) -> list[int]:
        """Return a lane and, of one in a junction, those behind it, as far as to the first road lane."""
        lanes = [lane]
        while self.is_internal[lanes[-1]] and len(after := self.successors(lanes[-1])):
            lanes.append(int(after[0]))
        return lanes

    @cached_property
    def has_levels(self) -> bool:
        """Whether roads may lead over others: heights differ by more than `HEIGHT_REACH`."""
        return bool(np.ptp(self.point_z) > HEIGHT_REACH)

    def height_at(self, lane: int, s: float) -> float:
        """Return the height of a lane at arc length `s` [m]."""
        rows = slice(int(self.point_start[lane]), int(self.point_start[lane + 1]))
        return float(np.interp(s, self.point_s[rows], self.point_z[rows]))

    def centreline(self, lane: int) -> Floats:
        """Return a lane's points [m], shape (., 2)."""
        return self.point_xy[self.point_start[lane] : self.point_start[lane + 1]]

    def arc_length(self, lane: int, position: float) -> float:
        """Return the arc length s [m] of a scenario's position [m] on a lane."""
        return position * float(self.length[lane] / self.sumo_length[lane])

    def junction_outline(self, junction: int) -> Floats:
        """Return the vertices of a junction's area [m], shape (., 2)."""
        return self.junction_xy[self.junction_start[junction] : self.junction_start[junction + 1]]

    def pose_at(self, lane: int, s: float, t: float = 0.0) -> tuple[float, float, float]:
        """Return x, y [m] and heading [rad] at arc length `s` [m], `t` [m] to the left of the centreline.

        The offset is square to the smoothed heading. The lane is extended straight beyond its ends. For many
        poses there is `RoadAtlas.poses`; this one needs no compiled code, whose import takes longer than
        building a scenario from the cache.
        """
        rows = slice(int(self.point_start[lane]), int(self.point_start[lane + 1]))
        stations, points, directions = self.point_s[rows], self.point_xy[rows], self.point_heading[rows]
        segment = min(max(int(np.searchsorted(stations, s, side="right")) - 1, 0), len(stations) - 2)
        span = stations[segment + 1] - stations[segment]
        share = (s - stations[segment]) / span if span > 0 else 0.0
        turn = -wrap_angle(directions[segment] - directions[segment + 1])
        heading = wrap_angle(float(directions[segment] + min(max(share, 0.0), 1.0) * turn))
        x, y = points[segment] + share * (points[segment + 1] - points[segment])
        return float(x - t * np.sin(heading)), float(y + t * np.cos(heading)), heading

    def save(self, path: Path) -> None:
        """Write the graph to one file; equal graphs give equal bytes."""
        arrays: dict[str, NDArray] = {"format": np.array(FORMAT)}
        for field in fields(self):
            value = getattr(self, field.name)
            arrays[field.name] = value if isinstance(value, np.ndarray) else _pack(value)
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        path.write_bytes(buffer.getvalue())

    @classmethod
    def load(cls, path: Path) -> LaneGraph:
        """Read a saved graph.

        Raises:
            MapError: The file is missing, damaged, or of another version of this program.
        """
        remedy = "delete the scenario's build folder; it is then rebuilt"
        try:
            with np.load(path, allow_pickle=False) as file:
                if int(file["format"]) != FORMAT:
                    raise MapError(
                        "written by another version of this program", place=str(path), remedy=remedy
                    )
                values: dict[str, Any] = {field.name: file[field.name] for field in fields(cls)}
        except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
            raise MapError(f"not a saved lane graph: {error}", place=str(path), remedy=remedy) from error
        for name in (name for name in values if name.endswith("_ids")):
            values[name] = _unpack(values[name])
        return cls(**values)


def _pack(names: Sequence[str]) -> NDArray[np.uint8]:
    # One line each: SUMO forbids whitespace in ids.
    return np.frombuffer("\n".join(names).encode(), np.uint8)


def _unpack(packed: NDArray[np.uint8]) -> tuple[str, ...]:
    return tuple(packed.tobytes().decode().split("\n")) if len(packed) else ()
