"""The arrays of native traffic: records, so that what is known of a vehicle is side by side in memory.

Kernels take records by reference: `car = n.cars[place]`, then `car.front += 1.0`. Lengths and places along
lanes are in m, times in s, speeds in m/s; -1 stands for none. Axis letters: B simulations, V slots, L lanes
of all maps, K links ahead.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import numpy as np

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.roads.arrays import Roads, RouteTable
from smarts.types.vehicles import VehicleStates

LINKS = 8
"""K, the links ahead that a driver looks at."""
TAILS = 3
"""Lanes behind the front's that a vehicle may lie on."""
ADVICES = 4
"""Accelerations that neighbours may ask of a driver in a step."""
MAJOR = 8
"""Added to a `Signal` that is green before others."""
Records: TypeAlias = Any
"""An array of records: their fields are attributes in kernels only, which no type of NumPy says."""
Record: TypeAlias = Any
"""A record in a kernel."""
Car: TypeAlias = Record
Link: TypeAlias = Record
Lane: TypeAlias = Record
Entry: TypeAlias = Record


def _record(*groups: str) -> np.dtype:
    """Return a dtype with the fields of groups such as "left right: i4"; "2f8" is an array of two numbers."""
    split = [group.split(": ") for group in groups]
    return np.dtype([(name, kind) for names, kind in split for name in names.split()], align=True)


VEHICLE_TYPE = _record(
    # A vehicle type with SUMO's attributes: a `car_following.Driver`, and what else it decides.
    "accel decel tau sigma min_gap max_speed reaction: f8",
    "strategic cooperative speed_gain keep_right assertive impatience: f8",
    # `jmTimegapMinor`, `jmIgnoreJunctionFoeProb`, `jmDriveAfterRedTime`, `jmDriveAfterYellowTime`.
    "time_gap ignores_foes after_red after_yellow: f8",
    # The speed factor is drawn from a normal distribution that is cut off.
    "hardest factor_mean factor_deviation factor_least factor_most length width: f8",
    # A `VehicleKind`.
    "kind: i4",
    "is_idm ballistic: ?",
    "dt: f8",
)
WAY = _record(
    # The lane that a route uses; rows of the next lane of the route, and of the lanes to the left and right.
    "lane next left right: i4",
    # Lane changes to the left, < 0 to the right, to the lane that leads farthest on the route.
    "changes: i4",
    # What can be driven without a change, from the lane's begin; where the vehicle arrives, infinite but on a
    # route's last edge.
    # The place at which it stops, from and to, and for how long; infinite and 0 for none.
    "length arrival stop_begin stop halt: f8",
    "route: i4",
)
FLOW = _record(
    # Departures on a route; the mean time between vehicles is infinite for a single one.
    "begin end headway: f8",
    # Whether vehicles are exponentially spaced; row of their lane.
    "is_random: ?",
    "row: i4",
    # Place of the front, or a value in `departing.py`; a negative speed is the highest that is safe.
    "place speed: f8",
    # Its shares, the last one included.
    "first last: i4",
)
SHARE = _record("until: f8", "type: i4")
"""A vehicle type of a flow; `until` is the sum of the shares up to it, 1 in the end."""
PENDING = _record("next: f8", "waiting came: i4")
"""Departures of a flow: time of the next, how many have to wait, and have come, which keys the draws."""
PHASE = _record("least most: f8")
"""A phase of a light; it lasts longer than `least` while vehicles come (SUMO's `actuated`)."""
LIGHT = _record("first last: i4", "offset: f8")
"""A light of a map, with its phases, the last one included."""
LIT_LANE = _record("lane before light column: i4")
"""A lane that has a light, the one before it, which has a detector, and its column in the light's phases."""
MAP_LIGHTS = _record("first last first_lit last_lit: i4")
"""The lights and lanes with a light of a map, the last ones excluded."""
LIGHT_STATE = _record("phase: i4", "began seen: f8")
"""A light of a simulation; `seen`: when a vehicle that it lets through was last at its detector."""
YIELD = _record("lane foe: i4", "is_mutual merges: ?")
"""Two lanes of a junction: drivers on the first give way to those on the second; whether the second gives
way, too; whether both lead into one lane."""
TABLES = {"types": VEHICLE_TYPE, "ways": WAY, "flows": FLOW, "shares": SHARE, "phases": PHASE}
TABLES |= {"lights": LIGHT, "lit": LIT_LANE, "map_lights": MAP_LIGHTS, "yields": YIELD}
"""Tables of all scenarios, by their names in `Traffic`."""
LANE = _record(
    "length width speed: f8",
    "left right junction: i4",
    # Inside a junction; ends at a place to wait there; gives way to others, without lights; turns off; has a
    # light.
    "inside waits minor turns lit: ?",
    # Edge that it is of, or leads into from a junction, numbered across all maps.
    "leads: i4",
    # Where its own begin in the arrays of these names; they end where those of the next lane begin.
    "successors predecessors siblings conflicts: i4",
    # In the simulation whose turn it is: entry of the rearmost vehicle; first request, as `next` of links.
    "head approach: i4",
    # Place of the foremost vehicle that wants onto it for its route and is blocked.
    "first_blocked: i4",
    # Lengths with gaps of the vehicles whose fronts are on it.
    "taken: f8",
    # What its light shows, with `MAJOR`; time for which it has shown this.
    "green: i4",
    "shown: f8",
)
SIBLING = _record("lane: i4", "until: f8")
"""A lane in a junction that begins where another begins, and how far both are beside each other."""
CONFLICT = _record("lane kind yields: i4", "begin end its_begin its_end: f8")
"""A lane that crosses or joins another; see `LaneGraph.conflict_start`; the places are SUMO's."""
ENTRY = _record("next car lane: i4", "front back speed: f8")
"""A vehicle on a lane; `next` is the entry ahead. The speed is that along the lane, 0 against it."""
LINK = _record(
    # What a vehicle plans at a lane's end: rows of that lane and of the next, -1 where it stops or arrives.
    # The next request to enter the same lane, as `slot * K + link`.
    "row target next: i4",
    # Distance; highest speeds after the step if the link is passed, and if the vehicle waits before it.
    "distance speed waiting: f8",
    "asks: ?",
    # When and how fast it comes there, and if it brakes from now on; when and how fast its tail has passed
    # the lane behind. Times count from the begin of the step.
    "arrival arrival_speed braking_speed leaving leaving_speed: f8",
    # Free space behind the link; whether a vehicle stands there.
    "room: f8",
    "blocked: ?",
)
CAR = _record(
    # Place among the vehicles of all simulations; slot and simulation; number in the episode, which keys the
    # draws.
    "place slot sim number: i4",
    # Whether the engine drives it. Its type, while others drive it that of a stranger; the generation and
    # type of the driver that is remembered then.
    "is_own: ?",
    "type last driver: i4",
    "length width speed acceleration next_speed: f8",
    # Lane and row of the front, and its place; other providers' vehicles are on the lane of their centre.
    "lane row: i4",
    "front: f8",
    # Lanes behind it, the nearest first.
    f"tails: {TAILS}i4",
    # Offset to the left; 1 while it changes to the left, -1 to the right; share of the change that is done.
    "offset: f8",
    "side: i4",
    "done: f8",
    # Desired speed in speed limits, and on its lane; time that it has stood, also where its row has a stop.
    "factor desired waited halted: f8",
    # Whether it waits at its next link, and asks to leave its junction.
    "must_wait will_leave: ?",
    # When it entered its junction, infinite outside, or if it lets others go first; when the part where
    # others cross.
    "entered first_entered conflicted: f8",
    # Accumulated wishes to change for speed, positive to the left, and to keep right; speed for which it
    # looks ahead; distance left to change in, and what is kept of it for one that wants the other way.
    "gain keeping memory space reserved: f8",
    # Side to which it wants, a sum of reasons in `moving.py`, side of one that wants to come before this one.
    "wish reason asked: i4",
    # Accelerations that it or neighbours want, how much each counts, and their number.
    f"advice weight: {ADVICES}f8",
    "advised: i4",
    # Time of its next decision; number of its links ahead.
    "next_action: f8",
    "links: i4",
)
SIMULATION = _record(
    # Steps since the warm-up began; vehicles so far, and at most.
    "seed: i8",
    "tick born limit: i4",
    # First flow, number of flows, first route of the scenario; type of other providers' vehicles.
    "flow flows route stranger: i4",
    "is_full: ?",
)


