"""Places the bubbles of a scenario on its map."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from shapely import contains_xy
from shapely.geometry.base import BaseGeometry

from smarts.geometry.rings import rings_of
from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio import sstypes as t
from smarts.sstudio.bubble_checks import outline_of
from smarts.sstudio.sstypes.actor.traffic_engine_actor import SUMO_TRAFFIC
from smarts.sstudio.sstypes.condition import parts
from smarts.sstudio.sstypes.drawing import fresh_drawing
from smarts.types.bubbles import UNLIMITED, PlacedBubble
from smarts.types.condition_state import SceneCondition

COLUMNS_IF_UNLIMITED = 32
"""How many vehicles an unlimited bubble has room for."""
TRAFFIC_DRIVER = "smarts.zoo:idm-v0"
"""The zoo's agent that drives for a `TrafficEngineActor`."""


class Driver(NamedTuple):
    """The policy that drives the vehicles of a bubble."""

    policy: int
    """Number of the social policy; -1: the learning agents."""
    interface: int
    """Number of its interface in the pool."""
    period: int = 1
    """Steps from one decision to the next."""


def agent_actor(bubble: t.Bubble) -> t.SocialAgentActor | None:
    """Return the actor whose agent drives the vehicles of a bubble, None for one that leaves them with SUMO.

    A `TrafficEngineActor` is served by an agent of the zoo with the actor's parameters.
    """
    actor = bubble.actor
    if not isinstance(actor, t.TrafficEngineActor):
        return actor
    if actor.traffic_provider == SUMO_TRAFFIC:
        return None
    parameters = {
        "tau": actor.tau,
        "accel": actor.accel,
        "decel": actor.decel,
        "min_gap": actor.min_gap.mean,
        "speed_factor": actor.speed.mean,
        "max_speed": actor.max_speed,
    }
    return t.SocialAgentActor(actor.name, TRAFFIC_DRIVER, policy_kwargs=parameters)


def columns_needed(bubble: t.Bubble) -> int:
    """Return how many vehicles at a time a bubble has room for, those in its margin included."""
    hijack_limit, shadow_limit = _limits(bubble)
    if shadow_limit != UNLIMITED:
        return shadow_limit
    return COLUMNS_IF_UNLIMITED if hijack_limit == UNLIMITED else max(COLUMNS_IF_UNLIMITED, hijack_limit)


def place_bubbles(
    bubbles: Sequence[t.Bubble], roads: LaneGraph, driver_of: Callable[[t.Bubble], Driver]
) -> tuple[PlacedBubble, ...]:
    """Return a scenario's bubbles on its map, in the order of its file, without those of SUMO's vehicles.

    Args:
        bubbles: Bubbles of the scenario.
        roads: Its map.
        driver_of: Returns the policy that serves a bubble.
    """
    # Random offsets of zones are the same in every run.
    with fresh_drawing():
        driven = [bubble for bubble in bubbles if agent_actor(bubble) is not None]
        return tuple(_place(bubble, roads, driver_of(bubble)) for bubble in driven)


def _place(bubble: t.Bubble, roads: LaneGraph, driver: Driver) -> PlacedBubble:
    zone, margin = outline_of(bubble, roads)
    hijack_limit, shadow_limit = _limits(bubble)
    return PlacedBubble(
        id=bubble.id,
        actor=bubble.actor.name,
        policy=driver.policy,
        interface=driver.interface,
        zone=rings_of(zone),
        margin=rings_of(margin),
        heights=_heights(bubble.zone, zone, roads),
        active_condition=_condition(bubble.active_condition),
        airlock_condition=_condition(bubble.airlock_condition),
        hijack_limit=hijack_limit,
        shadow_limit=shadow_limit,
        spared=tuple(bubble.exclusion_prefixes),
        followed=bubble.follow_actor_id or bubble.follow_vehicle_id or "",
        follow_offset=bubble.follow_offset or (0.0, 0.0),
        centroid=(zone.centroid.x, zone.centroid.y),
        collision_time=float(bubble.collision_time),
        period=driver.period,
        names=_names(bubble),
    )


def _heights(zone: t.Zone, area: BaseGeometry, roads: LaneGraph) -> tuple[float, float]:
    """Return the least and largest height of the road that a zone is a part of [m]; all if it is of none."""
    if not isinstance(zone, t.MapZone):
        return -math.inf, math.inf
    lanes = roads.edge_lanes(roads.edge_number(zone.start[0]))
    rows = slice(int(roads.point_start[lanes[0]]), int(roads.point_start[lanes[-1] + 1]))
    heights = roads.point_z[rows][contains_xy(area, roads.point_xy[rows])]
    return (float(heights.min()), float(heights.max())) if len(heights) else (-math.inf, math.inf)


def _condition(condition: t.Condition) -> SceneCondition | None:
    """Return a condition that has to be evaluated, None for one that always holds."""
    always = isinstance(condition, t.LiteralCondition) and condition.literal == t.ConditionState.TRUE
    return None if always else condition


def _names(bubble: t.Bubble) -> tuple[str, ...]:
    """Return the names of vehicles that a bubble's conditions look for, each once."""
    conditions = (*parts(bubble.active_condition), *parts(bubble.airlock_condition))
    named = (part.actor_id for part in conditions if isinstance(part, t.DependeeActorCondition))
    return tuple(dict.fromkeys(named))


def _limits(bubble: t.Bubble) -> tuple[int, int]:
    """Return the hijack limit and the shadow limit, those of a boid's capacity included."""
    capacity = bubble.actor.capacity if isinstance(bubble.actor, t.BoidAgentActor) else None
    limits = [limit for limit in (bubble.limit, capacity) if limit is not None]
    shadow = min([UNLIMITED, *(limit.shadow_limit for limit in limits)])
    return min([shadow, *(limit.hijack_limit for limit in limits)]), shadow
