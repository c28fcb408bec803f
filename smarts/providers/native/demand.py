"""The vehicle types, routes and flows of a scenario, from the route files that its build wrote for SUMO."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from smarts.errors import TrafficError
from smarts.providers.native import state
from smarts.providers.native.departing import DRAWN, TAIL_AT_BEGIN
from smarts.providers.native.ways import Stop, route_rows
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.routes import shortest_route
from smarts.roads.sumo_net import read_responses
from smarts.sstudio.sumo_files import clock_seconds, left_out
from smarts.types.traffic import Signal, TrafficFiles
from smarts.types.vehicles import VehicleKind

_SIZES = {
    "passenger": (5.0, 1.8),
    "bus": (12.0, 2.5),
    "coach": (14.0, 2.6),
    "truck": (7.1, 2.4),
    "trailer": (16.5, 2.55),
    "motorcycle": (2.2, 0.9),
    "bicycle": (1.6, 0.65),
    "pedestrian": (0.215, 0.478),
}
"""Length and width of SUMO's vehicle classes [m]."""
_DEFAULTS = {
    **{"accel": 2.6, "decel": 4.5, "tau": 1.0, "sigma": 0.5, "minGap": 2.5, "maxSpeed": 55.56},
    **{"actionStepLength": 0.0, "lcStrategic": 1.0, "lcCooperative": 1.0, "lcSpeedGain": 1.0},
    **{"lcKeepRight": 1.0, "lcAssertive": 1.0, "impatience": 0.0, "jmTimegapMinor": 1.0},
    **{"jmIgnoreJunctionFoeProb": 0.0, "jmDriveAfterRedTime": -1.0, "jmDriveAfterYellowTime": -1.0},
}
"""SUMO's attributes and their defaults, in the order of `VEHICLE_TYPE`."""
_SHOWS = {"r": Signal.STOP, "u": Signal.STOP, "y": Signal.CAUTION, "Y": Signal.CAUTION, "g": Signal.GO}
_SHOWS |= {"s": Signal.STOP, "G": Signal.GO + state.MAJOR}
_PLACES = {"base": TAIL_AT_BEGIN, "last": TAIL_AT_BEGIN, "stop": TAIL_AT_BEGIN}
_PLACES |= {"random": DRAWN, "free": DRAWN, "random_free": DRAWN}
"""Names of places of departures."""
_NORMAL = re.compile(r"normc?\((.*)\)")
_STOP_LENGTH = 0.2
"""Length of a stop that is given by its end only [m]."""


