"""The arrays of native traffic: of the maps, their lights, and the simulations."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from smarts.providers.native.state import (
    ADVICES,
    LINKS,
    MAJOR,
    TAILS,
    Driven,
    Links,
    Occupancy,
    Signals,
    Traffic,
)
from smarts.roads.arrays import MOST_CANDIDATES
from smarts.roads.atlas import RoadAtlas
from smarts.roads.lane_graph import LaneGraph, Yields
from smarts.types import columns
from smarts.types.traffic import Signal
from smarts.types.world import World

TURN = 0.78
"""Lanes in junctions that turn by more lead off to a side [rad]."""
ENTRIES = 6
"""Lanes that a vehicle is on, on average, at most."""
_SHOWS = {"r": Signal.STOP, "u": Signal.STOP, "y": Signal.CAUTION, "Y": Signal.CAUTION, "g": Signal.GO}
_SHOWS |= {"s": Signal.STOP, "G": Signal.GO + MAJOR}


def make_traffic(world: World, atlas: RoadAtlas, owner: int) -> Traffic:
    """Return the arrays of native traffic.

    Args:
        world: The world.
        atlas: Its maps.
        owner: Number of the engine.
    """
    graphs, roads = atlas.graphs, atlas.roads
    shape, slots = world.vehicles.alive.shape, int(world.vehicles.capacity)
    worlds = world.worlds
    lanes = int(roads.lane_base[-1])
    links = [_csr(graphs, roads.lane_base, name) for name in ("successor", "predecessor")]
    siblings = _siblings(graphs, roads.lane_base)
    yields = np.isin(roads.conflict_yields, (Yields.THIS, Yields.BOTH))
    owners = np.repeat(np.arange(lanes), np.diff(roads.conflict_start))
    room: dict[str, int] = {
        "head": lanes,
        "approach": lanes,
        "taken": lanes,
        "green": lanes,
        "shown": lanes,
        "entries": 1,
    }
    room |= {name: slots for name in ("listed", "other_lane", "other_front", "speed")}
    kinds = columns.allocate(Occupancy, (0,))._asdict()
    entries = ENTRIES * slots + 16
    found: dict[str, NDArray] = {
        name: np.zeros(room.get(name, entries), kind.dtype) for name, kind in kinds.items()
    }
    found["head"][:] = found["approach"][:] = -1
    found["lanes"], found["points"] = (np.empty(MOST_CANDIDATES, np.int32) for _ in range(2))
    found["squares"] = np.empty(MOST_CANDIDATES)
    driven = columns.allocate(Driven, shape, (), {"tails": (TAILS,), "advice": (ADVICES,)})
    driven.generation[:], driven.conflicted[:] = -1, np.inf
    return Traffic(
        owner=int(owner),
        state=world.state,
        roads=roads,
        no_routes=atlas.no_routes,
        successor_start=links[0][0],
        successor=links[0][1],
        predecessor_start=links[1][0],
        predecessor=links[1][1],
        lane_length=np.concatenate([graph.length for graph in graphs]),
        lane_minor=np.bincount(owners[yields], minlength=lanes) > 0,
        lane_turns=np.concatenate([_turns(graph) for graph in graphs]),
        lane_signal=np.concatenate([graph.signal >= 0 for graph in graphs]),
        sibling_start=siblings[0],
        sibling=siblings[1],
        sibling_until=siblings[2],
        lane_leads=np.concatenate(
            [_leads(graph) + base for graph, base in zip(graphs, roads.edge_base, strict=False)]
        ).astype(np.int32),
        driven=driven,
        occupancy=Occupancy._make(found.values()),
        links=columns.allocate(Links, (slots, LINKS))._replace(total=np.zeros(slots, np.int32)),
        seed=np.zeros(worlds, np.int64),
        tick=np.zeros(worlds, np.int32),
        born=np.zeros(worlds, np.int32),
        limit=np.zeros(worlds, np.int32),
        flow_start=np.zeros(worlds, np.int32),
        flow_count=np.zeros(worlds, np.int32),
        ballistic=np.zeros(worlds, np.bool_),
        route_start=np.zeros(worlds, np.int32),
        is_full=np.zeros(worlds, np.bool_),
    )


def _csr(graphs: Sequence[LaneGraph], bases: NDArray, name: str) -> tuple[NDArray, NDArray]:
    counts = np.concatenate([np.diff(getattr(graph, f"{name}_start")) for graph in graphs])
    lanes = [getattr(graph, name) + base for graph, base in zip(graphs, bases, strict=False)]
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32), np.concatenate(lanes).astype(np.int32)


def _siblings(graphs: Sequence[LaneGraph], bases: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Return, as CSR, the lanes that begin where a lane in a junction does, and how far both go together."""
    start, found, until = [0], [], []
    for graph, base in zip(graphs, bases, strict=False):
        for lane, inside in enumerate(graph.is_internal.tolist()):
            before = graph.predecessors(lane).tolist() if inside else []
            for other in sorted(
                {each for road in before for each in graph.successors(road).tolist()} - {lane}
            ):
                apart = graph.centreline(lane)[:, None] - graph.centreline(other)
                gap = np.hypot(apart[..., 0], apart[..., 1]).min(axis=1)
                far = np.flatnonzero(gap > 0.5 * (graph.width[lane] + graph.width[other]))
                along = graph.point_s[graph.point_start[lane] :]
                found.append(other + base)
                until.append(along[far[0]] if len(far) else graph.length[lane])
            start.append(len(found))
    return np.array(start, np.int32), np.array(found, np.int32), np.array(until, np.float64)


