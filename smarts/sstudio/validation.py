"""Checks a described scenario against its map, so that nothing of it fails in mid-episode.

Every error names the object (`traffic['dense'].flows[2].route.begin`), the value and what to do.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from shapely.validation import explain_validity

from smarts.errors import ScenarioError, nearest_names
from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio import sstypes as t
from smarts.sstudio.episodes import grid
from smarts.sstudio.placement import blame, lane_of, route_edges, usable_lanes, via_place
from smarts.sstudio.vehicle_types import JUNCTIONS, LANE_CHANGING, ignored_models, sumo_id
from smarts.types.vehicles import VehicleKind

ENGINES = ("SUMO", "SMARTS")
VEHICLE_TYPES = tuple(kind.name.lower() for kind in VehicleKind)
DEPART_SPEEDS = ("max", "desired", "random", "speedLimit", "avg", "last")
HISTORY_SOURCES = ("NGSIM", "INTERACTION", "Waymo", "Argoverse")


def validate(scenario: t.Scenario, roads: LaneGraph, place: str) -> None:
    """Check everything that a scenario says.

    Args:
        scenario: The scenario.
        roads: Its map.
        place: The file that describes it, for errors.

    Raises:
        ScenarioError: The first thing that cannot be.
    """
    _Validation(roads, place).scenario(scenario)


@dataclass(frozen=True)
class _Validation:
    roads: LaneGraph
    place: str

    def scenario(self, scenario: t.Scenario) -> None:
        spec = scenario.map_spec
        self._require(
            spec is None or spec.builder_fn is None,
            "map_spec.builder_fn",
            "maps cannot be built by a function of one's own",
            "leave it out, and give the map as a SUMO, OpenDRIVE or OSM file",
        )
        for name, traffic in (scenario.traffic or {}).items():
            self._traffic(traffic, f"traffic[{name!r}]")
        for number, mission in enumerate(scenario.ego_missions or ()):
            self._mission(mission, f"ego_missions[{number}]")
        for group, (actors, missions) in (scenario.social_agent_missions or {}).items():
            self._social_agents(actors, missions, f"social_agent_missions[{group!r}]")
        self._bubbles(scenario.bubbles or ())
        for number, patch in enumerate(scenario.friction_maps or ()):
            self._patch(patch, f"friction_maps[{number}]")
        for number, history in enumerate(scenario.traffic_histories or ()):
            self._history(history, f"traffic_histories[{number}]")
        for name in scenario.held_out or {}:
            self._require(
                bool(name) and not set(name) & set("@/\\"),
                f"held_out[{name!r}]",
                "not a name",
                "leave out @ and /",
            )

    # Small things

    def _require(self, holds: bool, where: str, problem: str, remedy: str) -> None:
        if not holds:
            raise ScenarioError(problem, place=self._at(where), remedy=remedy)

    def _at(self, where: str) -> str:
        return f"{self.place}: {where}"

    def _number(self, value: Any, where: str, least: float = 0.0, above: bool = False) -> None:
        """Require a finite number that is at least, or above, `least`."""
        numeric = isinstance(value, int | float) and math.isfinite(value)
        bound = f"above {least:g}" if above else f"{least:g} or more"
        holds = numeric and (value > least if above else value >= least)
        self._require(holds, where, f"{value!r} is not a number {bound}", f"use a number {bound}")

    def _choice(self, value: Any, choices: Iterable[str], where: str) -> None:
        known = tuple(choices)
        self._require(value in known, where, f"there is no {value!r}", nearest_names(str(value), known))

    def _type(self, value: Any, types: type | tuple[type, ...], where: str) -> None:
        expected = types if isinstance(types, tuple) else (types,)
        names = " or ".join(kind.__name__ for kind in expected)
        self._require(
            isinstance(value, expected), where, f"a {type(value).__name__}: {value!r}", f"use a {names}"
        )

    # Traffic

    def _traffic(self, traffic: t.Traffic, where: str) -> None:
        self._type(traffic, t.Traffic, where)
        self._choice(traffic.engine, ENGINES, f"{where}.engine")
        self._number(traffic.warm_up, f"{where}.warm_up")
        for number, flow in enumerate(traffic.flows):
            self._flow(flow, f"{where}.flows[{number}]")
        seen: dict[str, int] = {}
        for number, trip in enumerate(traffic.trips or ()):
            at = f"{where}.trips[{number}]"
            earlier = seen.setdefault(trip.vehicle_name, number)
            self._require(
                earlier == number,
                f"{at}.vehicle_name",
                f"trips[{earlier}] has the name {trip.vehicle_name!r}, too",
                "give every trip a name of its own",
            )
            self._trip(trip, at)

    def _flow(self, flow: t.Flow, where: str) -> None:
        self._type(flow, t.Flow, where)
        self._number(flow.rate, f"{where}.rate")
        self._number(flow.begin, f"{where}.begin")
        self._number(flow.end, f"{where}.end")
        self._require(
            flow.end >= flow.begin,
            f"{where}.end",
            f"{flow.end} is before begin, {flow.begin}",
            "exchange the two",
        )
        self._weights(flow.actors, f"{where}.actors")
        for actor in flow.actors:
            self._actor(actor, f"{where}.actors[{actor.name!r}]")
        self._vehicle_route(flow.route, flow.actors, flow.stops, where)

    def _weights(self, actors: Mapping[t.TrafficActor, float], where: str) -> None:
        self._require(bool(actors), where, "the flow has no actors", "give actors={TrafficActor('car'): 1}")
        for actor, weight in actors.items():
            self._type(actor, t.TrafficActor, f"{where} key")
            self._number(weight, f"{where}[{actor.name!r}]")
        self._require(sum(actors.values()) > 0, where, "the weights sum to zero", "give one a weight above 0")

    def _trip(self, trip: t.Trip, where: str) -> None:
        self._require(
            bool(trip.vehicle_name) and sumo_id(trip.vehicle_name) == trip.vehicle_name,
            f"{where}.vehicle_name",
            f"{trip.vehicle_name!r} is not a vehicle's name",
            "use letters, digits and the signs - _ . only",
        )
        self._number(trip.depart, f"{where}.depart")
        self._actor(trip.driver, f"{where}.actor")
        self._vehicle_route(trip.route, [trip.driver], trip.stops, where)

    def _vehicle_route(
        self,
        route: t.Route | t.RandomRoute,
        actors: Iterable[t.TrafficActor],
        stops: Sequence[t.Stop],
        where: str,
    ) -> None:
        self._type(route, (t.Route, t.RandomRoute), f"{where}.route")
        kinds = frozenset.intersection(*(usable_lanes(actor.vehicle_type) for actor in actors))
        edges = None
        if isinstance(route, t.Route):
            edges = route_edges(self.roads, route, self._at(f"{where}.route"), kinds)
        for number, stop in enumerate(stops):
            self._stop(stop, edges, f"{where}.stops[{number}]")

    def _stop(self, stop: t.Stop, edges: tuple[str, ...] | None, where: str) -> None:
        lane_of(self.roads, (stop.road_id, stop.lane_index, stop.offset), self._at(where))
        self._number(stop.duration, f"{where}.duration")
        self._number(stop.length, f"{where}.length", above=True)
        self._require(
            edges is not None and stop.road_id in edges,
            f"{where}.road_id",
            f"the route does not pass edge '{stop.road_id}'" if edges else "a random route cannot have stops",
            nearest_names(stop.road_id, edges) if edges else "use a Route",
        )

    def _actor(self, actor: t.TrafficActor, where: str) -> None:
        self._choice(actor.vehicle_type, VEHICLE_TYPES, f"{where}.vehicle_type")
        for name in ("accel", "decel", "emergency_decel", "max_speed"):
            self._number(getattr(actor, name), f"{where}.{name}", above=True)
        self._number(actor.tau, f"{where}.tau")
        for name in ("speed", "imperfection", "min_gap"):
            value = getattr(actor, name)
            kinds = (t.Distribution, t.UniformDistribution, t.TruncatedDistribution)
            self._type(value, kinds, f"{where}.{name}")
            if isinstance(value, t.Distribution):
                self._number(value.mean, f"{where}.{name}.mean")
                self._number(value.sigma, f"{where}.{name}.sigma")
        if isinstance(actor.depart_speed, str):
            self._choice(actor.depart_speed, DEPART_SPEEDS, f"{where}.depart_speed")
        else:
            self._number(actor.depart_speed, f"{where}.depart_speed")
        ignored = ignored_models(actor)
        models = (("lane_changing_model", LANE_CHANGING), ("junction_model", JUNCTIONS))
        for name, known in models:
            model = getattr(actor, name)
            for attribute in () if model in ignored else model:
                self._choice(attribute, known, f"{where}.{name}")

    # Missions

    def _mission(self, mission: t.AnyMission, where: str) -> None:
        kinds = (t.Mission, t.EndlessMission, t.LapMission, t.GroupedLapMission)
        self._type(mission, kinds, where)
        if isinstance(mission, t.GroupedLapMission):
            self._group(mission, where)
            return
        if isinstance(mission, t.EndlessMission):
            lane_of(self.roads, mission.begin, self._at(f"{where}.begin"))
            begin = mission.begin[0]
        else:
            begin = self._mission_route(mission, where)
        self._number(mission.start_time, f"{where}.start_time")
        for number, via in enumerate(mission.via):
            self._via(via, f"{where}.via[{number}]")
        if isinstance(mission, t.Mission) and mission.task is not None:
            self._task(mission.task, f"{where}.task")
        if mission.entry_tactic is not None:
            self._entry(mission.entry_tactic, begin, f"{where}.entry_tactic")

    def _mission_route(self, mission: t.Mission | t.LapMission, where: str) -> str | None:
        """Check a mission's route and return the edge it begins on, if that is known yet."""
        route = mission.route
        self._type(route, (t.Route, t.RandomRoute), f"{where}.route")
        if isinstance(mission, t.LapMission):
            self._number(mission.num_laps, f"{where}.num_laps", least=1)
            self._type(route, t.Route, f"{where}.route")
        if not isinstance(route, t.Route):
            return None
        if isinstance(mission, t.Mission) and isinstance(mission.task, t.UTurn):
            # The turn itself is the way: no road need lead from begin to end.
            for end in ("begin", "end"):
                lane_of(self.roads, getattr(route, end), self._at(f"{where}.route.{end}"))
        else:
            route_edges(self.roads, route, self._at(f"{where}.route"))
        if isinstance(mission, t.LapMission) and mission.num_laps > 1:
            back = t.Route(begin=(route.end[0], route.end[1], 0), end=(route.begin[0], route.begin[1], 0))
            route_edges(self.roads, back, self._at(f"{where}.route, which must be closed"))
        return route.begin[0]

    def _group(self, group: t.GroupedLapMission, where: str) -> None:
        self._number(group.actor_count, f"{where}.actor_count", least=1)
        self._number(group.lanes, f"{where}.lanes", least=1)
        begin = group.route.begin[2]
        self._require(
            not isinstance(begin, str),
            f"{where}.route.begin",
            f"{begin!r} is not a number",
            "use an offset [m]",
        )
        for number, mission in enumerate(grid(group)):
            self._mission(mission, f"{where}, start {number}")

    def _via(self, via: t.Via, where: str) -> None:
        via_place(self.roads, via, self._at(where))
        self._number(via.required_speed, f"{where}.required_speed")

    def _task(self, task: t.UTurn | t.CutIn, where: str) -> None:
        self._type(task, (t.UTurn, t.CutIn), where)
        self._number(task.trigger_radius, f"{where}.trigger_radius")
        if isinstance(task, t.CutIn) and task.complete_on_edge_id is not None:
            with blame(self._at(f"{where}.complete_on_edge_id")):
                if isinstance(task.complete_on_edge_id, t.JunctionEdgeIDResolver):
                    task.complete_on_edge_id.to_edge(self.roads)
                else:
                    self.roads.edge_number(task.complete_on_edge_id)

    def _entry(self, tactic: t.EntryTactic, begin: str | None, where: str) -> None:
        self._type(tactic, t.EntryTactic, where)
        self._number(tactic.start_time, f"{where}.start_time")
        if not isinstance(tactic, t.TrapEntryTactic):
            return
        self._number(tactic.wait_to_hijack_limit_s, f"{where}.wait_to_hijack_limit_s")
        if tactic.zone is not None:
            self._zone(tactic.zone, f"{where}.zone")
            if isinstance(tactic.zone, t.MapZone) and begin is not None:
                edge = tactic.zone.start[0]
                self._require(
                    edge == begin,
                    f"{where}.zone.start",
                    f"the zone is on edge '{edge}', but the mission begins on '{begin}'",
                    f"put the zone on edge '{begin}'",
                )

    # Agents and areas

    def _social_agents(
        self, actors: Sequence[t.SocialAgentActor], missions: Sequence[t.AnyMission], where: str
    ) -> None:
        self._require(len(actors) > 0, where, "the group has no actors", "give at least one SocialAgentActor")
        names = set()
        for actor in actors:
            self._type(actor, t.SocialAgentActor, where)
            self._require(
                not isinstance(actor, t.BoidAgentActor),
                where,
                f"{actor.name!r} is a BoidAgentActor, which drives several vehicles",
                "let a bubble give it vehicles",
            )
            self._require(
                actor.name not in names, where, f"two actors are named {actor.name!r}", "rename one of them"
            )
            names.add(actor.name)
        for number, mission in enumerate(missions):
            self._mission(mission, f"{where}.missions[{number}]")

    def _bubbles(self, bubbles: Sequence[t.Bubble]) -> None:
        seen: set[str] = set()
        for number, bubble in enumerate(bubbles):
            where = f"bubbles[{number}]"
            self._type(bubble, t.Bubble, where)
            self._require(
                bubble.id not in seen,
                f"{where}.id",
                f"two bubbles are named {bubble.id!r}",
                "rename one of them",
            )
            seen.add(bubble.id)
            self._type(bubble.actor, (t.SocialAgentActor, t.TrafficEngineActor), f"{where}.actor")
            self._zone(bubble.zone, f"{where}.zone")

    def _patch(self, patch: t.RoadSurfacePatch, where: str) -> None:
        self._type(patch, t.RoadSurfacePatch, where)
        self._zone(patch.zone, f"{where}.zone")
        self._number(patch.friction_coefficient, f"{where}.friction_coefficient", above=True)
        self._number(patch.begin_time, f"{where}.begin_time")
        self._require(
            patch.end_time >= patch.begin_time,
            f"{where}.end_time",
            f"{patch.end_time} is before begin_time, {patch.begin_time}",
            "exchange the two",
        )

    def _zone(self, zone: t.Zone, where: str) -> None:
        self._type(zone, t.Zone, where)
        if isinstance(zone, t.MapZone):
            lane_of(self.roads, zone.start, self._at(f"{where}.start"))
            self._number(zone.n_lanes, f"{where}.n_lanes", least=1)
            if not isinstance(zone.length, str):
                self._number(zone.length, f"{where}.length", above=True)
        if isinstance(zone, t.PositionalZone):
            for extent in zone.size:
                self._number(extent, f"{where}.size", above=True)
        with blame(self._at(where)):
            area = zone.to_geometry(self.roads)
        self._require(
            area.is_valid and area.area > 0,
            where,
            f"the area is not a simple polygon: {explain_validity(area)}",
            "list the corners in order round the area, so that no two sides cross",
        )

    def _history(self, history: t.TrafficHistoryDataset | str, where: str) -> None:
        self._type(history, (t.TrafficHistoryDataset, str), where)
        if isinstance(history, t.TrafficHistoryDataset):
            self._choice(history.source_type, HISTORY_SOURCES, f"{where}.source_type")
