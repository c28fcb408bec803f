"""The arrays of native traffic.

Axis letters: B simulations, V slots, L lanes of all maps, K links ahead, T vehicle types, F flows, R rows.
"""

from __future__ import annotations

from typing import NamedTuple

from smarts.arrays import Bools, Bytes, Floats, Ints, Longs
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.world import State

LINKS = 8
"""K, the links ahead that a driver looks at."""
TAILS = 3
"""Lanes behind the front's that a vehicle may lie on."""
ADVICES = 4
"""Accelerations that neighbours may ask of a driver in a step."""


class Types(NamedTuple):
    """Vehicle types, shape (T,) each; SUMO's attributes."""

    accel: Floats
    decel: Floats
    hardest: Floats
    """Deceleration in an emergency [m/s^2]."""
    tau: Floats
    sigma: Floats
    min_gap: Floats
    max_speed: Floats
    factor_mean: Floats
    """Mean of the speed factor, which is drawn from a normal distribution that is cut off."""
    factor_deviation: Floats
    factor_least: Floats
    factor_most: Floats
    reaction: Floats
    """Time between decisions, `actionStepLength` [s]; 0: each step."""
    is_idm: Bools
    strategic: Floats
    cooperative: Floats
    speed_gain: Floats
    keep_right: Floats
    assertive: Floats
    impatience: Floats
    time_gap: Floats
    """`jmTimegapMinor` [s]."""
    ignores_foes: Floats
    """`jmIgnoreJunctionFoeProb`."""
    after_red: Floats
    """`jmDriveAfterRedTime` [s]."""
    after_yellow: Floats
    """`jmDriveAfterYellowTime` [s]."""
    length: Floats
    width: Floats
    kind: Bytes
    """A `VehicleKind`."""


class Ways(NamedTuple):
    """Routes as rows, one for each use of a lane, shape (R,) each but for routes."""

    lane: Ints
    """Numbered across all maps."""
    next: Ints
    """Row of the lane that the vehicle drives into, -1 where this lane leads nowhere on the route."""
    left: Ints
    """Row of the lane to the left, -1 for none."""
    right: Ints
    changes: Ints
    """Lane changes to the left, < 0 to the right, to the lane that leads farthest on the route."""
    length: Floats
    """What can be driven without a change, from this lane's begin [m]."""
    arrival: Floats
    """Arc length at which the vehicle arrives [m], infinite but on a route's last edge."""
    route: Ints
    """Number of its route among all."""


class Flows(NamedTuple):
    """Departures, shape (F,) each."""

    begin: Floats
    end: Floats
    """[s]"""
    headway: Floats
    """Mean time between vehicles [s], infinite for a single one."""
    is_random: Bools
    """Whether vehicles are exponentially spaced."""
    row: Ints
    """Row of the lane on which they depart."""
    place: Floats
    """Arc length of the front [m], -1: the tail where the lane begins, -2: drawn."""
    speed: Floats
    """[m/s], negative: the highest that is safe."""
    mix: Ints
    """CSR of the types, shape (F + 1,)."""
    mix_type: Ints
    mix_share: Floats
    """Sum of the shares up to this type, 1 in the end."""


class Signals(NamedTuple):
    """Lights of all maps in a row, with fixed programs or such that wait for gaps (SUMO's `actuated`)."""

    lanes: Ints
    """CSR by map of the lanes that have a light."""
    lane: Ints
    light: Ints
    """The signal of each of these lanes."""
    column: Ints
    """The lane's column in its signal's phases."""
    map_first: Ints
    """First signal of each map, and the number of all, shape (M + 1,)."""
    phases: Ints
    """CSR by signal of its phases."""
    least: Floats
    """Shortest duration of each phase [s]."""
    most: Floats
    """How long it lasts at most [s]: longer than `least`, if it lasts while vehicles come."""
    offset: Floats
    """Offset of each signal [s]."""
    before: Ints
    """The lane before each lane that has a light."""
    shows: Bytes
    """A `Signal` for each phase and column; `MAJOR` more where it goes first."""


