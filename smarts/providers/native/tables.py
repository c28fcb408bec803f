"""The arrays of native traffic: of the maps, their lights, and the simulations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from smarts.arrays import Floats
from smarts.geometry.polylines import arc_lengths
from smarts.providers.native import state
from smarts.providers.native.demand import Built
from smarts.providers.native.state import Records, Traffic
from smarts.roads.arrays import MOST_CANDIDATES
from smarts.roads.atlas import RoadAtlas
from smarts.roads.lane_graph import ConflictKind, LaneGraph, Yields
from smarts.types.world import World

TURN = 0.78
"""Lanes in junctions that turn by more lead off to a side [rad]."""
APART, NOWHERE = 2.5, -1e4
"""Lanes that begin or end side by side go together until their centrelines are so far apart [m]; place where
lanes meet that do not."""
ENTRIES = state.TAILS + 3
"""Entries of a vehicle of the engine at most: its lane, its tail's, the one beside, the one it changes to."""


def make_traffic(world: World, atlas: RoadAtlas, owner: int, built: Built) -> Traffic:
    """Return the arrays of native traffic.

    Args:
        world: The world.
        atlas: Its maps.
        owner: Number of the engine.
        built: What is known of scenarios so far.
    """
    graphs, roads, (worlds, slots) = atlas.graphs, atlas.roads, world.vehicles.alive.shape
    new_car = np.zeros(1, state.CAR)
    new_car["driver"] = new_car["tails"] = -1
    for name in ("entered", "first_entered", "conflicted"):
        new_car[name] = np.inf
    new_car["is_own"], new_car["next_action"], new_car["factor"] = True, -np.inf, 1.0
    conflicts = np.zeros(len(roads.conflict_lane), state.CONFLICT)
    for name in ("lane", "kind", "yields"):
        conflicts[name] = getattr(roads, f"conflict_{name}")
    cars = np.repeat(new_car, worlds * slots)
    cars["place"] = np.arange(len(cars))
    cars["sim"], cars["slot"] = np.divmod(cars["place"], slots)
    meetings = np.concatenate([_meetings(graph) for graph in graphs])
    for name, column in zip(("begin", "end", "its_begin", "its_end"), meetings.T, strict=True):
        conflicts[name] = column
    lanes, siblings = _make_lanes(atlas)
    # Another provider's may lie on its lane, those beside, and all that lead there or on from there.
    most = max(ENTRIES, 3 + int((np.diff(lanes["successors"]) + np.diff(lanes["predecessors"])).max()))
    search = np.empty(MOST_CANDIDATES, np.int32), np.empty(MOST_CANDIDATES, np.int32)
    return Traffic(
        owner=int(owner),
        dt=world.dt,
        map=world.map,
        signals=world.signals,
        vehicles=world.vehicles,
        used=world.registry.used,
        placed=world.placed,
        roads=roads,
        no_routes=atlas.no_routes,
        sims=np.zeros(worlds, state.SIMULATION),
        cars=cars,
        by_slot=cars.reshape(worlds, slots),
        new_car=new_car,
        driven=np.full((worlds, slots), -1, np.int32),
        order=np.zeros(slots, np.int32),
        lanes=lanes,
        successor=_across(graphs, roads.lane_base, "successor"),
        predecessor=_across(graphs, roads.lane_base, "predecessor"),
        siblings=siblings,
        conflicts=conflicts,
        links=np.zeros((slots, state.LINKS), state.LINK),
        entries=np.zeros(most * slots, state.ENTRY),
        counts=np.zeros(2, np.int32),
        room=(*search, np.empty(MOST_CANDIDATES)),
        **built.tables(worlds),
    )


def _across(graphs: Sequence[LaneGraph], bases: NDArray, name: str) -> NDArray:
    """Return the lanes of a CSR of all maps, numbered across them."""
    lanes = [getattr(graph, name) + base for graph, base in zip(graphs, bases, strict=False)]
    return np.concatenate(lanes).astype(np.int32)


