"""Checks a scenario's bubbles against its map; see `smarts.sstudio.validation`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio import sstypes as t
from smarts.sstudio.checks import Checks
from smarts.sstudio.sstypes.actor.traffic_engine_actor import LOCAL_TRAFFIC, SUMO_TRAFFIC
from smarts.sstudio.sstypes.condition import parts
from smarts.types.vehicles import VehicleKind

_KINDS = [kind.name.lower() for kind in VehicleKind]
SOCIAL_AGENT = "social-agent-"
"""How the names of a scenario's social agents begin; see `Bubble.to_actor_id`."""
GENERAL = t.ConditionRequires.time | t.ConditionRequires.actor_ids
"""The facts that every condition may use."""
_OF_VEHICLES = t.ConditionRequires.current_actor_state | t.ConditionRequires.current_actor_road_status


def outline_of(bubble: t.Bubble, roads: LaneGraph) -> tuple[BaseGeometry, BaseGeometry]:
    """Return the areas of a bubble's zone alone and with its margin, whose corners are mitred."""
    zone = bubble.zone.to_geometry(roads)
    return zone, zone.buffer(bubble.margin, cap_style="square", join_style="mitre")


@dataclass(frozen=True)
class BubbleChecks(Checks):
    """Checks of bubbles; see `Checks`."""

    def bubble(self, bubble: t.Bubble, area: BaseGeometry, roads: LaneGraph, where: str) -> None:
        """Require a bubble that can be placed; `area` is that of its zone."""
        self._driver(bubble.actor, f"{where}.actor")
        self.numbers(bubble, where, "margin", "collision_time")
        if bubble.limit is not None:
            self.type(bubble.limit, t.BubbleLimits, f"{where}.limit")
            self.numbers(bubble.limit, f"{where}.limit", "hijack_limit", "shadow_limit", least=1)
        for name, known in (("active_condition", GENERAL), ("airlock_condition", GENERAL | _OF_VEHICLES)):
            condition = getattr(bubble, name)
            self.condition(condition, known, f"{where}.{name}", "bubbles")
            for part in parts(condition):
                if isinstance(part, t.VehicleTypeCondition):
                    self.choice(part.vehicle_type, _KINDS, f"{where}.{name}.vehicle_type")
        if bubble.follow_actor_id is None and bubble.follow_vehicle_id is None:
            self.zone_on_map(area, roads, f"{where}.zone")  # an offset alone has no effect

    def followed_agent(self, bubble: t.Bubble, names: Collection[str], where: str) -> None:
        """Require that a bubble that follows a social agent, or looks for one, names one of the scenario's.

        Names of other agents and of vehicles are known only when they enter.
        """
        sought = [(bubble.follow_actor_id or "", "follow_actor_id")]
        for field in ("active_condition", "airlock_condition"):
            for part in parts(getattr(bubble, field)):
                if isinstance(part, t.DependeeActorCondition):
                    sought.append((part.actor_id, f"{field}.actor_id"))
        for name, field in sought:
            if name.startswith(SOCIAL_AGENT):
                self.choice(name, names, f"{where}.{field}")

    def _driver(self, actor: t.Actor, where: str) -> None:
        self.type(actor, (t.SocialAgentActor, t.TrafficEngineActor), where)
        if isinstance(actor, t.TrafficEngineActor):
            self.choice(actor.traffic_provider, (LOCAL_TRAFFIC, SUMO_TRAFFIC), f"{where}.traffic_provider")

    def condition(self, condition: t.Condition, known: t.ConditionRequires, where: str, users: str) -> None:
        """Require a condition on facts that its users, as errors name them, know."""
        self.type(condition, t.Condition, where)
        unknown = condition.requires & ~known
        problem = f"the condition needs {unknown.name}, which {users} do not know"
        self.require(not unknown, where, problem, f"use conditions on {known.name}")

    def zone_on_map(self, area: BaseGeometry, roads: LaneGraph, where: str) -> None:
        """Require an area that a lane leads through."""
        left, low, right, high = area.bounds
        x, y = roads.point_xy.T
        # Points of a lane are at most a metre apart.
        reach = np.repeat(roads.width / 2, np.diff(roads.point_start)) + 0.5
        is_near = (x >= left - reach) & (x <= right + reach) & (y >= low - reach) & (y <= high + reach)
        distances = shapely.distance(shapely.points(roads.point_xy[is_near]), area)
        touches = bool((distances <= reach[is_near]).any())
        problem = f"no lane leads through the zone, x {left:g} to {right:g} m, y {low:g} to {high:g} m"
        remedy = f"the map is x {x.min():g} to {x.max():g} m, y {y.min():g} to {y.max():g} m"
        self.require(touches, where, problem, remedy)
