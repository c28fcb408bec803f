"""Traffic as SUMO's input files.

Every flow becomes one SUMO flow over a fixed sequence of edges. Its drivers are a distribution of vehicle
types whose probabilities are the actors' shares. "random" offsets stay random: SUMO draws them in every
episode. Files are sorted by time of departure, as SUMO wants them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from smarts.errors import MapError
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.permissions import roads_for
from smarts.roads.routes import shortest_route
from smarts.sstudio import sstypes as t
from smarts.sstudio.placement import blame, open_to_all, route_edges
from smarts.sstudio.random_routes import draw_route
from smarts.sstudio.sstypes.constants import BASE_OFFSET, MAX_OFFSET
from smarts.sstudio.vehicle_types import ignored_models, mix_id, sumo_id, vehicle_types

if TYPE_CHECKING:
    from numpy.random import Generator

ROUND_TRIP_EDGES = 2000
"""Least number of edges of a repeated route: enough for hours; SUMO holds it in memory once."""


@dataclass(frozen=True)
class SumoDocuments:
    """The contents of the files for one variation of the traffic."""

    routes: str
    """Vehicle types, routes, flows and vehicles."""
    additional: str
    """Bus stops; empty without any."""
    reaction_time: float
    """The longest of any driver [s]."""
    notes: tuple[str, ...]
    """Parts of the scenario that SUMO does not support."""


def sumo_traffic(
    traffic: t.Traffic, roads: LaneGraph, net: Path, generator: Generator, where: str, place: str
) -> SumoDocuments:
    """Return a variation of the traffic as SUMO's input.

    Args:
        traffic: The traffic, which has passed validation.
        roads: The map.
        net: The network that it was read from.
        generator: Draws random routes and what SUMO cannot draw itself.
        where: What `traffic` is, for notes and errors.
        place: The file that describes it, for errors.

    Raises:
        ScenarioError: A route cannot be driven.
    """
    return _Writer(roads, net, generator, where, place).write(traffic)


def _element(tag: str, attributes: Mapping[str, Any], children: Iterable[Element] = ()) -> Element:
    """Return an XML element with its attributes in order."""
    element = Element(tag, {name: _text(value) for name, value in attributes.items()})
    element.extend(children)
    return element


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int | float):
        return f"{value:.10g}"
    return str(value)


def _document(tag: str, elements: Iterable[Element]) -> str:
    """Return a file's text; its bytes are part of the digests of frozen scenarios."""
    root = _element(tag, {}, elements)
    ElementTree.indent(root, "    ")
    root.text = root.text or "\n\n"
    body = ElementTree.tostring(root, "unicode").replace(" />", "/>")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{body}\n'


