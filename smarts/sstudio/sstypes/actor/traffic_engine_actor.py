"""Vehicles that a bubble hands to a traffic engine."""

from __future__ import annotations

from dataclasses import dataclass

from smarts.sstudio.sstypes.actor.traffic_actor import TrafficActor

LOCAL_TRAFFIC, SUMO_TRAFFIC = "LocalTrafficProvider", "SumoTrafficSimulation"
"""The engines that bubbles may name: an agent of the zoo that drives by the actor's parameters, and SUMO."""


@dataclass(frozen=True, eq=False)
class TrafficEngineActor(TrafficActor):
    """A driver that a named traffic engine takes over."""

    traffic_provider: str = LOCAL_TRAFFIC
    """The engine: "LocalTrafficProvider" is an intelligent-driver agent of the zoo with this actor's `tau`,
    `accel`, `decel`, `max_speed` and the means of `min_gap` and `speed`; "SumoTrafficSimulation" leaves the
    vehicles with SUMO."""