class Traffic(NamedTuple):
    """All arrays of native traffic; replaced in the bound kernels when a scenario is added."""

    owner: int
    dt: float
    map: Ints
    """As in the world, shape (B,)."""
    signals: Bytes
    """As in the world, shape (B, .)."""
    vehicles: VehicleStates
    used: Ints
    """As in the world, shape (B,)."""
    placed: Bools
    """As in the world, shape (B, V)."""
    roads: Roads
    no_routes: RouteTable
    sims: Records
    """Shape (B,)."""
    cars: Records
    """Shape (B V,)."""
    by_slot: Records
    """The same, shape (B, V)."""
    new_car: Records
    """Shape (1,)."""
    driven: Ints
    """Generation of the vehicle that the engine drives in each slot, shape (B, V)."""
    order: Ints
    """Room for the slots that may change lanes, the foremost first, shape (V,)."""
    lanes: Records
    """Shape (L + 1,)."""
    successor: Ints
    predecessor: Ints
    siblings: Records
    conflicts: Records
    links: Records
    """Plans of the simulation that is stepped, shape (V, K)."""
    entries: Records
    """Likewise."""
    counts: Ints
    """Number of entries, and of those of other providers' vehicles, which come first, shape (2,)."""
    yield_start: Ints
    """Where those of each lane begin in `yields`, shape (L + 1,)."""
    yields: Records
    room: tuple[Ints, Ints, Floats]
    """Room to search for a pose's lane."""
    types: Records
    ways: Records
    flows: Records
    shares: Records
    pending: Records
    """Shape (B, F of the largest scenario)."""
    route_number: Ints
    """Number in `world.routes` of each route of the simulation's scenario, shape (B, .)."""
    phases: Records
    shows: Bytes
    """A `Signal` for each phase and column; `MAJOR` more where it goes first."""
    lights: Records
    lit: Records
    map_lights: Records
    """Shape (M,)."""
    light_states: Records
    """Shape (B, lights of all maps)."""
