"""The vehicle types, routes and flows of a scenario, from the route files that its build wrote for SUMO."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from smarts.errors import TrafficError
from smarts.providers.native.state import Flows, Types, Ways
from smarts.providers.native.ways import route_rows
from smarts.roads.lane_graph import LaneGraph
from smarts.types import columns
from smarts.types.columns import Table
from smarts.types.traffic import TrafficFiles
from smarts.types.vehicles import VehicleKind

TAIL_AT_BEGIN, DRAWN = -1.0, -2.0
"""Values of `Flows.place` that stand for "base" and "random"."""
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
_NORMAL = re.compile(r"normc\((.*)\)")
_MISSING = ("rerouter", "person", "personFlow", "container", "containerFlow", "stop", "trip")
"""Elements of route files that native traffic does not support."""


class Built:
    """What native traffic knows of scenarios: their types, rows of routes, and flows.

    Args:
        maps: The maps, by their number in the atlas.
    """

    def __init__(self, maps: Sequence[LaneGraph]) -> None:
        self._maps = tuple(maps)
        self._base = np.cumsum([0, *(len(graph.lane_ids) for graph in maps)])
        self._types: list[list[float]] = []
        self._ways: list[Ways] = []
        self._rows = 0
        self._flows: list[tuple[Any, ...]] = []
        self._mixes: list[list[tuple[int, float]]] = []
        self.routes: list[tuple[int, ...]] = []
        """Edges of each route."""
        self._route_numbers: dict[tuple[Any, ...], tuple[int, Any]] = {}
        self._files: dict[tuple[int, tuple[Path, ...]], tuple[range, range]] = {}
        self.kinds = [self._type({"vClass": kind.name.lower()}) for kind in VehicleKind]
        """The default type of each kind of vehicle."""

    def add(self, number: int, files: TrafficFiles) -> tuple[range, range]:
        """Return the flows and the routes of a scenario on a map, read at the first call.

        Raises:
            TrafficError: The files ask for what native traffic does not support.
        """
        key = number, files.routes
        if key not in self._files:
            flows, routes = len(self._flows), len(self.routes)
            for file in files.routes:
                try:
                    self._read(number, ElementTree.parse(file).getroot(), file)
                except (OSError, ElementTree.ParseError, KeyError, ValueError) as error:
                    text = f"{type(error).__name__}: {error}"
                    raise TrafficError(text, place=str(file), remedy="build the scenario again") from error
            self._files[key] = range(flows, len(self._flows)), range(routes, len(self.routes))
        return self._files[key]

    def route(
        self,
        number: int,
        edges: Iterable[int],
        arrival: tuple[int, float] = (-1, np.inf),
        *,
        repeats: bool = False,
    ) -> tuple[int, Any]:
        """Return a route's number and the rows of its edges' rightmost lanes; a new route is added."""
        key = number, tuple(edges), arrival, repeats
        if key not in self._route_numbers:
            ways, first = route_rows(self._maps[number], key[1], arrival, repeats=repeats)
            base, lane_base = np.int32(self._rows), np.int32(self._base[number])
            next_row, left, right = (np.where(each < 0, -1, each + base) for each in ways[1:4])
            self._ways.append(
                ways._replace(
                    lane=ways.lane + lane_base,
                    next=next_row.astype(np.int32),
                    left=left.astype(np.int32),
                    right=right.astype(np.int32),
                    route=np.full(len(ways.lane), len(self.routes), np.int32),
                )
            )
            self._route_numbers[key] = len(self.routes), first + self._rows
            self._rows += len(ways.lane)
            self.routes.append(key[1])
        return self._route_numbers[key]

    @property
    def size(self) -> tuple[int, int]:
        """How many rows and flows there are."""
        return self._rows, len(self._flows)

    def tables(self) -> tuple[Types, Ways, Flows]:
        """Return all as arrays."""
        types = (np.array(column) for column in np.array(self._types).T)
        ways = (np.concatenate(parts) for parts in zip(*self._ways, strict=True))
        flows = np.array(self._flows, np.float64).reshape(-1, 7).T
        numbers = dict(zip(Flows._fields, map(np.array, flows), strict=False))
        numbers = {name: numbers[name] for name in ("begin", "end", "headway", "place", "speed")}
        share = [each for mixture in self._mixes for each in mixture]
        return (
            _typed(Types._make(types)),
            _typed(Ways._make(ways)) if self._ways else columns.allocate(Ways, (0,)),
            _typed(
                Flows(
                    **numbers,
                    is_random=flows[3] > 0.0,
                    row=flows[4].astype(np.int32),
                    mix=np.cumsum([0, *map(len, self._mixes)]),
                    mix_type=np.array([each[0] for each in share], np.int32),
                    mix_share=np.array([each[1] for each in share], np.float64),
                )
            ),
        )

    def _read(self, number: int, root: ElementTree.Element, file: Path) -> None:
        missing = sorted({element.tag for element in root.iter()} & set(_MISSING))
        if missing:
            raise TrafficError(
                f"native traffic does not support {', '.join(missing)}",
                place=str(file),
                remedy='use the traffic engine "SUMO" for this scenario',
            )
        types = {element.attrib["id"]: self._type(element.attrib) for element in root.iter("vType")}
        mixes = {name: [(type_number, 1.0)] for name, type_number in types.items()}
        for element in root.iter("vTypeDistribution"):
            shares = np.cumsum([float(share) for share in element.attrib["probabilities"].split()])
            names = element.attrib["vTypes"].split()
            mixes[element.attrib["id"]] = [
                (types[name], float(share)) for name, share in zip(names, shares / shares[-1], strict=True)
            ]
        routes = {element.attrib["id"]: element for element in root.iter("route")}
        for element in [*root.iter("flow"), *root.iter("vehicle")]:
            self._add_flow(number, element, routes[element.attrib["route"]], mixes, str(file))

    def _add_flow(
        self,
        number: int,
        element: ElementTree.Element,
        route: ElementTree.Element,
        mixes: Mapping[str, Any],
        file: str,
    ) -> None:
        graph, get = self._maps[number], element.get
        edges = [graph.edge_number(edge) for edge in route.attrib["edges"].split()]
        goal = list(graph.edge_lanes(edges[-1]))[_index(get("arrivalLane"), 0)]
        end = get("arrivalPos", "max")
        scale = float(graph.length[goal] / graph.driven_length[goal])
        arrival = np.inf if end == "max" else float(end) * scale
        lane = _index(get("arrivalLane"), -1)
        if not get("departLane", "0").isdigit():
            raise TrafficError(
                f"native traffic does not support departLane {get('departLane')!r}",
                place=file,
                remedy='use the traffic engine "SUMO" for this scenario',
            )
        _, first = self.route(number, edges, (lane, arrival), repeats=int(route.get("repeat", "1")) > 1)
        index = _index(get("departLane"), 0)
        start = list(graph.edge_lanes(edges[0]))[index]
        place, speed = get("departPos", "base"), get("departSpeed", "0")
        named = {"base": TAIL_AT_BEGIN, "random": DRAWN}
        scale = float(graph.length[start] / graph.driven_length[start])
        begin, finish, headway, is_random = _times(element)
        position = named[place] if place in named else float(place) * scale
        fast = -1.0 if speed in ("max", "desired", "speedLimit") else float(speed)
        self._flows.append((begin, finish, headway, is_random, int(first[0]) + index, position, fast))
        self._mixes.append(mixes[element.attrib["type"]])

    def _type(self, given: Mapping[str, str]) -> int:
        """Add a vehicle type and return its number."""

        def value(name: str) -> float:
            return float(given.get(name, _DEFAULTS[name]))

        kind = given.get("vClass", "passenger")
        length, width = _SIZES.get(kind, _SIZES["passenger"])
        factor = given.get("speedFactor", "normc(1,0.1,0.2,2)")
        normal = _NORMAL.match(factor)
        deviation = float(given.get("speedDev", 0.0))
        factors = (
            [float(each) for each in normal[1].split(",")] if normal else [float(factor), deviation, 0.2, 2.0]
        )
        numbers = [value(name) for name in _DEFAULTS]
        hardest = max(float(given.get("emergencyDecel", 9.0)), numbers[1])
        size = float(given.get("length", length)), float(given.get("width", width))
        is_idm = given.get("carFollowModel") == "IDM"
        known = getattr(VehicleKind, kind.upper(), VehicleKind.PASSENGER)
        numbers = [
            *numbers[:2],
            hardest,
            *numbers[2:6],
            *factors,
            numbers[6],
            is_idm,
            *numbers[7:],
            *size,
            known,
        ]
        self._types.append(numbers)
        return len(self._types) - 1


def _typed(table: Table) -> Table:
    """Return a named tuple of arrays with the dtypes that its fields are annotated with."""
    kinds = columns.allocate(type(table), (0,))
    return type(table)(*(each.astype(kind.dtype) for each, kind in zip(table, kinds, strict=True)))


def _index(text: str | None, default: int) -> int:
    """Return a lane's index; names of choices, such as "best", give the default."""
    return int(text) if text and text.isdigit() else default


def _times(element: ElementTree.Element) -> tuple[float, float, float, float]:
    """Return begin, end and mean headway of departures [s], and 1 if they are randomly spaced, else 0."""
    if element.tag == "vehicle":
        return float(element.attrib["depart"]), np.inf, np.inf, 0.0
    begin, end = float(element.attrib["begin"]), float(element.attrib["end"])
    if "vehsPerHour" in element.attrib:
        return begin, end, 3600.0 / float(element.attrib["vehsPerHour"]), 0.0
    return begin, end, 1.0 / float(element.attrib["period"][4:-1]), 1.0
