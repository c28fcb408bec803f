"""The vehicle types, routes and flows of a scenario, from the route files that its build wrote for SUMO."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from smarts.errors import TrafficError
from smarts.providers.native import state
from smarts.providers.native.departing import DRAWN, TAIL_AT_BEGIN
from smarts.providers.native.state import rows_of
from smarts.providers.native.ways import route_rows
from smarts.roads.lane_graph import LaneGraph
from smarts.types.traffic import Signal, TrafficFiles
from smarts.types.vehicles import VehicleKind

_SIZES = {
    "passenger": (5.0, 1.8),
    "bus": (12.0, 2.5),
    "coach": (14.0, 2.6),
    "truck": (7.1, 2.4),
    "trailer": (16.5, 2.55),
    "motorcycle": (2.2, 0.9),
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
_NORMAL = re.compile(r"normc\((.*)\)")
_MISSING = ("rerouter", "person", "personFlow", "container", "containerFlow", "stop", "trip")
"""Elements of route files that native traffic does not support."""


class Built:
    """What native traffic knows of scenarios: their types, rows of routes, and flows.

    Args:
        maps: The maps, by their number in the atlas.
        dt: Length of a step [s].
    """

    def __init__(self, maps: Sequence[LaneGraph], dt: float) -> None:
        self._maps, self._dt = tuple(maps), dt
        self._base = np.cumsum([0, *(len(graph.lane_ids) for graph in maps)]).tolist()
        self._types: list[tuple[float, ...]] = []
        self._ways: list[tuple[float, ...]] = []
        self._flows: list[tuple[float, ...]] = []
        self._shares: list[tuple[float, int]] = []
        self._phases: list[list[float]] = []
        self._shows: list[list[int]] = []
        self._lights: list[tuple[float, ...]] = []
        self._lit: list[tuple[int, ...]] = []
        self._map_lights = [(0, 0, 0, 0)] * len(self._maps)
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
                self._add_lights(number, files.net)
            flows, routes = len(self._flows), len(self.routes)
            for file in files.routes:
                self._read(number, file, is_ballistic(files, self._dt))
            self._files[key] = range(flows, len(self._flows)), range(routes, len(self.routes))
        return self._files[key]

    def route(
        self,
        number: int,
        edges: Iterable[int],
        arrival: tuple[int, float] = (-1, np.inf),
        *,
        repeats: bool = False,
    ) -> tuple[int, int]:
        """Return a route's number and the row of its first edge's rightmost lane; a new route is added."""
        key = number, tuple(edges), arrival, repeats
        if key not in self._route_numbers:
            first, route = len(self._ways), len(self.routes)
            for row in route_rows(self._maps[number], key[1], arrival, repeats=repeats):
                others = (other if other < 0 else other + first for other in (row.next, row.left, row.right))
                lane = row.lane + self._base[number]
                self._ways.append((lane, *others, row.changes, row.length, row.arrival, route))
            self._route_numbers[key] = route, first
            self.routes.append(key[1])
        return self._route_numbers[key]

    @property
    def size(self) -> tuple[int, int]:
        """How many rows of ways there are, and scenarios."""
        return len(self._ways), len(self._files)

    def tables(self, worlds: int) -> dict[str, Any]:
        """Return all as arrays, by their names in `Traffic`, for so many simulations."""
        most = max([1, *(len(each) for found in self._files.values() for each in found)])
        shows = np.zeros((len(self._shows), max([1, *map(len, self._shows)])), np.int8)
        for row, states in zip(shows, self._shows, strict=True):
            row[: len(states)] = states
        return {
            "types": rows_of(state.VEHICLE_TYPE, self._types),
            "ways": rows_of(state.WAY, self._ways),
            "flows": rows_of(state.FLOW, self._flows),
            "shares": rows_of(state.SHARE, self._shares),
            "phases": rows_of(state.PHASE, self._phases),
            "shows": shows,
            "lights": rows_of(state.LIGHT, self._lights),
            "lit": rows_of(state.LIT_LANE, self._lit),
            "map_lights": rows_of(state.MAP_LIGHTS, self._map_lights),
            "pending": np.zeros((worlds, most), state.PENDING),
            "route_number": np.zeros((worlds, most), np.int32),
            "light_states": np.zeros((worlds, len(self._lights)), state.LIGHT_STATE),
        }

    def _add_lights(self, number: int, net: Path) -> None:
        """Add the programs of a map's lights, the first of each."""
        graph, base, first, first_lit = (
            self._maps[number],
            self._base[number],
            len(self._lights),
            len(self._lit),
        )
        programs: dict[str, ElementTree.Element] = {}
        for element in ElementTree.parse(net).getroot().iterfind("tlLogic"):
            programs.setdefault(element.attrib["id"], element)
        for name in graph.signal_ids:
            program, phase = programs[name], len(self._phases)
            waits = program.get("type") == "actuated"
            for element in program.iterfind("phase"):
                bounds = [element.get(bound) if waits else None for bound in ("minDur", "maxDur")]
                self._phases.append([float(bound or element.attrib["duration"]) for bound in bounds])
                self._shows.append([_SHOWS.get(each, 0) for each in element.attrib["state"]])
            self._lights.append((phase, len(self._phases) - 1, float(program.get("offset", "0"))))
        for lane in np.flatnonzero(graph.signal >= 0).tolist():
            before = int((*graph.predecessors(lane), lane)[0])
            light = first + int(graph.signal[lane])
            self._lit.append((lane + base, before + base, light, int(graph.signal_link[lane])))
        self._map_lights[number] = first, len(self._lights), first_lit, len(self._lit)

    def _read(self, number: int, file: Path, ballistic: bool) -> None:
        try:
            root = ElementTree.parse(file).getroot()
        except (OSError, ElementTree.ParseError) as error:
            text = f"{type(error).__name__}: {error}"
            raise TrafficError(text, place=str(file), remedy="build the scenario again") from error
        missing = sorted({element.tag for element in root.iter()} & set(_MISSING))
        missing += [
            f"departLane {lane!r}"
            for element in root
            if not (lane := element.get("departLane", "0")).isdigit()
        ]
        if missing:
            raise TrafficError(
                f"native traffic does not support {', '.join(missing)}",
                place=str(file),
                remedy='use the traffic engine "SUMO" for this scenario',
            )
        types = {
            element.attrib["id"]: self._type(element.attrib, ballistic) for element in root.iter("vType")
        }
        mixes = {name: [(1.0, kind)] for name, kind in types.items()}
        for element in root.iter("vTypeDistribution"):
            shares = np.cumsum([float(share) for share in element.attrib["probabilities"].split()])
            names = element.attrib["vTypes"].split()
            mixes[element.attrib["id"]] = [
                (share, types[name])
                for name, share in zip(names, (shares / shares[-1]).tolist(), strict=True)
            ]
        routes = {element.attrib["id"]: element for element in root.iter("route")}
        for element in [*root.iter("flow"), *root.iter("vehicle")]:
            self._add_flow(number, element, routes[element.attrib["route"]], mixes[element.attrib["type"]])

    def _add_flow(
        self,
        number: int,
        element: ElementTree.Element,
        route: ElementTree.Element,
        mix: Sequence[tuple[float, int]],
    ) -> None:
        graph, get = self._maps[number], element.get
        edges = [graph.edge_number(edge) for edge in route.attrib["edges"].split()]

        def place_on(edge: int, index: int, place: str, named: Mapping[str, float]) -> float:
            """Return the arc length of a place [m]; SUMO's lengths differ from the centrelines' a little."""
            lane = graph.edge_lanes(edge)[index]
            scale = float(graph.length[lane] / graph.driven_length[lane])
            return named[place] if place in named else float(place) * scale

        index, goal = int(get("departLane", "0")), _index(get("arrivalLane"), 0)
        begin = place_on(edges[0], index, get("departPos", "base"), {"base": TAIL_AT_BEGIN, "random": DRAWN})
        end = place_on(edges[-1], goal, get("arrivalPos", "max"), {"max": np.inf})
        arrival = _index(get("arrivalLane"), -1), end
        _, first = self.route(number, edges, arrival, repeats=int(route.get("repeat", "1")) > 1)
        speed = get("departSpeed", "0")
        fast = -1.0 if speed in ("max", "desired", "speedLimit") else float(speed)
        shares = len(self._shares), len(self._shares) + len(mix) - 1
        self._flows.append((*_times(element), first + index, begin, fast, *shares))
        self._shares += mix

    def _type(self, given: Mapping[str, str], ballistic: bool) -> int:
        """Add a vehicle type and return its number."""
        numbers = [float(given.get(name, default)) for name, default in _DEFAULTS.items()]
        numbers[6] = max(numbers[6], self._dt)
        normal = _NORMAL.match(factor := given.get("speedFactor", "normc(1,0.1,0.2,2)"))
        deviation = float(given.get("speedDev", 0.0))
        factors = map(float, normal[1].split(",")) if normal else (float(factor), deviation, 0.2, 2.0)
        kind = given.get("vClass", "passenger")
        size = zip(("length", "width"), _SIZES.get(kind, _SIZES["passenger"]), strict=True)
        self._types.append(
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
        return len(self._types) - 1


def is_ballistic(files: TrafficFiles, dt: float) -> bool:
    """Return whether SUMO would move these vehicles by the ballistic rule."""
    given = dict(files.options).get("step-method.ballistic")
    if given is not None:
        return given == "true"
    return round(1000 * (files.reaction_time or 0.0)) // round(1000 * dt) > 1


def _index(text: str | None, default: int) -> int:
    """Return a lane's index; names of choices, such as "best", give the default."""
    return int(text) if text and text.isdigit() else default


def _times(element: ElementTree.Element) -> tuple[float, float, float, bool]:
    """Return begin, end and mean headway of departures [s], and whether they are randomly spaced."""
    if element.tag == "vehicle":
        return float(element.attrib["depart"]), np.inf, np.inf, False
    begin, end = float(element.attrib["begin"]), float(element.attrib["end"])
    if "vehsPerHour" in element.attrib:
        return begin, end, 3600.0 / float(element.attrib["vehsPerHour"]), False
    return begin, end, 1.0 / float(element.attrib["period"][4:-1]), True
