"""Checks a scenario against its map before it is built, so that no episode fails halfway.

Every error names the object (`traffic['dense'].flows[2].route.begin`), the value and a remedy.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from shapely.geometry.base import BaseGeometry
from shapely.validation import explain_validity

from smarts.errors import SmartsError
from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio import sstypes as t
from smarts.sstudio.bubble_checks import GENERAL, BubbleChecks
from smarts.sstudio.checks import shown
from smarts.sstudio.episodes import grid
from smarts.sstudio.missions import CAR_LENGTH
from smarts.sstudio.placement import (
    BUSES,
    blame,
    lane_of,
    next_lap,
    open_lane_of,
    route_edges,
    target_lane,
    via_place,
)
from smarts.sstudio.sstypes.constants import RANDOM_OFFSET
from smarts.sstudio.traffic_checks import LEAST, TrafficChecks
from smarts.sstudio.ways import is_on_way

MISSIONS = (t.Mission, t.EndlessMission, t.LapMission, t.GroupedLapMission)

_Place = tuple[str, int, Any]


def validate(scenario: t.Scenario, roads: LaneGraph, net: Path, place: str) -> None:
    """Check all fields of a scenario.

    Args:
        scenario: The scenario.
        roads: Its map.
        net: The network that the map was read from.
        place: The file that describes it, for errors.

    Raises:
        ScenarioError: Names the first invalid value.
    """
    _Validation(place, roads, net).scenario(scenario)


@dataclass(frozen=True)
class _Validation(TrafficChecks, BubbleChecks):
    def scenario(self, scenario: t.Scenario) -> None:
        spec = scenario.map_spec
        remedy = "leave it out, and give the map as a SUMO, OpenDRIVE or OSM file"
        is_file = spec is None or spec.builder_fn is None
        self.require(is_file, "map_spec.builder_fn", "functions that build maps are not supported", remedy)
        for where, traffic in self.named(scenario.traffic, t.Traffic, "traffic"):
            self.traffic(traffic, where)
        for where, mission in self.each(scenario.ego_missions, (*MISSIONS, t.DrawnMission), "ego_missions"):
            if isinstance(mission, t.DrawnMission):
                self._drawn(mission, len(scenario.ego_missions or ()), where)
            else:
                self._mission(mission, where)
        groups = self.named(scenario.social_agent_missions, (list, tuple), "social_agent_missions")
        for where, group in groups:
            self._social_agents(group, where)
        self._bubbles(scenario)
        for where, patch in self.each(scenario.friction_maps, t.RoadSurfacePatch, "friction_maps"):
            self.zone_on_map(self._zone(patch.zone, f"{where}.zone"), self.roads, f"{where}.zone")
            self.numbers(patch, where, "friction_coefficient", least=LEAST)
            self.numbers(patch, where, "begin_time", "end_time")
            problem = f"{patch.end_time} is before begin_time, {patch.begin_time}"
            self.require(patch.begin_time <= patch.end_time, f"{where}.end_time", problem, "exchange the two")
        if scenario.start_variation is not None:
            self.type(scenario.start_variation, t.StartVariation, "start_variation")

    def _mission(self, mission: t.AnyMission, where: str) -> None:
        if isinstance(mission, t.GroupedLapMission):
            self._group(mission, where)
            return
        edges = None
        if isinstance(mission, t.EndlessMission):
            open_lane_of(self.roads, mission.begin, self.at(f"{where}.begin"), BUSES)
            begin = mission.begin
        else:
            begin, edges = self._mission_route(mission, where)
        self.numbers(mission, where, "start_time")
        for at, via in self.each(mission.via, t.Via, f"{where}.via"):
            self._via(via, edges, at)
        if isinstance(mission, t.Mission) and mission.task is not None:
            self._task(mission.task, mission.route, f"{where}.task")
        if mission.entry_tactic is not None:
            self._entry(mission.entry_tactic, begin, f"{where}.entry_tactic")

    def _drawn(self, mission: t.DrawnMission, missions: int, where: str) -> None:
        self.require(
            missions == 1, where, "it is not the only mission", "leave out the others, or give count"
        )
        for name in ("starts", "goals"):
            places = self.each(getattr(mission, name), (list, tuple), f"{where}.{name}")
            self.require(bool(places), f"{where}.{name}", "it is empty", "give at least one")
            for at, place in places:
                open_lane_of(self.roads, place, self.at(at), BUSES)
                self.require(place[2] != RANDOM_OFFSET, at, "its offset is random", "use an offset [m]")
        self.numbers(mission, where, "count", least=1)
        self.type(mission.count, int, f"{where}.count")
        self.type(mission.distinct, bool, f"{where}.distinct")
        at, length = f"{where}.length", mission.length
        is_pair = isinstance(length, list | tuple) and len(length) == 2
        self.require(is_pair, at, f"{shown(length)} is no pair", "give the least and the largest [m]")
        self.number(length[0], at)
        self.number(length[1], at, least=length[0])
        self.numbers(mission, where, "arrivals")
        self.number(mission.conflicts, f"{where}.conflicts", most=1.0)

    def _mission_route(
        self, mission: t.Mission | t.LapMission, where: str
    ) -> tuple[_Place | None, tuple[str, ...] | None]:
        """Check a mission's route; return the place where it begins, and its edges, if they are known yet."""
        route = mission.route
        self.own_map(route, f"{where}.route")
        if isinstance(mission, t.LapMission):
            self.numbers(mission, where, "num_laps", least=1)
            self.type(route, t.Route, f"{where}.route")
        if not isinstance(route, t.Route):
            return None, None
        if isinstance(mission, t.Mission) and isinstance(mission.task, t.UTurn):
            # A U-turn needs no road from begin to end.
            for end in ("begin", "end"):
                open_lane_of(self.roads, getattr(route, end), self.at(f"{where}.route.{end}"), BUSES)
            edges = (route.begin[0], route.end[0])
        else:
            edges = route_edges(self.roads, route, self.at(f"{where}.route"), vehicle_length=CAR_LENGTH)
            open_lane_of(self.roads, route.end, self.at(f"{where}.route.end"), BUSES)
        if isinstance(mission, t.LapMission) and mission.num_laps > 1:
            edges += next_lap(self.roads, edges, self.at(f"{where}.route, which must be closed"))
        return route.begin, edges

    def _group(self, group: t.GroupedLapMission, where: str) -> None:
        begin, at = group.route.begin[2], f"{where}.route.begin"
        self.require(not isinstance(begin, str), at, f"{begin!r} is not a number", "use an offset [m]")
        for number, mission in enumerate(grid(group)):
            self._mission(mission, f"{where}, start {number}")

    def _via(self, via: t.Via, edges: tuple[str, ...] | None, where: str) -> None:
        self.numbers(via, where, "lane_offset", "required_speed")
        lane, _ = via_place(self.roads, via, self.at(where))
        problem = f"lane '{self.roads.lane_ids[lane]}' is no lane of a road"
        self.require(self.roads.kind[lane] in BUSES, f"{where}.lane_index", problem, "choose another lane")
        problem = f"the route does not pass lane '{self.roads.lane_ids[lane]}'"
        remedy = "put it on the route, or lead the route there by Route(via=[...])"
        is_passed = edges is None or is_on_way(self.roads, lane, edges)
        self.require(is_passed, f"{where}.road_id", problem, remedy)

    def _u_turn(self, route: t.Route | t.RandomRoute, task: t.UTurn, where: str) -> None:
        if not isinstance(route, t.Route):
            return
        lane = lane_of(self.roads, route.begin, self.at(where))
        s = 0.0 if isinstance(route.begin[2], str) else self.roads.arc_length(lane, route.begin[2])
        back = target_lane(self.roads, route.end[0], task)
        # Imported here: reading an experiment's file needs no compiled code.
        from smarts.geometry.binding import bind
        from smarts.roads.atlas import RoadAtlas
        from smarts.roads.turning import can_turn_round

        lanes = self.roads.edge_lanes(int(self.roads.lane_edge[lane]))
        can_turn = bind(can_turn_round, RoadAtlas([self.roads]).roads)
        problem = f"no turn leads from '{route.begin[0]}' back into '{self.roads.lane_ids[back]}'"
        remedy = "end the route on the road of the other direction, beside its begin and without a median"
        self.require(any(can_turn(0, int(own), back, s) for own in lanes), where, problem, remedy)

    def _task(self, task: t.UTurn | t.CutIn, route: t.Route | t.RandomRoute, where: str) -> None:
        self.type(task, (t.UTurn, t.CutIn), where)
        self.numbers(task, where, "trigger_radius")
        if isinstance(task, t.UTurn):
            self._u_turn(route, task, where)
        if isinstance(task, t.CutIn) and task.complete_on_edge_id is not None:
            with blame(self.at(f"{where}.complete_on_edge_id")):
                if isinstance(task.complete_on_edge_id, t.JunctionEdgeIDResolver):
                    task.complete_on_edge_id.to_edge(self.roads)
                else:
                    self.roads.edge_number(task.complete_on_edge_id)

    def _entry(self, tactic: t.EntryTactic, begin: _Place | None, where: str) -> None:
        self.type(tactic, t.EntryTactic, where)
        if isinstance(tactic, t.IdEntryTactic | t.TrapEntryTactic):
            self.condition(tactic.condition, GENERAL, f"{where}.condition", "entries")
        if not isinstance(tactic, t.TrapEntryTactic):
            return
        self.numbers(tactic, where, "wait_to_hijack_limit_s")
        self.each(tactic.exclusion_prefixes, str, f"{where}.exclusion_prefixes")
        if tactic.zone is not None:
            self._zone(tactic.zone, f"{where}.zone")
            if isinstance(tactic.zone, t.MapZone) and begin is not None:
                edge, at = tactic.zone.start[0], f"{where}.zone.start"
                problem = f"the zone is on edge '{edge}', but the mission begins on '{begin[0]}'"
                self.require(edge == begin[0], at, problem, f"put the zone on edge '{begin[0]}'")

    def _social_agents(self, group: Any, where: str) -> None:
        if len(group) != 2:
            raise self.error(where, f"not two lists: {shown(group)}", "use ([actor, ...], [mission, ...])")
        actors, missions = group
        actors = [actors] if isinstance(actors, t.SocialAgentActor) else actors
        self.require(bool(actors), where, "the group has no actors", "give at least one SocialAgentActor")
        seen: dict[str, str] = {}
        for at, actor in self.each(actors, t.SocialAgentActor, f"{where}[0]"):
            problem = f"{actor.name!r} is a BoidAgentActor, which drives several vehicles"
            is_boid = isinstance(actor, t.BoidAgentActor)
            self.require(not is_boid, at, problem, "let a bubble give it vehicles")
            self.unique(actor.name, seen, f"{at}.name")
        for at, mission in self.each(missions, MISSIONS, f"{where}.missions"):
            self._mission(mission, at)

    def _bubbles(self, scenario: t.Scenario) -> None:
        seen: dict[str, str] = {}
        groups = scenario.social_agent_missions or {}
        agents = [
            t.Bubble.to_actor_id(actor, group)
            for group, (actors, _) in groups.items()
            for actor in ([actors] if isinstance(actors, t.SocialAgentActor) else actors)
        ]
        for where, bubble in self.each(scenario.bubbles, t.Bubble, "bubbles"):
            self.unique(bubble.id, seen, f"{where}.id")
            try:
                self.each(bubble.exclusion_prefixes, str, f"{where}.exclusion_prefixes")
                self.bubble(bubble, self._zone(bubble.zone, f"{where}.zone"), self.roads, where)
                self.followed_agent(bubble, agents, where)
            except SmartsError as error:
                place = f"{error.place} of bubble {bubble.id!r}"
                raise type(error)(error.problem, place=place, remedy=error.remedy) from error

    def _zone(self, zone: t.Zone, where: str) -> BaseGeometry:
        """Require an area, and return it."""
        self.type(zone, t.Zone, where)
        if isinstance(zone, t.MapZone):
            lane_of(self.roads, zone.start, self.at(f"{where}.start"))
        with blame(self.at(where)):
            area = zone.to_geometry(self.roads)
        problem = f"the area is not a simple polygon: {explain_validity(area)}"
        remedy = "list the corners in order round the area, so that no two sides cross"
        self.require(area.is_valid and area.area > 0, where, problem, remedy)
        return area