MAJOR = 8
"""Added to a `Signal` that is green before others."""


class Lights(NamedTuple):
    """The signals of B simulations, shape (B, signals of all maps) each."""

    phase: Ints
    """Row of the present phase in `Signals.least`."""
    began: Floats
    """Time at which it began [s]."""
    seen: Floats
    """Time at which a vehicle that it lets through was last at its detector [s]."""


class Links(NamedTuple):
    """What vehicles of one simulation plan at each link ahead, shape (V, K) each but `total`.

    A link is the begin of a lane inside a junction, or of the road behind it. Times count from the begin of
    the step.
    """

    total: Ints
    """Links of each vehicle, shape (V,)."""
    row: Ints
    """Row of the lane that the link leads to, -1: the vehicle stops before its lane's end, or arrives."""
    distance: Floats
    """Distance to the link [m]."""
    speed: Floats
    """Highest speed after the step if the link is passed [m/s]."""
    waiting: Floats
    """Highest speed after the step if the vehicle waits before it [m/s]."""
    asks: Bools
    """Whether the vehicle asks to pass."""
    arrival: Floats
    """Time at which it comes there [s]."""
    arrival_speed: Floats
    braking_speed: Floats
    """Speed there if it brakes from now on [m/s]."""
    leaving_speed: Floats
    """Speed at which it has passed the lane behind the link [m/s]."""
    leaving: Floats
    """Time at which its tail has passed it [s]."""
    room: Floats
    """Free space behind the link [m]."""
    blocked: Bools
    """Whether a vehicle stands there."""
    next: Ints
    """The next of the vehicles and links that lead to the same lane, as `slot * K + link`, -1 for none."""


class Driven(NamedTuple):
    """The engine's memory of the vehicles that it drives, shape (B, V) each."""

    generation: Ints
    """Generation of the vehicle, -1 for none."""
    last: Ints
    """Generation of the vehicle whose driver it is, shape (B, V): that stays when others take it."""
    number: Ints
    """Number of the vehicle in its episode; keys its draws."""
    type: Ints
    row: Ints
    """Row of the front's lane."""
    front: Floats
    """Arc length of the front bumper on its lane [m]."""
    tails: Ints
    """Lanes behind it, the nearest first, -1 for none, shape (B, V, TAILS)."""
    offset: Floats
    """Offset to the left of the lane [m]."""
    side: Ints
    """1 while the vehicle changes to the left, -1 to the right."""
    done: Floats
    """Share of the change that is done."""
    factor: Floats
    """Desired speed, in speed limits."""
    waited: Floats
    """Time that it has stood [s]."""
    must_wait: Bools
    """Whether it waits at its next link."""
    will_leave: Bools
    """Whether it asks to leave its junction."""
    entered: Floats
    """Time at which it entered its junction, infinite outside, or if it lets others go first [s]."""
    first_entered: Floats
    conflicted: Floats
    """Time at which it entered the part of it where others cross [s]."""
    gain: Floats
    """Accumulated wish to change for speed, positive to the left."""
    keeping: Floats
    """Accumulated wish to keep right."""
    memory: Floats
    """Speed for which it looks ahead [m/s]."""
    wish: Ints
    """1: it wants to the left, -1: to the right."""
    reason: Ints
    """A sum of those in `changing.py`."""
    asked: Ints
    """Direction of a vehicle ahead that wants to come before this one, 0 for none."""
    space: Floats
    """Distance left to change in [m]."""
    reserved: Floats
    """Part of it that is kept for a vehicle that wants the other way [m]."""
    advice: Floats
    """Accelerations asked for by neighbours [m/s^2], shape (B, V, ADVICES)."""
    advised: Ints
    """Number of these accelerations."""
    next_action: Floats
    """Time of its next decision [s]."""
    order: Ints
    """The slots of the engine's vehicles as they follow each other, sorted by `front`, the foremost first."""
    listed: Ints
    """How many those are: the first element of each row."""


