"""Episodes: what one simulation is reset to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from smarts.arrays import Floats
from smarts.types.agent_states import UNSET
from smarts.types.bubbles import PlacedBubble
from smarts.types.condition_state import SceneCondition
from smarts.types.mission import AgentMission
from smarts.types.traffic import DEFAULT_ENGINE, TrafficFiles
from smarts.types.vehicles import VehicleKind


@dataclass(frozen=True)
class TakeOver:
    """Which traffic vehicle an agent takes over."""

    areas: Sequence[Floats] = ()
    """Outlines of the places where a vehicle's front must be, each of shape (., 2) [m]; empty: anywhere."""
    vehicle: str = ""
    """Its public name; "" for any."""
    spared: tuple[str, ...] = ()
    """Prefixes of the names of vehicles that are left alone."""
    patience: float = math.inf
    """How long to wait for one after the entry time [s]; then a new vehicle is put in at the start."""
    condition: SceneCondition | None = None
    """A further condition."""


@dataclass(frozen=True)
class AgentStart:
    """How one agent enters an episode."""

    name: str
    """The agent's, and its vehicle's public name."""
    pose: tuple[float, float, float]
    """Pose of the vehicle's centre: x, y [m] and heading [rad]."""
    speed: float
    """[m/s]"""
    mission: AgentMission
    kind: VehicleKind = VehicleKind.PASSENGER
    length: float = 5.0
    """[m]"""
    width: float = 1.8
    """[m]"""
    entry_time: float = 0.0
    """Time at which it enters [s]; until then its agent waits."""
    take_over: TakeOver | None = None
    """What it waits for from then on; None puts a new vehicle in."""
    interface: int = UNSET
    """Number of the agent's interface in the pool (`AgentPool.interfaces`); -1: an ego."""
    policy: int = UNSET
    """Number of the social policy that acts for the agent, -1: none, for egos."""
    period: int = 1
    """Steps from one decision of a further agent to the next."""
    collision_time: float = 0.0
    """How long a vehicle that came from traffic stays as an obstacle after a collision [s]."""
    height: float = math.nan
    """Height of the road at the start [m], NaN where it is unknown."""


@dataclass(frozen=True)
class EpisodeStart:
    """One episode of one simulation: a function of the list of scenarios, seed, world and episode alone."""

    seed: int
    world: int
    """Number of the simulation in its run, not of the row that it happens to be computed in."""
    episode: int
    scenario: str
    """Scenario with the variation, as in "intersection@dense"."""
    map: int
    """Number of its map in the atlas."""
    traffic: TrafficFiles
    traffic_name: str | None
    traffic_seed: int
    """Seed of the traffic engine, in [0, 2^31)."""
    limit: int
    """The most vehicles at a time that the traffic engine knows, the egos' among them. `Simulation.reset`
    adds the further agents that enter then with vehicles of their own; agents that enter later take the place
    of traffic."""
    agents: tuple[AgentStart, ...]
    """The egos, in the order of their columns, then the further agents."""
    engine: str = DEFAULT_ENGINE
    """Name among `TRAFFIC_ENGINES` of the one that drives the traffic."""
    clears: bool = True
    """Whether traffic that is too near to agents when it begins is removed."""
    bubbles: tuple[PlacedBubble, ...] = field(default=(), compare=False)
    """The scenario's bubbles on its map, in the order of its file."""
    room: tuple[int, ...] | None = None
    """The most agents of each interface of the pool at a time, by its number; None: as many as the run has
    columns for. What other scenarios of the run need changes no episode."""