def _turns(graph: LaneGraph) -> NDArray:
    """Return which lanes turn off in a junction; of ways of two lanes, both count."""
    first, last = graph.point_start[:-1], graph.point_start[1:] - 1
    turned = np.abs(np.arctan2(*_sine_cosine(graph.point_heading[last] - graph.point_heading[first])))
    found = graph.is_internal & (turned > TURN)
    for lane in np.flatnonzero(graph.is_internal).tolist():
        for following in graph.successors(lane).tolist():
            if graph.is_internal[following]:
                angle = graph.point_heading[last[following]] - graph.point_heading[first[lane]]
                found[[lane, following]] |= abs(float(np.arctan2(*_sine_cosine(angle)))) > TURN
    return found


def _sine_cosine(angle: NDArray) -> tuple[NDArray, NDArray]:
    return np.sin(angle), np.cos(angle)


def _leads(graph: LaneGraph) -> NDArray:
    """Return the edge that each lane is of, or leads into from a junction."""
    found = np.array(graph.lane_edge, np.int64)
    for lane in np.flatnonzero(graph.is_internal).tolist():
        following = lane
        for _ in range(4):
            onward = graph.successors(following)
            if not graph.is_internal[following] or not len(onward):
                break
            following = int(onward[0])
        found[lane] = graph.lane_edge[following]
    return found


def read_signals(graphs: Sequence[LaneGraph], bases: NDArray, nets: Sequence[Path | None]) -> Signals:
    """Return the programs of the lights of all maps.

    Args:
        graphs: The maps.
        bases: Number of their first lanes.
        nets: Their networks, None where the lights are not known yet.
    """
    starts, firsts, lanes, lights, columns, before = [0], [0], [], [], [], []
    phases, least, most, offsets, shows = [0], [], [], [], []
    for graph, base, net in zip(graphs, bases, nets, strict=False):
        programs = {} if net is None else _programs(net)
        for name in graph.signal_ids:
            program = programs.get(name)
            offsets.append(float(program.get("offset", "0")) if program is not None else 0.0)
            parts = [] if program is None else program.findall("phase")
            given = [float(phase.attrib["duration"]) for phase in parts] or [np.inf]
            waits = program is not None and program.get("type") == "actuated"
            shortest, longest = (
                [float(phase.get(bound, phase.attrib["duration"])) for phase in parts] if waits else given
                for bound in ("minDur", "maxDur")
            )
            least += shortest
            most += longest
            shows += [[_SHOWS.get(each, 0) for each in phase.attrib["state"]] for phase in parts] or [[]]
            phases.append(len(least))
        with_light = np.flatnonzero(graph.signal >= 0)
        lanes += (with_light + base).tolist()
        before += [int(base + (*graph.predecessors(lane), lane)[0]) for lane in with_light.tolist()]
        lights += (graph.signal[with_light] + firsts[-1]).tolist()
        columns += graph.signal_link[with_light].tolist()
        starts.append(len(lanes))
        firsts.append(len(offsets))
    wide = np.zeros(
        (max(len(shows), 1), max([1, *map(len, shows), *(column + 1 for column in columns)])), np.int8
    )
    for row, states in enumerate(shows):
        wide[row, : len(states)] = states
    whole = (np.array(each, np.int32) for each in (starts, lanes, lights, columns, firsts, phases))
    times = (np.array(each, np.float64) for each in (least, most, offsets))
    return Signals._make([*whole, *times, np.array(before, np.int32), wide])


def _programs(net: Path) -> dict[str, ElementTree.Element]:
    """Return the first program of each light of a network."""
    found: dict[str, ElementTree.Element] = {}
    for element in ElementTree.parse(net).getroot().iterfind("tlLogic"):
        found.setdefault(element.attrib["id"], element)
    return found
