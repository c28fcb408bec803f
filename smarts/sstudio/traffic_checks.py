"""Checks a scenario's traffic against its map; see `smarts.sstudio.validation`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from smarts.errors import nearest_names
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.permissions import roads_for
from smarts.sstudio import sstypes as t
from smarts.sstudio.checks import Checks
from smarts.sstudio.placement import offset_along, open_lane_of, open_to_all, route_edges
from smarts.sstudio.sstypes.constants import MAX_OFFSET
from smarts.sstudio.sumo_files import OPTIONS
from smarts.sstudio.vehicle_types import JUNCTIONS, LANE_CHANGING, ignored_models, sumo_id
from smarts.types.recorded import MODES
from smarts.types.traffic import TRAFFIC_ENGINES
from smarts.types.vehicles import VehicleKind

ENGINES = (*TRAFFIC_ENGINES, "SMARTS")
VEHICLE_TYPES = tuple(kind.name.lower() for kind in VehicleKind if kind != VehicleKind.PEDESTRIAN)
DEPART_SPEEDS = ("max", "desired", "random", "speedLimit", "avg", "last")
DISTRIBUTIONS = (t.Distribution, t.UniformDistribution, t.TruncatedDistribution)
LEAST = 1e-3
"""Least acceleration [m/s^2], speed [m/s] and headway [s] that is not 0."""
SHORTEST_STOP = 0.1
"""The least length of a stop's area, below which SUMO 1.28 takes it for invalid [m]."""


