"""The drivers, flows and start variation that the scenarios of the suite share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from smarts.sstudio import types as t

impatient_car = t.TrafficActor(
    name="impatient_car",
    speed=t.Distribution(sigma=0.2, mean=1.0),
    lane_changing_model=t.LaneChangingModel(impatience=1, cooperative=0.25),
    junction_model=t.JunctionModel(drive_after_red_time=1.5, drive_after_yellow_time=1.0, impatience=1.0),
)
"""Drives at the limit, gives way late, and pushes into small gaps (values of the paper's listing)."""

patient_car = t.TrafficActor(
    name="patient_car",
    speed=t.Distribution(sigma=0.2, mean=0.8),
    lane_changing_model=t.LaneChangingModel(impatience=0, cooperative=0.5),
    junction_model=t.JunctionModel(drive_after_yellow_time=1.0, impatience=0.5),
)
"""Drives below the limit and makes room for others (values of the paper's listing)."""

courteous_car = t.TrafficActor(
    name="courteous_car",
    tau=1.5,
    speed=t.Distribution(sigma=0.1, mean=0.8),
    min_gap=t.Distribution(mean=3.0, sigma=0),
    lane_changing_model=t.LaneChangingModel(cooperative=1.0, speed_gain=0.0),
    junction_model=t.JunctionModel(impatience=0.0),
)
"""Keeps distance, lets others change lanes, and enters junctions in large gaps only."""

normal_car = t.TrafficActor(
    name="normal_car",
    lane_changing_model=t.LaneChangingModel(cooperative=0.5),
    junction_model=t.JunctionModel(impatience=0.5),
)
"""Drives at the limit, and makes others brake a little at junctions."""

aggressive_car = t.TrafficActor(
    name="aggressive_car",
    accel=3.5,
    tau=0.7,
    speed=t.Distribution(sigma=0.1, mean=1.2),
    min_gap=t.Distribution(mean=1.5, sigma=0),
    lane_changing_model=t.LaneChangingModel(cooperative=0.0, assertive=2.0, speed_gain=2.0),
    junction_model=t.JunctionModel(impatience=1.0, timegap_minor=0.5),
)
"""Drives above the limit, closely behind others, and makes others brake at junctions and lane changes."""

inattentive_car = t.TrafficActor(
    name="inattentive_car",
    tau=1.5,
    sigma=0.7,
    lane_changing_model=t.LaneChangingModel(cooperative=0.5),
    junction_model=t.JunctionModel(impatience=0.5, ignore_junction_foe_prob=1.0),
    reaction_time=1.0,
)
"""Obeys signs and follows leaders, but drives on where a vehicle crosses its way inside a junction, and
brakes late for one that changes into its lane."""

KINDS = {
    "courteous": {courteous_car: 1.0},
    "normal": {normal_car: 1.0},
    "aggressive": {aggressive_car: 1.0},
    "inattentive": {inattentive_car: 1.0},
}
"""The drivers of version 1's tasks, each kind by itself."""
ALL_KINDS = {courteous_car: 0.3, normal_car: 0.4, aggressive_car: 0.2, inattentive_car: 0.1}
"""The mixture of version 1's tasks; SUMO draws each vehicle's kind."""

MIXED = {impatient_car: 0.5, patient_car: 0.5}
IMPATIENT = {impatient_car: 1.0}

START_IN_TOWN = t.StartVariation(offset=5.0, speed=(0.0, 5.0))
START_ON_A_ROAD = t.StartVariation(offset=5.0, speed=(5.0, 10.0))
START_ON_A_FAST_ROAD = t.StartVariation(offset=5.0, speed=(10.0, 15.0))
"""Not from standstill: traffic of 80 km/h that comes up behind could not stop in time."""

SPACING = 40
"""Distance between the places where a filled road gets its first vehicles [m]."""
TYPICAL_SPEED = 10.0
"""Speed of vehicles on a filled road, which with the flow's rate says how many there are [m/s]."""
FILLING_TIME = 2.0
"""Within which the first vehicles appear [s]."""

Drivers = Mapping[t.TrafficActor, float]
LanePoint = tuple[str, int] | tuple[str, int, float]
"""Road, lane index and, where it is not the road's begin or end, the offset [m]."""


def flow(origin: LanePoint, goal: LanePoint, rate: float, drivers: Drivers = MIXED, **options) -> t.Flow:
    """Return randomly spaced vehicles.

    Args:
        origin: Where they enter; the road's begin unless an offset is given.
        goal: Where they leave; the road's end unless an offset is given.
        rate: Vehicles per hour.
        drivers: Weight of each kind of driver.
        options: Further fields of `Flow`; `via` names the roads between.
    """
    route = t.Route(
        begin=origin if len(origin) == 3 else (*origin, "base"),
        end=goal if len(goal) == 3 else (*goal, "max"),
        via=tuple(options.pop("via", ())),
    )
    return t.Flow(route=route, rate=rate, actors=dict(drivers), randomly_spaced=True, **options)


def placed(
    places: Iterable[tuple[str, int, float]],
    goal: tuple[str, int],
    moment: float,
    drivers: Drivers = MIXED,
) -> list[t.Flow]:
    """Return single vehicles at given places; each draws its kind of driver.

    Args:
        places: Where their front bumpers are when they appear; offsets [m].
        goal: Where they leave.
        moment: When they appear [s]: shortly before the warm-up ends, they are there when an episode begins.
        drivers: Weight of each kind of driver, all with one `depart_speed`.
    """
    return [
        t.Flow(
            route=t.Route(begin=place, end=(*goal, "max")),
            rate=1,  # an hour, so that only the first vehicle comes
            begin=moment,
            end=moment + 1.0,
            actors=dict(drivers),
        )
        for place in places
    ]


def slowly(drivers: Drivers, speed: float) -> dict[t.TrafficActor, float]:
    """Return the same drivers in vehicles that are slow: `speed` [m/s] times each kind's factor."""
    return {
        replace(actor, name=f"slow_{actor.name}", max_speed=speed * actor.speed.mean): weight
        for actor, weight in drivers.items()
    }


def traffic(
    flows: Sequence[t.Flow],
    warm_up: float,
    filled: Mapping[str, float] | None = None,
    trips: Sequence[t.Trip] = (),
) -> dict[str, t.Traffic]:
    """Return the suite's two traffic variations: an empty road, and vehicles already on their way.

    Args:
        flows: The vehicles.
        warm_up: Simulated before an episode begins [s].
        filled: Roads that hold vehicles from the first second on, each with the offset up to which it does
            [m]. Without them a long warm-up would be needed until the first vehicles have come through.
        trips: Single vehicles.
    """
    early = [extra for flow in flows for extra in _along_the_road(flow, filled or {})]
    return {
        "no_social_vehicles": t.Traffic(flows=[]),
        "random_social_vehicles": t.Traffic(flows=[*early, *flows], trips=trips or None, warm_up=warm_up),
    }


def _along_the_road(flow: t.Flow, filled: Mapping[str, float]) -> Iterator[t.Flow]:
    """Yield flows of a moment that stand for the vehicles which would have entered before time 0."""
    if not isinstance(flow.route, t.Route):
        return
    road, lane, offset = flow.route.begin
    if road not in filled or offset != "base":
        return
    rate = flow.rate * SPACING / (TYPICAL_SPEED * FILLING_TIME)
    for place in range(SPACING, int(filled[road]), SPACING):
        route = replace(flow.route, begin=(road, lane, place))
        yield replace(flow, route=route, rate=rate, end=FILLING_TIME)