class Pending(NamedTuple):
    """Departures to come, shape (B, F of the largest scenario) each."""

    next: Floats
    """Time of the next vehicle [s]."""
    waiting: Ints
    """Vehicles whose time has come."""
    came: Ints
    """Vehicles that have come; keys the draws."""


class Demand(NamedTuple):
    """What scenarios want, and what is as large as they want it; replaced when a scenario is added."""

    types: Types
    ways: Ways
    flows: Flows
    signals: Signals
    pending: Pending
    lights: Lights
    route_number: Ints
    """Number in `world.routes` of each route of the simulation's scenario, shape (B, .)."""


class Occupancy(NamedTuple):
    """The vehicles on each lane of one simulation, in linked lists from the rear."""

    head: Ints
    """Rearmost entry of each lane, -1 for none, shape (L,)."""
    approach: Ints
    """First of the vehicles that ask to pass each lane's link, as `Links.next`, shape (L,)."""
    next: Ints
    """Entry ahead, -1 for none, shape (6 V,), as are the following."""
    slot: Ints
    lane: Ints
    front: Floats
    back: Floats
    """Place along the lane [m]."""
    pace: Floats
    """Speed along the lane, 0 against it [m/s]."""
    entries: Ints
    """Entries, shape (1,)."""
    taken: Floats
    """Lengths with gaps of the vehicles whose fronts are on each lane [m], shape (L,)."""
    listed: Bools
    """Whether each slot has been listed, shape (V,)."""
    other_lane: Ints
    """Lane of each vehicle of another provider, -1 for none, shape (V,)."""
    other_front: Floats
    """Place of its front along that lane [m], shape (V,)."""
    speed: Floats
    """Speed with which each vehicle will drive [m/s], shape (V,)."""
    green: Bytes
    """What each lane's light shows, with `MAJOR`, shape (L,)."""
    shown: Floats
    """Time for which it has shown this [s], shape (L,)."""
    lanes: Ints
    """Room to search for a pose's lane, as are the following, shape (MOST_CANDIDATES,)."""
    points: Ints
    squares: Floats


class Traffic(NamedTuple):
    """All arrays of native traffic that stay the same objects."""

    owner: int
    state: State
    roads: Roads
    no_routes: RouteTable
    successor_start: Ints
    """CSR of the lanes that each leads into, numbered across all maps, as are the following."""
    successor: Ints
    predecessor_start: Ints
    predecessor: Ints
    lane_length: Floats
    """[m], shape (L,)."""
    lane_minor: Bools
    """Whether drivers that enter the lane give way to others, without lights, shape (L,)."""
    lane_turns: Bools
    """Whether the lane turns off in a junction, shape (L,)."""
    lane_signal: Bools
    """Whether the lane has a light, shape (L,)."""
    sibling_start: Ints
    """CSR of the lanes in a junction that begin where each begins, shape (L + 1,)."""
    sibling: Ints
    sibling_until: Floats
    """Arc length at which both are beside each other [m]."""
    lane_leads: Ints
    """Edge that the lane is of, or leads into from a junction, numbered across all maps, shape (L,)."""
    driven: Driven
    occupancy: Occupancy
    links: Links
    seed: Longs
    """Seed of each episode, shape (B,)."""
    tick: Ints
    """Steps since the warm-up began, shape (B,)."""
    born: Ints
    """Vehicles so far, shape (B,)."""
    limit: Ints
    """Most vehicles, shape (B,)."""
    flow_start: Ints
    flow_count: Ints
    """The simulation's flows in `Flows`, shape (B,)."""
    ballistic: Bools
    """Shape (B,)."""
    route_start: Ints
    """First route of the simulation's scenario, shape (B,)."""
    is_full: Bools
    """Shape (B,)."""