@dataclass
class _Writer:
    """The elements of one variation, each declared once however often it is used."""

    roads: LaneGraph
    net: Path
    generator: Generator
    where: str
    place: str
    types: dict[str, Element] = field(default_factory=dict)
    """Vehicle types and their distributions by id."""
    members: dict[t.TrafficActor, list[str]] = field(default_factory=dict)
    """The ids of each driver's vehicle types."""
    routes: dict[tuple[object, ...], Element] = field(default_factory=dict)
    """Routes by their edges and rounds."""
    stops: dict[str, Element] = field(default_factory=dict)
    """Bus stops by id."""
    drivers: dict[t.RandomRoute, set[t.TrafficActor]] = field(default_factory=dict)
    """The actors that use each random route."""
    drawn: dict[t.RandomRoute, t.Route] = field(default_factory=dict)
    """The route drawn for each random route."""
    notes: dict[str, None] = field(default_factory=dict)
    """Notes in order, each once."""

    def write(self, traffic: t.Traffic) -> SumoDocuments:
        """Return the files' contents."""
        for user in (*traffic.flows, *(traffic.trips or ())):
            if isinstance(user.route, t.RandomRoute):
                actors = user.actors if isinstance(user, t.Flow) else [user.driver]
                self.drivers.setdefault(user.route, set()).update(actors)
        departures = [
            (flow.begin, element)
            for number, flow in enumerate(traffic.flows)
            for element in self._flows(flow, number)
        ]
        departures += [
            (trip.depart, self._vehicle(trip, f"{self.where}.trips[{number}]"))
            for number, trip in enumerate(traffic.trips or ())
        ]
        departures.sort(key=lambda departure: departure[0])
        elements = [*self.types.values(), *self.routes.values(), *(element for _, element in departures)]
        return SumoDocuments(
            routes=_document("routes", elements),
            additional=_document("additional", self.stops.values()) if self.stops else "",
            reaction_time=max((actor.reaction_time for actor in self.members), default=0.0),
            notes=tuple(self.notes),
        )

    def _flows(self, flow: t.Flow, number: int) -> Iterable[Element]:
        """Return the flow once for each speed that its drivers depart with, which SUMO wants at the flow."""
        where, total = f"{self.where}.flows[{number}]", sum(flow.actors.values())
        names = {actor.name for actor in flow.actors}
        name = f"{sumo_id(names.pop()) if len(names) == 1 else 'mixed'}-flow-{number}"
        route, roads = self._resolved(flow.route, where), self._roads_for(flow.actors)
        edges = route_edges(roads, route, self._at(where))
        stops = [self._stop(stop) for stop in flow.stops]
        circuit = self._circuit(roads, edges, where) if flow.repeat_route else None
        # Driven many times; SUMO repeats the stops that are part of it.
        rounds = -(-ROUND_TRIP_EDGES // len(circuit)) if circuit else 1
        repeat = {"repeat": rounds} if rounds > 1 else {}
        departing = sorted({actor.depart_speed for actor in flow.actors}, key=str)
        for speed in departing:
            actors = {actor: weight for actor, weight in flow.actors.items() if actor.depart_speed == speed}
            rate = flow.rate * sum(actors.values()) / total
            if rate == 0:
                continue
            attributes = {
                "id": name if len(departing) == 1 else f"{name}-{_text(speed)}",
                "type": self._mixture(actors),
                "route": self._route(edges) if circuit is None else self._route(circuit, stops, **repeat),
                "begin": flow.begin,
                "end": flow.end,
                **({"period": f"exp({rate / 3600:.10g})"} if flow.randomly_spaced else {"vehsPerHour": rate}),
                **self._ends(route, speed),
            }
            yield _element("flow", attributes, stops if circuit is None else ())

    def _vehicle(self, trip: t.Trip, where: str) -> Element:
        actor, route = trip.driver, self._resolved(trip.route, where)
        edges = route_edges(self._roads_for([actor]), route, self._at(where))
        attributes = {
            "id": trip.vehicle_name,
            "type": self._mixture({actor: 1.0}),
            "route": self._route(edges),
            "depart": trip.depart,
            **self._ends(route, actor.depart_speed),
        }
        return _element("vehicle", attributes, [self._stop(stop) for stop in trip.stops])

    def _at(self, where: str) -> str:
        return f"{self.place}: {where}.route"

    def _roads_for(self, actors: Iterable[t.TrafficActor]) -> LaneGraph:
        return roads_for(self.roads, self.net, {actor.vehicle_type for actor in actors})

    def _resolved(self, route: t.Route | t.RandomRoute, where: str) -> t.Route:
        if isinstance(route, t.Route):
            return route
        if route not in self.drawn:

            def draw(roads: LaneGraph, users: str) -> t.Route:
                with blame(self._at(where)):
                    return draw_route(roads, self.generator, users)

            classes = {actor.vehicle_type for actor in self.drivers[route]}
            self.drawn[route] = open_to_all(self.roads, self.net, classes, draw)
        return self.drawn[route]

    def _mixture(self, actors: Mapping[t.TrafficActor, float]) -> str:
        """Declare the drivers' vehicle types and return the id of the only one, or of their distribution."""
        shares: dict[str, float] = {}
        total = sum(actors.values())
        for actor in sorted(
            (actor for actor, weight in actors.items() if weight), key=lambda actor: actor.id
        ):
            members = self._members(actor)
            for member in members:
                shares[member] = shares.get(member, 0.0) + actors[actor] / total / len(members)
        if len(shares) == 1:
            return next(iter(shares))
        mixture = mix_id(actors)
        probabilities = " ".join(map(_text, shares.values()))
        attributes = {"id": mixture, "vTypes": " ".join(shares), "probabilities": probabilities}
        self.types[mixture] = _element("vTypeDistribution", attributes)
        return mixture

    def _members(self, actor: t.TrafficActor) -> list[str]:
        if actor not in self.members:
            declared = vehicle_types(actor, self.generator)
            self.types.update({attributes["id"]: _element("vType", attributes) for attributes in declared})
            self.members[actor] = [attributes["id"] for attributes in declared]
            for model in ignored_models(actor):
                self._note(f"SUMO drives actor '{actor.name}', so its {type(model).__name__} has no effect")
        return self.members[actor]

    def _route(self, edges: tuple[str, ...], stops: Sequence[Element] = (), **repeat: int) -> str:
        key = (edges, *map(ElementTree.tostring, stops), *repeat.values())
        if key not in self.routes:
            attributes = {"id": f"route-{len(self.routes)}", "edges": " ".join(edges), **repeat}
            self.routes[key] = _element("route", attributes, stops)
        return self.routes[key].attrib["id"]

    def _circuit(self, roads: LaneGraph, edges: tuple[str, ...], where: str) -> tuple[str, ...] | None:
        """Return the edges that lead back to the first one over the map's own roads, None without a way."""
        try:
            back = shortest_route(roads, edges[-1], edges[0], lap=True)[1:-1]
        except MapError:
            self._note(
                f"{where}: no way leads back to '{edges[0]}', so vehicles leave at the end of the route"
            )
            return None
        # A route that ends on its first edge has come round already; the next round begins with that edge.
        return edges[:-1] if len(edges) > 1 and edges[0] == edges[-1] else (*edges, *back)

    def _ends(self, route: t.Route, speed: float | str) -> dict[str, Any]:
        """Return SUMO's attributes for where and how vehicles depart and arrive."""
        (_, depart_lane, depart), (_, arrival_lane, arrival) = route.begin, route.end
        if depart == MAX_OFFSET:
            depart = float(self.roads.sumo_length[self.roads.lane_number(*route.begin[:2])])
        return {
            "departLane": depart_lane,
            "departPos": self._driven(*route.begin[:2], depart),
            "departSpeed": speed,
            "arrivalLane": arrival_lane,
            "arrivalPos": 0 if arrival == BASE_OFFSET else self._driven(*route.end[:2], arrival),
        }

    def _driven(self, edge: str, index: int, position: Any) -> Any:
        """Return SUMO's position for one that a scenario gives [m]; names of places stay."""
        lane = self.roads.lane_number(edge, index)
        given, driven = float(self.roads.sumo_length[lane]), float(self.roads.driven_length[lane])
        return position if isinstance(position, str) or given == driven else position * driven / given

    def _stop(self, stop: t.Stop) -> Element:
        end = self._driven(stop.road_id, stop.lane_index, stop.offset)
        area = {
            "lane": f"{stop.road_id}_{stop.lane_index}",
            "startPos": max(end - stop.length, 0.0),
            "endPos": end,
        }
        if not stop.bus_stop:
            return _element("stop", {**area, "duration": stop.duration})
        name = f"stop-{area['lane']}-{_text(area['startPos'])}-{_text(area['endPos'])}"
        self.stops[name] = _element("busStop", {"id": name, **area})
        return _element("stop", {"busStop": name, "duration": stop.duration})

    def _note(self, note: str) -> None:
        self.notes[note] = None
