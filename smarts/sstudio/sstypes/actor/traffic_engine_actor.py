"""Vehicles that a bubble hands to a traffic engine."""

from __future__ import annotations

from dataclasses import dataclass

from smarts.sstudio.sstypes.actor.traffic_actor import TrafficActor


@dataclass(frozen=True, eq=False)
class TrafficEngineActor(TrafficActor):
    """A driver that a named traffic engine takes over."""

    traffic_provider: str = "LocalTrafficProvider"
    """The engine."""
