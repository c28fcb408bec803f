"""Traffic: flows, trips and vehicle types."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from smarts.sstudio.sstypes.actor.traffic_actor import TrafficActor
from smarts.sstudio.sstypes.identity import Described
from smarts.sstudio.sstypes.recording import Recording
from smarts.sstudio.sstypes.route import RandomRoute, Route


@dataclass(frozen=True, eq=False)
class Stop(Described):
    """A place where a vehicle halts on its way (an extension)."""

    road_id: str
    """Its edge."""
    lane_index: int
    """Its lane, 0 is the rightmost."""
    offset: float
    """Offset along the lane at which the front bumper halts [m]."""
    duration: float
    """Duration of the stop [s]."""
    length: float = 20.0
    """The length of the stop's area, which ends at `offset` [m]."""
    bus_stop: bool = True
    """Whether it is a bus stop, which vehicles share, or a place on the open lane."""


@dataclass(frozen=True, eq=False)
class Flow(Described):
    """Vehicles that follow one after another on a route."""

    route: Route | RandomRoute
    """The way."""
    rate: float
    """Vehicles per hour."""
    begin: float = 0
    """Departure of the first vehicle, from the begin of `Traffic.warm_up` on [s]."""
    end: float = 1 * 60 * 60
    """Latest departure of the last vehicle, on the same clock [s]: from a flow that ends within the warm-up,
    no vehicle departs in the episode."""
    actors: Mapping[TrafficActor, float] = field(default_factory=dict)
    """Required: the drivers with their weights; an actor's share is its weight over the sum of all."""
    randomly_spaced: bool = False
    """Whether departures are a Poisson process instead of evenly spaced."""
    repeat_route: bool = False
    """Whether vehicles restart at the route's beginning."""
    stops: Sequence[Stop] = ()
    """Stops of the vehicles (an extension)."""

    @property
    def id(self) -> str:
        """A name that tells the route, and is unique to the content."""
        return f"{self.route.id}-{self.fingerprint()}"


@dataclass(frozen=True, eq=False)
class Trip(Described):
    """One vehicle on a route."""

    vehicle_name: str
    """The vehicle's name, unique in the traffic, and none that the simulation gives, such as "slot-0-1"."""
    route: Route | RandomRoute
    """The way."""
    vehicle_type: str = "passenger"
    """The vehicle's type; the actor's own one counts unless another is given here."""
    depart: float = 0
    """Time of departure, from the begin of `Traffic.warm_up` on [s]: with `warm_up=20`, a vehicle that
    departs at 5 s is there when the episode begins."""
    actor: TrafficActor | None = None
    """The driver: the given actor under the vehicle's name, or a default car."""
    stops: Sequence[Stop] = ()
    """Stops of the vehicle (an extension)."""

    def __post_init__(self) -> None:
        actor = self.actor or TrafficActor(self.vehicle_name)
        kind = actor.vehicle_type if self.vehicle_type == "passenger" else self.vehicle_type
        object.__setattr__(self, "actor", replace(actor, name=self.vehicle_name, vehicle_type=kind))

    @property
    def driver(self) -> TrafficActor:
        """`actor`, which is never None once the trip is made."""
        return self.actor or TrafficActor(self.vehicle_name)

    @property
    def id(self) -> str:
        """The vehicle's name."""
        return self.vehicle_name


@dataclass(frozen=True, eq=False)
class Traffic(Described):
    """All the traffic of one episode."""

    flows: Sequence[Flow]
    """Steady supplies of vehicles."""
    trips: Sequence[Trip] | None = None
    """Single vehicles."""
    engine: str = "SUMO"
    """The traffic engine: "SUMO", "Native", "Recorded" for a `recording`, or "SMARTS", for which SUMO stands
    in so far."""
    warm_up: float = 0.0
    """Simulated before an episode [s]; times of flows and trips count from its begin (an extension)."""
    seed: int | None = None
    """Seed of its random routes and sampled drivers; None: the scenario's (an extension)."""
    route_files: Sequence[str] = ()
    """Route files of SUMO (types, routes, flows, trips, vehicles) in the scenario's folder, which SUMO drives
    beside `flows` and `trips` (an extension)."""
    additional_files: Sequence[str] = ()
    """Additional files of SUMO, likewise."""
    sumo_options: Mapping[str, str] = field(default_factory=dict)
    """Options of SUMO: "begin" [s], before which no vehicle departs and from which `warm_up` counts, "scale",
    "ignore-route-errors", "max-depart-delay" [s], "random-depart-offset" [s] (an extension)."""
    recording: Recording | None = None
    """Vehicles that were recorded, instead of flows and trips, for the engine "Recorded" (an extension)."""
