"""Episodes: what one simulation is reset to."""

from __future__ import annotations

from dataclasses import dataclass

from smarts.types.mission import SeatMission
from smarts.types.traffic import TrafficFiles
from smarts.types.vehicles import VehicleKind


@dataclass(frozen=True)
class SeatStart:
    """How one agent begins an episode."""

    name: str
    """The agent's, and its vehicle's public name."""
    pose: tuple[float, float, float]
    """Of the vehicle's centre: x, y [m] and heading [rad]."""
    speed: float
    """[m/s]"""
    mission: SeatMission
    kind: VehicleKind = VehicleKind.PASSENGER
    length: float = 5.0
    """[m]"""
    width: float = 1.8
    """[m]"""
    entry_time: float = 0.0
    """When it enters [s]; until then its seat waits."""


@dataclass(frozen=True)
class EpisodeStart:
    """One episode of one simulation: a function of the list of scenarios, seed, world and episode alone."""

    seed: int
    world: int
    """Number of the simulation in its run, not of the row that it happens to be computed in."""
    episode: int
    scenario: str
    """With the variation, as in "intersection@dense"."""
    map: int
    """Number of its map in the atlas."""
    traffic: TrafficFiles
    traffic_name: str | None
    sumo_seed: int
    limit: int
    """The most vehicles of traffic at a time."""
    seats: tuple[SeatStart, ...]
    """Of the egos, in the order of their seats."""