class Built:
    """What native traffic knows of scenarios: their types, rows of routes, flows, and lights.

    Args:
        maps: The maps, by their number in the atlas.
        dt: Length of a step [s].
    """

    def __init__(self, maps: Sequence[LaneGraph], dt: float) -> None:
        self._maps, self._dt = tuple(maps), dt
        self._base = np.cumsum([0, *(len(graph.lane_ids) for graph in maps)]).tolist()
        self._rows: dict[str, list[Any]] = {name: [] for name in state.TABLES}
        """Rows of the tables, by their names in `Traffic`."""
        self._rows["map_lights"] = [(0, 0, 0, 0)] * len(self._maps)
        self._shows: list[list[int]] = []
        self.routes: list[tuple[int, ...]] = []
        """Edges of each route."""
        self._route_numbers: dict[tuple[Any, ...], tuple[int, int]] = {}
        self._files: dict[tuple[int, tuple[Path, ...]], tuple[range, range]] = {}
        self.kinds = {
            ballistic: [self._type({"vClass": kind.name.lower()}, ballistic) for kind in VehicleKind]
            for ballistic in (False, True)
        }
        """The default type of each kind of vehicle, by the rule of integration."""

    def add(self, number: int, files: TrafficFiles) -> tuple[range, range]:
        """Return the flows and the routes of a scenario on a map, read at the first call.

        Raises:
            TrafficError: The files ask for what native traffic does not support.
        """
        key = number, files.routes
        if key not in self._files:
            if number not in {known for known, _ in self._files}:
                root = ElementTree.parse(files.net).getroot()
                self._add_lights(number, root)
                self._add_yields(number, root)
            flows, routes, places = self._rows["flows"], len(self.routes), {}
            first = len(flows)
            self._route_numbers.clear()  # a scenario's routes follow each other, also those that others have
            for file in (*files.additional, *files.routes):
                try:
                    self._read(number, file, is_ballistic(files, self._dt), places)
                except (KeyError, ValueError) as error:
                    raise TrafficError(
                        f"the traffic engine Native cannot read this file: {type(error).__name__}: {error}",
                        place=str(file),
                        remedy='use the traffic engine "SUMO" for this scenario',
                    ) from error
            self._files[key] = range(first, len(flows)), range(routes, len(self.routes))
        return self._files[key]

    def route(
        self,
        number: int,
        edges: Iterable[int],
        arrival: tuple[int, float] = (-1, np.inf),
        stops: tuple[Stop, ...] = (),
        *,
        repeats: bool = False,
    ) -> tuple[int, int]:
        """Return a route's number and the row of its first edge's rightmost lane; a new route is added."""
        key = number, tuple(edges), arrival, stops, repeats
        if key not in self._route_numbers:
            ways, route = self._rows["ways"], len(self.routes)
            first = len(ways)
            for row in route_rows(self._maps[number], key[1], arrival, stops, repeats=repeats):
                others = (other if other < 0 else other + first for other in (row.next, row.left, row.right))
                lengths = row.length, row.arrival, *row.stop
                ways.append((row.lane + self._base[number], *others, row.changes, *lengths, route))
            self._route_numbers[key] = route, first
            self.routes.append(key[1])
        return self._route_numbers[key]

    @property
    def size(self) -> tuple[int, int]:
        """How many rows of ways there are, and scenarios."""
        return len(self._rows["ways"]), len(self._files)

    def tables(self, worlds: int) -> dict[str, Any]:
        """Return all as arrays, by their names in `Traffic`, for so many simulations."""
        most = max([1, *(len(each) for found in self._files.values() for each in found)])
        shows = np.zeros((len(self._shows), max([1, *map(len, self._shows)])), np.int8)
        for row, states in zip(shows, self._shows, strict=True):
            row[: len(states)] = states
        owners = [row[0] for row in self._rows["yields"]]
        return {
            **{name: np.array(self._rows[name], kind) for name, kind in state.TABLES.items()},
            "yield_start": np.searchsorted(owners, np.arange(self._base[-1] + 1)).astype(np.int32),
            "shows": shows,
            "pending": np.zeros((worlds, most), state.PENDING),
            "route_number": np.zeros((worlds, most), np.int32),
            "light_states": np.zeros((worlds, len(self._rows["lights"])), state.LIGHT_STATE),
        }

    def _add_yields(self, number: int, root: Element) -> None:
        """Add which drivers wait for which at a map's junctions."""
        graph, base = self._maps[number], int(self._base[number])
        target = [graph.way_across(lane)[-1] for lane in range(len(graph.lane_ids))]
        pairs = read_responses(root, graph)
        known = set(pairs)
        rows = self._rows["yields"]
        for lane, foe in pairs:
            rows.append((lane + base, foe + base, (foe, lane) in known, target[lane] == target[foe]))
        rows.sort()

    def _add_lights(self, number: int, root: Element) -> None:
        """Add the programs of a map's lights, the first of each."""
        graph, base = self._maps[number], self._base[number]
        phases, lights, lit = (self._rows[name] for name in ("phases", "lights", "lit"))
        first, first_lit = len(lights), len(lit)
        programs: dict[str, Element] = {}
        for element in root.iterfind("tlLogic"):
            programs.setdefault(element.attrib["id"], element)
        for name in graph.signal_ids:
            program, phase = programs[name], len(phases)
            waits = program.get("type") == "actuated"
            for element in program.iterfind("phase"):
                bounds = [element.get(bound) if waits else None for bound in ("minDur", "maxDur")]
                phases.append(tuple(float(bound or element.attrib["duration"]) for bound in bounds))
                self._shows.append([_SHOWS.get(each, 0) for each in element.attrib["state"]])
            lights.append((phase, len(phases) - 1, float(program.get("offset", "0"))))
        for lane in np.flatnonzero(graph.signal >= 0).tolist():
            before = int((*graph.predecessors(lane), lane)[0])
            light = first + int(graph.signal[lane])
            lit.append((lane + base, before + base, light, int(graph.signal_link[lane])))
        self._rows["map_lights"][number] = first, len(lights), first_lit, len(lit)

    def _read(self, number: int, file: Path, ballistic: bool, places: dict[str, Element]) -> None:
        """Read a file of routes, or of `places` to stop at, by id."""
        try:
            root = ElementTree.parse(file).getroot()
        except (OSError, ElementTree.ParseError) as error:
            text = f"{type(error).__name__}: {error}"
            raise TrafficError(text, place=str(file), remedy="build the scenario again") from error
        if lost := left_out(root):
            raise TrafficError(
                f"the traffic engine Native does not drive {lost}",
                place=str(file),
                remedy='use the traffic engine "SUMO" for this scenario',
            )
        places.update({place.attrib["id"]: place for place in root.iter("busStop")})
        types = {each.attrib["id"]: self._type(each.attrib, ballistic) for each in root.iter("vType")}
        mixes = {name: [(1.0, kind)] for name, kind in types.items()} | _mixes(root, types)
        routes = {each.get("id"): each for each in root.iter("route")}
        for element in (each for tag in ("flow", "vehicle", "trip") for each in root.iter(tag)):
            route = routes.get(element.get("route"), element.find("route"))
            mix = mixes.get(element.get("type", ""), [(1.0, self.kinds[ballistic][0])])
            self._add_flow(number, element, element if route is None else route, mix, places)

    def _add_flow(
        self,
        number: int,
        element: Element,
        route: Element,
        mix: Sequence[tuple[float, int]],
        places: Mapping[str, Element],
    ) -> None:
        graph, get = self._maps[number], element.get
        names = route.get("edges", "").split() or shortest_route(
            graph, route.attrib["from"], route.attrib["to"], route.get("via", "").split()
        )
        edges = [graph.edge_number(edge) for edge in names]

        def place_on(edge: int, index: int, place: str, named: Mapping[str, float]) -> float:
            """Return the arc length of a place [m], from the end if negative; SUMO's lanes differ a bit."""
            if place in named:
                return named[place]
            lane = graph.edge_lanes(edge)[index]
            length, its_length = float(graph.length[lane]), float(graph.driven_length[lane])
            s = float(place)
            return max(s + its_length if s < 0.0 else s, 0.0) * length / its_length

        goal = _index(get("arrivalLane"), 0)
        arrival = (
            _index(get("arrivalLane"), -1),
            place_on(edges[-1], goal, get("arrivalPos", "max"), {"max": np.inf, "random": np.inf}),
        )
        stops: list[Stop] = []
        for stop in (*route.iter("stop"), *(() if route is element else element.iter("stop"))):
            place = places[stop.attrib["busStop"]] if "busStop" in stop.attrib else stop
            name, _, index = place.get("lane", f"{place.get('edge')}_0").rpartition("_")
            edge = graph.edge_number(name)
            k = edges.index(edge, stops[-1][0] if stops else 0)
            whole = {"": float(graph.length[graph.edge_lanes(edge)[int(index)]])}
            end = place_on(edge, int(index), place.get("endPos", ""), whole)
            least = {"": max(end - _STOP_LENGTH, 0.0) if place is stop else 0.0}
            begin = place_on(edge, int(index), place.get("startPos", ""), least)
            stops.append((k, int(index), begin, end, clock_seconds(stop.get("duration", "0"))))
        repeats = int(route.get("repeat", "1")) > 1
        _, first = self.route(number, edges, arrival, tuple(stops), repeats=repeats)
        changes = [abs(self._rows["ways"][first + k][4]) for k in range(len(graph.edge_lanes(edges[0])))]
        index = _index(get("departLane", "0"), int(np.argmin(changes)))
        begin = place_on(edges[0], index, get("departPos", "base"), _PLACES)
        speed = get("departSpeed", "0")
        fast = -1.0 if speed[0].isalpha() else float(speed)
        shares = self._rows["shares"]
        ends = len(shares), len(shares) + len(mix) - 1
        self._rows["flows"].append((*_times(element), first + index, begin, fast, *ends))
        shares += mix

    def _type(self, given: Mapping[str, str], ballistic: bool) -> int:
        """Add a vehicle type and return its number."""
        numbers = [float(given.get(name, default)) for name, default in _DEFAULTS.items()]
        numbers[6] = max(numbers[6], self._dt)
        normal = _NORMAL.match(factor := given.get("speedFactor", "normc(1,0.1,0.2,2)"))
        factors = [float(each) for each in (normal[1] if normal else factor).split(",")]
        factors += [0.0, 0.2, np.inf if normal else 2.0][len(factors) - 1 :]
        factors[1] = float(given.get("speedDev", factors[1]))
        kind = given.get("vClass", "passenger")
        size = zip(("length", "width"), _SIZES.get(kind, _SIZES["passenger"]), strict=True)
        self._rows["types"].append(
            (
                *numbers,
                max(float(given.get("emergencyDecel", 9.0)), numbers[1]),
                *factors,
                *(float(given.get(name, default)) for name, default in size),
                getattr(VehicleKind, kind.upper(), VehicleKind.PASSENGER),
                given.get("carFollowModel") == "IDM",
                ballistic,
                self._dt,
            )
        )
        return len(self._rows["types"]) - 1