@dataclass(frozen=True)
class TrafficChecks(Checks):
    """Checks of flows and trips; see `Checks`."""

    roads: LaneGraph
    net: Path
    """The network that the map was read from."""

    def traffic(self, traffic: t.Traffic, where: str) -> None:
        """Require traffic that SUMO can drive."""
        self.choice(traffic.engine, ENGINES, f"{where}.engine")
        self._recording(traffic, where)
        self.number(traffic.warm_up, f"{where}.warm_up")
        for at, flow in self.each(traffic.flows, t.Flow, f"{where}.flows"):
            self._flow(flow, at)
        self.each(traffic.route_files, str, f"{where}.route_files")
        self.each(traffic.additional_files, str, f"{where}.additional_files")
        self.named(traffic.sumo_options, str, f"{where}.sumo_options")
        for name in traffic.sumo_options:
            self.choice(name, OPTIONS, f"{where}.sumo_options")
        seen: dict[str, str] = {}
        for at, trip in self.each(traffic.trips, t.Trip, f"{where}.trips"):
            self._trip(trip, at)
            self.unique(trip.vehicle_name, seen, f"{at}.vehicle_name")

    def _recording(self, traffic: t.Traffic, where: str) -> None:
        """Require a recording, and no other vehicles, where the engine is "Recorded", and only there."""
        recording, at = traffic.recording, f"{where}.recording"
        is_recorded = traffic.engine == "Recorded"
        problem = "the engine 'Recorded' drives recordings, and no other engine does"
        remedy = 'give engine="Recorded" and recording=t.Recording(FOLDER), or neither'
        self.require(is_recorded == (recording is not None), at, problem, remedy)
        if recording is None:
            return
        self.type(recording, t.Recording, at)
        self.type(recording.source, str, f"{at}.source")
        self.choice(recording.mode, MODES, f"{at}.mode")
        self.numbers(recording, at, "begin")
        for name in ("end", "window"):
            if getattr(recording, name) is not None:
                self.numbers(recording, at, name, least=LEAST)
        others = [traffic.flows, traffic.trips, traffic.route_files, traffic.additional_files]
        remedy = "leave out flows, trips, files of SUMO and warm_up"
        problem = "the engine 'Recorded' drives what was recorded, and nothing else"
        self.require(not any(map(bool, [*others, traffic.warm_up])), where, problem, remedy)

    def _flow(self, flow: t.Flow, where: str) -> None:
        self.numbers(flow, where, "rate", "begin", "end")
        problem = f"{flow.end} is before begin, {flow.begin}"
        self.require(flow.begin <= flow.end, f"{where}.end", problem, "exchange the two")
        self._weights(flow.actors, f"{where}.actors")
        for actor in flow.actors:
            self._actor(actor, f"{where}.actors[{actor.name!r}]")
        self._vehicle_route(flow.route, flow.actors, flow.stops, where, repeats=flow.repeat_route)

    def _weights(self, actors: Mapping[t.TrafficActor, float], where: str) -> None:
        self.type(actors, dict, where)
        self.require(bool(actors), where, "the flow has no actors", "give actors={TrafficActor('car'): 1}")
        for actor, weight in actors.items():
            self.type(actor, t.TrafficActor, f"{where} key")
            self.number(weight, f"{where}[{actor.name!r}]")
        self.require(sum(actors.values()) > 0, where, "the weights sum to zero", "give one a weight above 0")

    def _trip(self, trip: t.Trip, where: str) -> None:
        name, remedy = trip.vehicle_name, "use letters, digits and the signs - _ . only"
        problem = f"{name!r} is not a vehicle's name"
        self.require(sumo_id(name) == name != "", f"{where}.vehicle_name", problem, remedy)
        self.number(trip.depart, f"{where}.depart")
        self._actor(trip.driver, f"{where}.actor")
        self._vehicle_route(trip.route, [trip.driver], trip.stops, where)

    def _vehicle_route(
        self,
        route: t.Route | t.RandomRoute,
        actors: Iterable[t.TrafficActor],
        stops: Sequence[t.Stop],
        where: str,
        *,
        repeats: bool = False,
    ) -> None:
        self.own_map(route, f"{where}.route")
        if isinstance(route, t.Route):
            classes, at = {actor.vehicle_type for actor in actors}, self.at(f"{where}.route")
            edges = open_to_all(
                self.roads, self.net, classes, lambda roads, users: route_edges(roads, route, at, users=users)
            )
            roads = roads_for(self.roads, self.net, classes)
            end = (*route.end[:2], MAX_OFFSET) if repeats else route.end
            self._stops(stops, replace(route, end=end), edges, roads, f"{where}.stops")
        else:
            self.require(not stops, f"{where}.stops", "a random route cannot have stops", "use a Route")

    def own_map(self, route: t.Route | t.RandomRoute, where: str) -> None:
        """Require a route, on the scenario's map."""
        self.type(route, (t.Route, t.RandomRoute), where)
        if isinstance(route, t.Route):
            self.each(route.via, str, f"{where}.via")
        remedy = "leave it out: routes are on the scenario's map"
        self.require(route.map_spec is None, f"{where}.map_spec", "a route has no map of its own", remedy)

    def _stops(
        self,
        stops: Sequence[t.Stop],
        route: t.Route,
        edges: tuple[str, ...],
        roads: LaneGraph,
        where: str,
    ) -> None:
        """Require stops that come one after another on the way; places are numbers of edges and offsets."""
        begin, end = (
            offset_along(place[2], float(self.roads.sumo_length[self.roads.lane_number(*place[:2])]), draw)
            for place, draw in ((route.begin, min), (route.end, max))
        )
        reached, last = (0, begin), (len(edges) - 1, end)
        for at, stop in self.each(stops, t.Stop, where):
            self._stop(stop, edges, roads, at)
            places = [(number, stop.offset) for number, edge in enumerate(edges) if edge == stop.road_id]
            ahead = [place for place in places if reached <= place <= last]
            problem = f"offset {stop.offset:g} on edge '{stop.road_id}' is not ahead"
            remedy = "put stops between the route's begin and end, in the order in which they come"
            self.require(bool(ahead), at, problem, remedy)
            reached = ahead[0]

    def _stop(self, stop: t.Stop, edges: tuple[str, ...], roads: LaneGraph, where: str) -> None:
        self.numbers(stop, where, "offset", "length", least=SHORTEST_STOP)
        self.numbers(stop, where, "duration")
        open_lane_of(roads, (stop.road_id, stop.lane_index, stop.offset), self.at(where))
        if stop.road_id not in edges:
            problem = f"the route does not pass edge '{stop.road_id}'"
            raise self.error(f"{where}.road_id", problem, nearest_names(stop.road_id, edges))

    def _actor(self, actor: t.TrafficActor, where: str) -> None:
        self.choice(actor.vehicle_type, VEHICLE_TYPES, f"{where}.vehicle_type")
        self.numbers(actor, where, "accel", "decel", "max_speed", "tau", least=LEAST)
        self.number(actor.sigma, f"{where}.sigma", most=1)
        for name in ("speed", "imperfection", "min_gap"):
            self.type(getattr(actor, name), DISTRIBUTIONS, f"{where}.{name}")
        if isinstance(actor.depart_speed, str):
            self.choice(actor.depart_speed, DEPART_SPEEDS, f"{where}.depart_speed")
        else:
            self.number(actor.depart_speed, f"{where}.depart_speed", most=actor.max_speed)
        ignored = ignored_models(actor)
        models = (("lane_changing_model", LANE_CHANGING), ("junction_model", JUNCTIONS))
        for name, known in models:
            model = getattr(actor, name)
            for attribute in () if model in ignored else model:
                self.choice(attribute, known, f"{where}.{name}")
