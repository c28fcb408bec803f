"""Drivers of the traffic engine."""

from __future__ import annotations

from dataclasses import dataclass, field

from smarts.sstudio.sstypes.actor import Actor
from smarts.sstudio.sstypes.distribution import Distribution, TruncatedDistribution, UniformDistribution
from smarts.sstudio.sstypes.traffic_model import JunctionModel, LaneChangingModel

AnyDistribution = Distribution | UniformDistribution | TruncatedDistribution

NEAR_THE_LIMIT = Distribution(mean=1.0, sigma=0.1)
HALFWAY = Distribution(mean=0.5, sigma=0)
HALF_A_CAR = Distribution(mean=2.5, sigma=0)


@dataclass(frozen=True, eq=False)
class TrafficActor(Actor):
    """A kind of driver and vehicle. The defaults are those of a car."""

    accel: float = 2.6
    """The largest acceleration [m/s^2]."""
    decel: float = 4.5
    """The largest comfortable deceleration [m/s^2]."""
    tau: float = 1.0
    """The headway kept to the vehicle ahead [s]."""
    sigma: float = 0.5
    """The driver's imperfection in [0, 1]; counts where `imperfection` is left at its default."""
    depart_speed: float | str = "max"
    """The speed at the start [m/s], or "max", "desired", "random", "speedLimit", "avg", "last". Drivers whom
    it makes faster than they want to drive keep to it for the whole trip."""
    emergency_decel: float = 4.5
    """The largest deceleration in an emergency [m/s^2]."""
    speed: AnyDistribution = NEAR_THE_LIMIT
    """The wanted speed as a multiple of the speed limit."""
    imperfection: AnyDistribution = HALFWAY
    """The driver's imperfection in [0, 1]."""
    min_gap: AnyDistribution = HALF_A_CAR
    """The gap to the vehicle ahead when standing [m]."""
    max_speed: float = 55.5
    """The vehicle's top speed [m/s]; by default that of a bicycle is 5.56, as SUMO's."""
    vehicle_type: str = "passenger"
    """"passenger", "bus", "coach", "truck", "trailer", "motorcycle" or "bicycle"."""
    lane_changing_model: LaneChangingModel = field(default_factory=LaneChangingModel)
    """The driver's lane-changing model."""
    junction_model: JunctionModel = field(default_factory=JunctionModel)
    """The driver's junction model."""
    reaction_time: float = 0.0
    """Time from one decision of the driver to the next, in which acceleration is kept [s]; 0: a step (an
    extension). With a `tau` below it, the driver runs into leaders that brake."""

    @property
    def id(self) -> str:
        """The name with a fingerprint of the content, such as "car-3f2a91"."""
        return f"{self.name}-{self.fingerprint()}"