def is_ballistic(files: TrafficFiles, dt: float) -> bool:
    """Return whether SUMO would move these vehicles by the ballistic rule."""
    given = dict(files.options).get("step-method.ballistic")
    if given is not None:
        return given == "true"
    return round(1000 * (files.reaction_time or 0.0)) // round(1000 * dt) > 1


def _mixes(root: Element, types: Mapping[str, int]) -> dict[str, list[tuple[float, int]]]:
    """Return the distributions of types by name, each as pairs of a cumulated share and a type's kind."""
    weight_of = {each.attrib["id"]: each.get("probability", "1") for each in root.iter("vType")}
    mixes = {}
    for element in root.iter("vTypeDistribution"):
        names = [*element.get("vTypes", "").split(), *(each.attrib["id"] for each in element.iter("vType"))]
        given = element.get("probabilities", "").split()
        weights = [*given, *(weight_of[name] for name in names[len(given) :])]
        shares = np.cumsum([float(weight) for weight in weights])
        kinds = [types[name] for name in names]
        mixes[element.attrib["id"]] = [*zip((shares / shares[-1]).tolist(), kinds, strict=True)]
    return mixes


def _index(text: str | None, default: int) -> int:
    """Return a lane's index; names of choices, such as "best", give the default."""
    return int(text) if text and text.isdigit() else default


def _times(element: Element) -> tuple[float, float, float, bool]:
    """Return begin, end and mean headway of departures [s], and whether they are randomly spaced."""
    if element.tag != "flow":
        return clock_seconds(element.attrib["depart"]), np.inf, np.inf, False
    begin, end = (clock_seconds(element.get(name, other)) for name, other in (("begin", "0"), ("end", "inf")))
    number, period = float(element.get("number", "inf")), element.get("period", "")
    is_random = period.startswith("exp")
    if is_random:
        headway = 1.0 / float(period[4:-1])
    elif "vehsPerHour" in element.attrib:
        headway = 3600.0 / float(element.attrib["vehsPerHour"])
    else:
        headway = clock_seconds(period) if period else (end - begin) / number
    # As in SUMO, a number sets the end; half a headway before it, sums of headways are safe from rounding.
    return begin, end if number == np.inf else begin + (number - 0.5) * headway, headway, is_random
