"""Drivers as SUMO's vehicle types."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from smarts.sstudio.encoding import digest
from smarts.sstudio.sstypes import (
    Distribution,
    SmartsJunctionModel,
    SmartsLaneChangingModel,
    TrafficActor,
    TrafficModel,
    UniformDistribution,
)
from smarts.sstudio.sstypes.actor.traffic_actor import HALFWAY, AnyDistribution

if TYPE_CHECKING:
    from numpy.random import Generator

Attributes = dict[str, Any]

SAMPLES = 16
"""Vehicle types that sample a distribution which SUMO cannot draw from."""
BICYCLE_SPEED = 5.56
"""Top speed of bicycles whose actor names none [m/s]."""
SPEED_FACTORS = (0.2, 2.0)
"""SUMO cuts off the wanted speeds of drivers below and above these multiples of the limit."""


def _prefixed(prefix: str, stems: str) -> list[str]:
    return [prefix + stem for stem in stems.split()]


_LANE_CHANGING = """
AccelLat Assertive ContRight Cooperative CooperativeHelpTime CooperativeRoundabout CooperativeSpeed Impatience
KeepRight KeepRightAcceptanceTime LaneDiscipline LookaheadLeft MaxDistLatStanding MaxSpeedLatFactor
MaxSpeedLatStanding Opposite OvertakeDeltaSpeedFactor OvertakeRight Pushy PushyGap Sigma SpeedGain
SpeedGainLookahead SpeedGainRemainTime SpeedGainRight SpeedGainUrgency Strategic StrategicLookahead Sublane
TimeToImpatience TurnAlignmentDistance
"""
_JUNCTIONS = """
Advance AllwayStopWait CrossingGap DriveAfterRedTime DriveAfterYellowTime DriveRedSpeed ExtraGap IgnoreFoeProb
IgnoreFoeSpeed IgnoreJunctionFoeProb IgnoreKeepClearTime SigmaMinor StopSignWait StoplineCrossingGap
StoplineGap StoplineGapMinor TimegapMinor
"""
LANE_CHANGING = ["minGapLat", *_prefixed("lc", _LANE_CHANGING)]
"""Lane-changing attributes of SUMO 1.28, which ignores all others silently."""
JUNCTIONS = ["impatience", *_prefixed("jm", _JUNCTIONS)]
"""Junction attributes of SUMO 1.28."""


def vehicle_types(actor: TrafficActor, generator: Generator) -> list[Attributes]:
    """Return the attributes of the vehicle types that stand for a driver, all of them equally likely.

    One type is enough as long as SUMO can draw what varies. It cannot draw imperfection and gaps, nor
    wanted speeds that are not normally distributed; then several types sample them.
    """
    is_speed_drawn = not isinstance(actor.speed, Distribution) and not is_constant(actor.speed)
    if is_constant(actor.imperfection) and is_constant(actor.min_gap) and not is_speed_drawn:
        return [{"id": sumo_id(actor.id), **_attributes(actor, generator)}]
    return [
        {"id": f"{sumo_id(actor.id)}.{number}", **_attributes(actor, generator)} for number in range(SAMPLES)
    ]


def mix_id(actors: Mapping[TrafficActor, float]) -> str:
    """Return the name of a mixture of drivers, the same for equal mixtures."""
    return f"mix-{digest(dict(actors))[:6]}"


def sumo_id(name: str) -> str:
    """Return a name with all that SUMO does not allow in ids replaced by underscores."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name)


def ignored_models(actor: TrafficActor) -> list[TrafficModel]:
    """Return the driver's models that are for the native traffic engine and mean nothing to SUMO."""
    models = (actor.lane_changing_model, actor.junction_model)
    return [model for model in models if isinstance(model, SmartsLaneChangingModel | SmartsJunctionModel)]


def is_constant(distribution: AnyDistribution) -> bool:
    """Return whether a distribution has one value only."""
    if isinstance(distribution, Distribution):
        return distribution.sigma == 0
    return isinstance(distribution, UniformDistribution) and distribution.a == distribution.b


def _attributes(actor: TrafficActor, generator: Generator) -> Attributes:
    ignored = ignored_models(actor)
    is_slow = actor.vehicle_type == "bicycle" and actor.max_speed == TrafficActor.max_speed
    # The original has two fields for one thing; the one that was changed counts.
    imperfection = actor.sigma if actor.imperfection == HALFWAY else actor.imperfection.sample(generator)
    attributes: Attributes = {
        "vClass": actor.vehicle_type,
        "accel": actor.accel,
        "decel": actor.decel,
        # SUMO warns at every start if it is below decel.
        "emergencyDecel": max(actor.emergency_decel, actor.decel),
        "tau": actor.tau,
        "sigma": min(max(imperfection, 0.0), 1.0),
        "minGap": max(actor.min_gap.sample(generator), 0.0),
        "maxSpeed": BICYCLE_SPEED if is_slow else actor.max_speed,
        **_speed_factor(actor.speed, generator),
        **({"actionStepLength": actor.reaction_time} if actor.reaction_time else {}),
    }
    for model in (actor.lane_changing_model, actor.junction_model):
        attributes |= {} if model in ignored else dict(model)
    return attributes


def _speed_factor(speed: AnyDistribution, generator: Generator) -> Attributes:
    if isinstance(speed, Distribution) and speed.sigma > 0:
        lowest, highest = min(SPEED_FACTORS[0], speed.mean), max(SPEED_FACTORS[1], speed.mean)
        return {"speedFactor": f"normc({speed.mean:g},{speed.sigma:g},{lowest:g},{highest:g})"}
    factor = speed.mean if isinstance(speed, Distribution) else max(speed.sample(generator), SPEED_FACTORS[0])
    # Without it SUMO adds the deviation of the vehicle class.
    return {"speedFactor": factor, "speedDev": 0}
