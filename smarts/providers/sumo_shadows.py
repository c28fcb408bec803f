"""Shadows: vehicles that show SUMO's drivers the vehicles that SUMO does not drive.

A shadow is a vehicle of SUMO that is placed at its owner's pose (`moveToXY`) at the end of every step. SUMO's
drivers follow it, make way for it and brake for it as for SUMO's own vehicles, in both lanes if it straddles
two. SUMO's limitations, found by experiment (the tests in `test_sumo_shadows.py` show each):

- `keepRoute` must be 2: 1 leaves a ghost in the old lane, 0 snaps to the lane's centre. The first `moveToXY`
  must come before any step.
- Within a lane SUMO keeps vehicles in the order in which they came, so a shadow that overtakes inside a lane
  remains behind it in SUMO's lane order, and SUMO ignores it from then on. Likewise SUMO notes only on
  entry to a lane whether a vehicle straddles the next one: a shadow that drifts over the line is not seen
  there, and one that drifts back leaves a ghost. Such a shadow is re-inserted via the neighbouring lane,
  which its drivers cannot see; without such a lane it leaves the net for one step.
- Yielding drivers consider the routes of approaching vehicles. A shadow whose route ends before the
  junction is no reason to wait, so every shadow is given a route across the next junction: its own, or
  straight on.
- A vehicle is added on any road. If it is then placed on that road, SUMO resets its route to that one road a
  step later; so the route is set when the vehicle is added.
- SUMO derives a shadow's speed from its last two positions, and caps it at the lane's limit. The
  speed is set instead.
- Oncoming drivers do not see a shadow that reaches over the centre line; `sumo_proxies` shows it to them.
- A vehicle that moves against its lane would be taken for a leader that drives away; it is said to stand.
- SUMO continues a lane change that it has begun when a vehicle is taken over, and crashes if the vehicle is
  then in a lane without a neighbour. Such a change is completed in SUMO within the first step.
- SUMO would change a shadow's lane and ask others to make room for that, so lane changing is off meanwhile.
"""

from __future__ import annotations

import bisect
import enum
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smarts.geometry.binding import bind
from smarts.providers.sumo_library import SumoLibrary
from smarts.providers.sumo_proxies import SumoProxies
from smarts.providers.sumo_rows import lead
from smarts.roads.lane_graph import LaneGraph
from smarts.types.vehicles import VehicleKind, VehicleStates

_MAY_LEAVE_NET = 2
_MATCH_WITHIN = 8.0
"""Where SUMO looks for lanes [m]. At the intersection 20 m take three times the time, its own 100 m six.

Half a metre of distance counts to SUMO like 28 degrees of heading or 0.8 of being on the route, so beyond 8 m
no lane beats one within 4.4 m, and a vehicle further than that from the middle is on no lane of usual width.
"""
_NO_LANE_CHANGES = 0
_SUMO_LANE_CHANGES = 0b011001010101
"""Lane-change modes: nothing, and SUMO's default."""
_SIDEWAYS = "laneChangeModel.lcMaxSpeedLatStanding"
_AT_ONCE = 1e4
"""A limit to the speed of lane changes [m/s] that ends one in a step; `_SIDEWAYS` is its other half."""
_CENTRING = 0.1
"""How far a vehicle that SUMO has got back moves to the middle of its lane in a step [m]."""
_OVER_THE_LINE = 0.1
"""How far a vehicle must reach over a line to be seen there for sure [m]."""
_OFF_THE_NET = -1e6
"""Both coordinates of a place that is on no map [m]."""


class _Entry(enum.Enum):
    """How a shadow is re-inserted into its lane."""

    BESIDE = enum.auto()
    """By way of the lane that it straddles into."""
    AND_BACK = enum.auto()
    """By way of a lane beside and back at once."""
    OFF_THE_NET = enum.auto()
    """By leaving the net for one step."""


@dataclass
class _Shadow:
    """A shadow between steps."""

    id: str
    route: tuple[str, ...]
    """Planned route; empty if unknown."""
    lane: str = ""
    position: float = 0.0
    """Of the front along the lane [m]."""
    offset: float = 0.0
    """Of the front to the left of the lane's centre [m]."""
    shift: float = 0.0
    """Lateral shift of the shadow in SUMO [m], to the left, so that SUMO sees the lane of its rear."""
    side: int = 0
    """Where it reaches into another lane: 1 left, -1 right, 0 nowhere."""
    noted_side: int = 0
    """The side that SUMO has noted."""
    entry: _Entry | None = None
    """How to re-insert it in the coming step."""
    own_type: str = ""
    own_sideways: str = ""
    """Type and `_SIDEWAYS`, to be restored after its change of lane was ended; empty if there was none."""