def _make_lanes(atlas: RoadAtlas) -> tuple[Records, Records]:
    """Return the lanes of all maps, and those in junctions that begin where others do."""
    graphs, roads = atlas.graphs, atlas.roads
    count, bases = int(roads.lane_base[-1]), roads.lane_base
    lanes = np.zeros(count + 1, state.LANE)
    own = lanes[:count]
    own["length"] = np.concatenate([graph.length for graph in graphs])
    own["lit"] = np.concatenate([graph.signal >= 0 for graph in graphs])
    own["turns"] = np.concatenate([_turns(graph) for graph in graphs])
    own["waits"] = np.concatenate([_waits(graph) for graph in graphs])
    for name in ("width", "speed", "left", "right", "inside", "junction"):
        own[name] = getattr(roads, f"lane_{name}")
    yields = np.isin(roads.conflict_yields, (Yields.THIS, Yields.BOTH))
    owners = np.repeat(np.arange(count), np.diff(roads.conflict_start))
    own["minor"] = np.bincount(owners[yields], minlength=count) > 0
    lanes["conflicts"] = roads.conflict_start
    for name in ("successor", "predecessor"):
        counts = [np.diff(getattr(graph, f"{name}_start")) for graph in graphs]
        lanes[f"{name}s"][1:] = np.cumsum(np.concatenate(counts))
    found = []
    for graph, base in zip(graphs, bases, strict=False):
        for lane in range(len(graph.lane_ids)):
            own["leads"][base + lane] = roads.lane_edge[base + graph.way_across(lane)[-1]]
            found += [(other + base, until) for other, until in _siblings(graph, lane)]
            lanes["siblings"][base + lane + 1] = len(found)
    lanes["head"] = lanes["approach"] = -1
    return lanes, np.array(found, state.SIBLING)


def _siblings(graph: LaneGraph, lane: int) -> list[tuple[int, float]]:
    """Return the lanes that begin where a lane in a junction does, and how far both go together."""
    before = graph.predecessors(lane).tolist() if graph.is_internal[lane] else []
    others = sorted({each for road in before for each in graph.successors(road).tolist()} - {lane})
    return [(other, _together(graph.centreline(lane), graph.centreline(other))) for other in others]


def _together(line: Floats, other: Floats) -> float:
    """Return how far two lines that begin side by side go together [m] (`computeDistToDivergence`)."""
    found, lengths = [], []
    for one, its in ((line, other), (other, line)):
        gap = np.asarray(shapely.distance(shapely.points(one), shapely.LineString(its)))
        along = arc_lengths(one)
        last = int(np.flatnonzero(np.append(-np.inf, gap) <= APART)[-1])
        ends = slice(max(last - 1, 0), last + 1)
        found.append(np.interp(APART, gap[ends], along[ends]))
        lengths.append(along[-1])
    return float(min(max(found), *lengths))


def _meetings(graph: LaneGraph) -> Floats:
    """Return begin and end of each conflict along both lanes [m], shape (C, 4) (`setRequestInformation`)."""
    lanes = np.repeat(np.arange(len(graph.lane_ids)), np.diff(graph.conflict_start))
    found = np.full((len(lanes), 2, 2), NOWHERE)
    for place, pair in enumerate(zip(lanes.tolist(), graph.conflict_lane.tolist(), strict=True)):
        lines, length = [graph.centreline(lane) for lane in pair], graph.length[list(pair)]
        if graph.conflict_kind[place] == ConflictKind.MERGE:
            found[place, :, 0], found[place, :, 1] = (
                length - _together(lines[0][::-1], lines[1][::-1]),
                length,
            )
            continue
        own, other = (shapely.LineString(line) for line in lines)
        points = np.asarray(shapely.points(shapely.get_coordinates(own.intersection(other))))
        if len(points):
            middle = [float(np.max(shapely.line_locate_point(shape, points))) for shape in (own, other)]
            turn = graph.pose_at(pair[0], middle[0])[2] - graph.pose_at(pair[1], middle[1])[2]
            size = graph.width[list(pair[::-1])] * (2.0 / max(abs(np.sin(turn)), 0.2) - 1.0)
            size = np.minimum(size, length)
            found[place, :, 0] = np.maximum(middle - 0.5 * size, 0.0)
            found[place, :, 1] = found[place, :, 0] + size
    return found.reshape(-1, 4)


def _turns(graph: LaneGraph) -> NDArray:
    """Return which lanes turn off in a junction; of ways of two lanes, both count."""
    first, last = graph.point_heading[graph.point_start[:-1]], graph.point_heading[graph.point_start[1:] - 1]

    def is_turn(angle: Any) -> Any:
        return np.abs(np.arctan2(np.sin(angle), np.cos(angle))) > TURN

    found = graph.is_internal & is_turn(last - first)
    for lane in np.flatnonzero(_waits(graph)).tolist():
        for following in graph.successors(lane).tolist():
            if graph.is_internal[following]:
                found[[lane, following]] |= is_turn(last[following] - first[lane])
    return found


def _waits(graph: LaneGraph) -> NDArray:
    """Return which lanes inside junctions lead to another one: a driver may wait between both."""
    found = np.zeros(len(graph.lane_ids), np.bool_)
    for lane in np.flatnonzero(graph.is_internal).tolist():
        onward = graph.successors(lane)
        found[lane] = len(onward) > 0 and graph.is_internal[onward[0]]
    return found