class SumoShadows:
    """The shadows of one simulation, by slot."""

    def __init__(self, library: SumoLibrary, states: VehicleStates) -> None:
        self._library = library
        self._states = states
        self._lead = bind(lead, states)
        self._shadows: dict[int, _Shadow] = {}
        self._returned: dict[int, _Shadow] = {}
        self._types: set[str] = set()
        self._ways_on: dict[str, list[str]] = {}
        self._courses: dict[str, tuple[list[float], list[float]]] = {}
        self._told: list[list[float]] = []
        self.proxies = SumoProxies(library)

    def __contains__(self, slot: int) -> bool:
        return slot in self._shadows

    def reset(self, roads: LaneGraph) -> None:
        """Clear all shadows; SUMO was restarted."""
        self._roads = roads
        self._half_widths = (roads.width / 2).tolist()
        self._shadows.clear()
        self._returned.clear()
        self._types.clear()
        self._ways_on.clear()
        self._courses.clear()
        self.proxies.reset(roads)

    def create(self, slot: int, name: str, route: Sequence[str]) -> None:
        """Add a vehicle that SUMO has not known; it is on the road at the end of the next step."""
        self._library.vehicle.add(name, "", typeID=self._type_of(slot))
        self._library.vehicle.setLaneChangeMode(name, _NO_LANE_CHANGES)
        if route:
            self._library.accepts(self._library.vehicle.setRoute, name, list(route))
        self._shadows[slot] = _Shadow(name, tuple(route))

    def take_over(self, slot: int, name: str) -> None:
        """Turn a vehicle of SUMO's into a shadow from the next step on."""
        vehicle = self._library.vehicle
        vehicle.setLaneChangeMode(name, _NO_LANE_CHANGES)
        route, lane = self._library.route_ahead(name), vehicle.getLaneID(name)
        shadow = _Shadow(name, route, lane, vehicle.getLanePosition(name))
        if slot in self._returned:
            shadow.noted_side = self._returned.pop(slot).noted_side
        if vehicle.getLateralSpeed(name):
            shadow.own_type = vehicle.getTypeID(name)
            shadow.own_sideways = vehicle.getParameter(name, _SIDEWAYS)
            vehicle.setMaxSpeedLat(name, _AT_ONCE)
            vehicle.setParameter(name, _SIDEWAYS, str(_AT_ONCE))
        self._shadows[slot] = shadow

    def hand_back(self, slot: int) -> bool:
        """Let SUMO drive a shadow on towards its destination; return whether SUMO can.

        Off its route, the vehicle takes the fastest way to its destination; without such a way, or
        without a planned route, it drives to the end of its road. It must stand on a lane.
        """
        shadow = self._shadows.pop(slot)
        self.proxies.remove(shadow.id)
        vehicle = self._library.vehicle
        if not vehicle.getLaneID(shadow.id):
            return False
        if shadow.shift:
            vehicle.setLateralLanePosition(shadow.id, shadow.offset)
        vehicle.setLaneChangeMode(shadow.id, _SUMO_LANE_CHANGES)
        self._restore_route(shadow)
        self._returned[slot] = shadow
        return True

    def forget(self, slot: int) -> None:
        """Drop the shadow in a slot, if there is one."""
        if shadow := self._shadows.pop(slot, None):
            self.proxies.remove(shadow.id)
        self._returned.pop(slot, None)

    def set_route(self, slot: int, edges: Sequence[str]) -> None:
        """Set the planned route of a shadow."""
        shadow = self._shadows[slot]
        shadow.route = tuple(edges)
        if shadow.lane:
            self._show_way_on(shadow, shadow.lane)

    def place(self) -> None:
        """Place every shadow for the end of the coming step."""
        move = self._library.vehicle.moveToXY
        # Plain numbers at once: every look into an array costs as much as a call to SUMO.
        self._told = self._lead(np.fromiter(self._shadows, np.intp, len(self._shadows))).tolist()
        for (slot, shadow), (x, y, angle, *_) in zip(self._shadows.items(), self._told, strict=True):
            if shadow.entry and not self._reinsert(shadow):
                shadow.entry = _Entry.OFF_THE_NET
                move(shadow.id, "", -1, _OFF_THE_NET, _OFF_THE_NET, 0.0, _MAY_LEAVE_NET, _MATCH_WITHIN)
                continue
            if self.proxies.has_one(shadow.id):
                self._place_proxy(slot, shadow)
            if shadow.shift:
                along = self._heading_of(shadow.lane, shadow.position)
                x, y = x - shadow.shift * math.sin(along), y + shadow.shift * math.cos(along)
            move(shadow.id, "", -1, x, y, angle, _MAY_LEAVE_NET, _MATCH_WITHIN)
        for slot in [*self._returned]:
            if self._is_centred(self._returned[slot]):
                del self._returned[slot]

    def settle(self) -> None:
        """Read the shadows' positions from SUMO, and plan corrections."""
        vehicle = self._library.vehicle
        for shadow, (_, _, _, heading, speed, *size) in zip(self._shadows.values(), self._told, strict=True):
            lane = vehicle.getLaneID(shadow.id)
            if lane:
                position = vehicle.getLanePosition(shadow.id)
                # On a bend, a vehicle is in line with the lane at its middle.
                lean = heading - self._heading_of(lane, position - size[0] / 2)
                if speed * math.cos(lean) < 0:
                    speed = 0.0
                self._settle_on_lane(shadow, lane, position, lean, *size)
            else:
                shadow.lane, shadow.entry, shadow.shift = "", None, 0.0
                self.proxies.remove(shadow.id)
            vehicle.setPreviousSpeed(shadow.id, abs(speed))
            if shadow.own_type:
                vehicle.setType(shadow.id, shadow.own_type)
                vehicle.setParameter(shadow.id, _SIDEWAYS, shadow.own_sideways)
                shadow.own_type = ""
        self.proxies.settle()

    def _place_proxy(self, slot: int, shadow: _Shadow) -> None:
        states, kind = self._states, self._type_of(slot)
        x, y = states.position[slot].tolist()
        heading, speed = float(states.heading[slot]), float(states.speed[slot])
        self.proxies.place(shadow.id, kind, (x, y), heading, speed, float(states.length[slot]))

    def _settle_on_lane(
        self, shadow: _Shadow, lane: str, position: float, lean: float, length: float, width: float
    ) -> None:
        number = self._roads.lane_of_id(lane)
        half = self._half_widths[number]
        lateral = self._library.vehicle.getLateralLanePosition(shadow.id)
        offset = lateral - shadow.shift
        # Its place in a step, when the proxy is there.
        drift = max(offset - shadow.offset, 0.0) if lane == shadow.lane else 0.0
        shadow.offset = offset
        shadow.side = self._side_of(number, lateral) if abs(lateral) + width / 2 > half else 0
        # What is not on this lane yet may well turn into it from another direction.
        tail, half_box = -min(length, position) * math.sin(lean), width / 2 * abs(math.cos(lean))
        left, right = offset + max(0.0, tail) + half_box, offset + min(0.0, tail) - half_box
        reaches_out = left > half or right < -half
        shadow.shift = self._shift_of(number, offset, left, right, width) if reaches_out else 0.0
        if left + drift > half or self.proxies.has_one(shadow.id):
            self.proxies.reach(shadow.id, number, left + drift)
        # SUMO has noted the side if it has just moved the shadow to this lane from another or from off the
        # net.
        is_noted = lane != shadow.lane or shadow.entry is _Entry.BESIDE
        if lane != shadow.lane:
            self._show_way_on(shadow, lane)
        shadow.lane, shadow.position = lane, position
        if shadow.entry is _Entry.AND_BACK:
            shadow.noted_side = 0
        elif is_noted:
            shadow.noted_side = shadow.side
        shadow.entry = None
        if shadow.side != shadow.noted_side or self._library.is_out_of_order(shadow.id, lane, position):
            shadow.entry = _Entry.BESIDE if shadow.side else _Entry.AND_BACK

    def _heading_of(self, lane: str, position: float) -> float:
        """Return the direction of a lane [rad] at one of SUMO's positions [m], or up to a metre on."""
        if lane not in self._courses:
            roads, number = self._roads, self._roads.lane_of_id(lane)
            rows = slice(int(roads.point_start[number]), int(roads.point_start[number + 1]))
            positions = roads.point_s[rows] * float(
                roads.sumo_length[number] / max(roads.length[number], 1e-9)
            )
            self._courses[lane] = positions.tolist(), roads.point_heading[rows].tolist()
        positions, headings = self._courses[lane]
        return headings[min(bisect.bisect_left(positions, position), len(headings) - 1)]

    def _shift_of(self, lane: int, offset: float, left: float, right: float, width: float) -> float:
        """Return how far SUMO must have a vehicle to the left to see the lane that its tail reaches into.

        SUMO takes all of a vehicle to be in line with its front, at `offset` from the lane's middle; it
        reaches from `right` to `left` [m]. Where the front is over the line itself, or there is no lane
        behind the line, nothing is to be shifted.
        """
        half, side = self._half_widths[lane], 1.0 if left > -right else -1.0
        if abs(offset) + width / 2 > half or not self._side_of(lane, side):
            return 0.0
        return side * (half - width / 2 + _OVER_THE_LINE) - offset

    def _is_centred(self, shadow: _Shadow) -> bool:
        """Ease a vehicle that was handed to SUMO to the middle of its lane; return whether that is over.

        SUMO would leave it where it is, with what it has noted of it, until it changes lanes.
        """
        vehicle = self._library.vehicle
        if abs(vehicle.getLateralLanePosition(shadow.id) - shadow.offset) > 1e-6:
            return True  # SUMO has begun to change lanes.
        shadow.offset -= math.copysign(min(abs(shadow.offset), _CENTRING), shadow.offset)
        vehicle.setLateralLanePosition(shadow.id, shadow.offset)
        if shadow.offset:
            return False
        if shadow.side or shadow.noted_side:
            shadow.lane, shadow.position = vehicle.getLaneID(shadow.id), vehicle.getLanePosition(shadow.id)
            shadow.entry = _Entry.AND_BACK
            self._reinsert(shadow)
        return True

    def _reinsert(self, shadow: _Shadow) -> bool:
        """Take a shadow out of its lane and in again; return whether there was a lane beside to do it by."""
        beside = self._lane_beside(shadow)
        if not beside:
            return False
        # SUMO refuses where the lane is not on the route that it has given to the shadow.
        move, accepts = self._library.vehicle.moveTo, self._library.accepts
        return accepts(move, shadow.id, beside, shadow.position) and (
            shadow.entry is _Entry.BESIDE or accepts(move, shadow.id, shadow.lane, shadow.position)
        )

    def _lane_beside(self, shadow: _Shadow) -> str:
        """Return the lane that a shadow straddles into, or else any lane beside its own, "" without one."""
        number = self._roads.lane_of_id(shadow.lane)
        left, right = int(self._roads.left[number]), int(self._roads.right[number])
        beside = left if shadow.side > 0 or right < 0 else right
        return self._roads.lane_ids[beside] if beside >= 0 else ""

    def _side_of(self, lane: int, offset: float) -> int:
        """Return 1 or -1 if there is a lane on the side where a vehicle is off the centreline, or else 0."""
        beside = self._roads.left if offset > 0 else self._roads.right
        return (1 if offset > 0 else -1) if beside[lane] >= 0 else 0

    def _show_way_on(self, shadow: _Shadow, lane: str) -> None:
        """Give a shadow that has come onto a road lane a route across the next junction."""
        if lane.startswith(":"):
            return
        edge = lane.rpartition("_")[0]
        if edge in shadow.route:
            shadow.route = shadow.route[shadow.route.index(edge) :]
            ahead = list(shadow.route)
        else:
            ahead = [edge, *self._way_on(lane)]
        if tuple(ahead) != self._library.route_ahead(shadow.id):
            # Where SUMO refuses, because the vehicle may not use a lane, it sees no way on; nothing else is
            # lost.
            self._library.accepts(self._library.vehicle.setRoute, shadow.id, ahead)

    def _way_on(self, lane: str) -> list[str]:
        """Return the edge that a lane leads into, the one straight on where there are several."""
        if lane not in self._ways_on:
            links = self._library.lane.getLinks(lane)
            straight = [link for link in links if link[6] == "s"]
            self._ways_on[lane] = [link[0].rpartition("_")[0] for link in (straight or list(links))[:1]]
        return self._ways_on[lane]

    def _restore_route(self, shadow: _Shadow) -> None:
        """Send a vehicle on to its destination: along its own route, or else by the fastest way."""
        if not shadow.route:
            return
        vehicle = self._library.vehicle
        present = self._library.route_ahead(shadow.id)
        # Inside a junction the edge behind it is settled already.
        settled = present[: 2 if vehicle.getRoadID(shadow.id).startswith(":") else 1]
        here, destination = settled[-1], shadow.route[-1]
        if here in shadow.route:
            ahead = shadow.route[shadow.route.index(here) :]
        else:
            find = self._library.simulation.findRoute
            ahead = tuple(find(here, destination, vehicle.getTypeID(shadow.id)).edges)
        if ahead and (*settled[:-1], *ahead) != present:
            vehicle.setRoute(shadow.id, [*settled[:-1], *ahead])

    def _type_of(self, slot: int) -> str:
        """Return a vehicle type with the footprint of the vehicle in a slot, made on first use."""
        states = self._states
        kind = VehicleKind(states.kind[slot])
        length, width = float(states.length[slot]), float(states.width[slot])
        name = f"shadow-{kind.name.lower()}-{length!r}x{width!r}"
        if name not in self._types:
            vehicletype = self._library.vehicletype
            vehicletype.copy("DEFAULT_VEHTYPE", name)
            vehicletype.setVehicleClass(name, kind.name.lower())
            vehicletype.setLength(name, length)
            vehicletype.setWidth(name, width)
            # With a spread, the type would draw from SUMO's random stream.
            vehicletype.setSpeedDeviation(name, 0.0)
            self._types.add(name)
        return name
