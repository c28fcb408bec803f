"""Shadows: make vehicles of other providers visible to SUMO's drivers.

A shadow is a SUMO vehicle that is moved to the pose of another provider's vehicle (`moveToXY`) in every step.
SUMO's drivers follow it, yield to it and brake for it as for any SUMO vehicle, in both lanes if it straddles
two. SUMO needs these workarounds, found by experiment and shown by the tests in `test_sumo_shadows.py`:

- `keepRoute` must be 2: 1 leaves a ghost in the old lane, 0 snaps the vehicle to the lane's centre. The first
  `moveToXY` must precede any step.
- SUMO keeps the vehicles of a lane in the order of their arrival. A shadow that overtakes within a lane
  remains behind the overtaken vehicle in this order, and its driver ignores the shadow from then on. SUMO
  also detects only on entry to a lane whether a vehicle straddles the next lane: a shadow that drifts over
  the line is not seen there, and one that drifts back leaves a ghost. Such a shadow is re-inserted via the
  neighbouring lane, without effect on the drivers there, or leaves the net for one step if there is none.
- Yielding drivers consider the routes of approaching vehicles. They ignore a shadow whose route ends before
  the junction, so every shadow gets a route across the next junction: its own, or straight on.
- SUMO adds a vehicle on any edge. If the vehicle is then placed on that edge, SUMO resets its route to that
  edge one step later; so the route is set when the vehicle is added.
- SUMO derives a shadow's speed from its last two positions and caps it at the lane's limit; so the speed is
  set explicitly.
- Oncoming drivers do not see a shadow that crosses the centre line; `sumo_proxies` makes it visible.
- SUMO takes a vehicle that moves against its lane for a leader that drives away; so its speed is set to 0.
- SUMO continues a lane change that was in progress when a vehicle becomes a shadow, crashes if the vehicle is
  then on a lane without a neighbour, and shows the vehicle turned when it drives it again. So such a vehicle
  is replaced in SUMO by a new one of the same type.
- SUMO may keep a shadow that leaves the net in the list of a lane, and crash when others come by. So it is
  replaced then, too. A jump to another place on the net has the same effect; so the vehicle leaves the net.
- SUMO would change a shadow's lane and make others cooperate, so lane changing is disabled for shadows.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Iterator, Sequence

import numpy as np

from smarts.geometry.binding import bind
from smarts.providers.sumo_arrivals import Arrival
from smarts.providers.sumo_library import SumoLibrary
from smarts.providers.sumo_proxies import SumoProxies
from smarts.providers.sumo_rows import lead
from smarts.providers.sumo_shadow import Reinsertion, Shadow
from smarts.roads.lane_graph import LaneGraph
from smarts.types.vehicles import VehicleKind, VehicleStates

_MAY_LEAVE_NET = 2
_MATCH_WITHIN = 8.0
"""Radius in which SUMO looks for lanes [m]. At an intersection, 20 m take three times as long, SUMO's default
of 100 m six times.

SUMO weighs 0.5 m of distance like 28 degrees of heading or 0.8 of being on the route. So no lane beyond 8 m
is preferred to one within 4.4 m, and a vehicle farther than that from a centreline is off lanes of usual
width.
"""
_NO_LANE_CHANGES = 0
_SUMO_LANE_CHANGES = 0b011001010101
"""Lane-change modes: none, and SUMO's default."""
_CENTRING = 0.03
"""Distance per step by which a vehicle handed back to SUMO moves to its centreline [m]."""
_CALM_STEPS = 2
"""Steps in which SUMO begins no lane change with it."""
_OVER_THE_LINE = 0.1
"""Overlap with a lane at which its drivers see the vehicle reliably [m]."""
_FASTEST = 100.0
"""Speed above which a vehicle does not drive but jumps [m/s]."""
_OFF_THE_NET = -1e6
"""Both coordinates of a position off every map [m]."""


class SumoShadows:
    """The shadows of one simulation, by slot.

    Args:
        library: The copy of libsumo that runs the simulation.
        states: Vehicles of the simulation.
        step: Duration of SUMO's step [s].
    """

    def __init__(self, library: SumoLibrary, states: VehicleStates, step: float) -> None:
        self._library = library
        self._states = states
        self._farthest = max(10.0, _FASTEST * step)
        self._lead = bind(lead, states)
        self._shadows: dict[int, Shadow] = {}
        self.returned: dict[int, Shadow] = {}
        """The former shadows that SUMO drives and may not have on their centrelines yet."""
        self._types: set[str] = set()
        self._lane_headings: dict[str, tuple[list[float], list[float]]] = {}
        self._poses: list[list[float]] = []
        self.lost: list[int] = []
        """Slots of the shadows that have left SUMO's net in the last step."""
        self.proxies = SumoProxies(library)

    def __contains__(self, slot: int) -> bool:
        return slot in self._shadows

    def __iter__(self) -> Iterator[int]:
        """Yield the slots of the vehicles that have shadows."""
        return iter(self._shadows)

    def __getitem__(self, slot: int) -> Shadow:
        return self._shadows[slot]

    def reset(self, roads: LaneGraph) -> None:
        """Clear all shadows; SUMO was restarted."""
        self._roads = roads
        self._half_widths = (roads.width / 2).tolist()
        for known in (self._shadows, self.returned, self._types, self._lane_headings):
            known.clear()
        self.proxies.reset(roads)

    def create(self, slot: int, name: str, route: Sequence[str]) -> None:
        """Add a vehicle to SUMO as a shadow; it is on the road at the end of the next step."""
        self._library.vehicle.add(name, "", typeID=self._type_of(slot))
        self._library.vehicle.setLaneChangeMode(name, _NO_LANE_CHANGES)
        if route:
            self._library.accepts(self._library.vehicle.setRoute, name, list(route))
        self._shadows[slot] = Shadow(name, tuple(route))

    def take_over(self, slot: int, name: str) -> None:
        """Make a vehicle that SUMO drives a shadow from the next step on."""
        vehicle = self._library.vehicle
        vehicle.setLaneChangeMode(name, _NO_LANE_CHANGES)
        route, lane = self._library.route_ahead(name), vehicle.getLaneID(name)
        self._shadows[slot] = shadow = Shadow(name, route, lane, vehicle.getLanePosition(name))
        if slot in self.returned:
            shadow.noted_side = self.returned.pop(slot).noted_side

    def replace(self, slot: int, name: str, new_name: str, arrival: Arrival) -> None:
        """Make a vehicle in SUMO a shadow, under a new name, from the next step on.

        The new vehicle has the type, speed factor, colour, line, planned route, and stops ahead of the old
        one, and its arrival. What TraCI neither gives nor takes is lost: its time of departure, and the
        parameters of its devices.

        Args:
            slot: The vehicle's.
            name: Its id in SUMO.
            new_name: Name of the new vehicle.
            arrival: Where the vehicle arrives, see `SumoArrivals`.
        """
        vehicle, shadow = self._library.vehicle, self._shadows.get(slot)
        # Off its planned route, a shadow has another one in SUMO.
        route = shadow.route if shadow else self._library.route_ahead(name)
        kind, factor = vehicle.getTypeID(name), vehicle.getSpeedFactor(name)
        colour, line, stops = vehicle.getColor(name), vehicle.getLine(name), vehicle.getStops(name)
        vehicle.remove(name)
        vehicle.add(new_name, "", typeID=kind, line=line, **arrival)
        vehicle.setSpeedFactor(new_name, factor)
        vehicle.setColor(new_name, colour)
        vehicle.setLaneChangeMode(new_name, _NO_LANE_CHANGES)
        if route:
            self._library.accepts(vehicle.setRoute, new_name, list(route))
        for stop in stops:
            self._library.copy_stop(new_name, stop)
        self.returned.pop(slot, None)
        self._shadows[slot] = Shadow(new_name, route)

    def hand_back(self, slot: int) -> bool:
        """Hand a shadow back to SUMO; return whether SUMO can drive it, which requires a lane.

        Off its route, the vehicle takes the fastest route to its destination. Without such a route, or if its
        destination is unknown, it drives to the end of its road.
        """
        shadow = self._shadows.pop(slot)
        self.proxies.remove(shadow.id)
        vehicle = self._library.vehicle
        if not vehicle.getLaneID(shadow.id):
            return False
        if shadow.way:
            shadow.offset = shadow.back
        if vehicle.getLateralLanePosition(shadow.id) != shadow.offset:
            vehicle.setLateralLanePosition(shadow.id, shadow.offset)
        shadow.calm_steps = _CALM_STEPS
        if shadow.way and shadow.way[0] == vehicle.getRoadID(shadow.id):
            if shadow.way != self._library.route_ahead(shadow.id):
                self._library.accepts(vehicle.setRoute, shadow.id, list(shadow.way))
        else:
            self._restore_route(shadow)
        self.returned[slot] = shadow
        return True

    def forget(self, slot: int) -> None:
        """Drop the shadow of a slot, if there is one."""
        if shadow := self._shadows.pop(slot, None):
            self.proxies.remove(shadow.id)
        self.returned.pop(slot, None)

    def set_route(self, slot: int, edges: Sequence[str]) -> None:
        """Set the planned route of a shadow."""
        shadow = self._shadows[slot]
        shadow.route = tuple(edges)
        if shadow.lane:
            self._extend_route(shadow, shadow.lane)

    def place(self, ahead: float = 0.0) -> None:
        """Set the pose of every shadow at the end of the next step, `ahead` [s] after the vehicles' poses."""
        move = self._library.vehicle.moveToXY
        # Convert to Python numbers at once: access to an array element costs as much as a call to SUMO.
        self._poses = self._lead(np.fromiter(self._shadows, np.intp, len(self._shadows)), ahead).tolist()
        for (slot, shadow), (x, y, angle, *_) in zip(self._shadows.items(), self._poses, strict=True):
            # A proxy that is not placed drives on by itself, and may arrive.
            if self.proxies.has_one(shadow.id):
                self._place_proxy(slot, shadow)
            is_astray = self._jumps(shadow, (x, y)) or self._is_beside_level(slot)
            if is_astray or (shadow.reinsertion and not self._reinsert(shadow)):
                shadow.reinsertion = Reinsertion.OFF_THE_NET
                move(shadow.id, "", -1, _OFF_THE_NET, _OFF_THE_NET, 0.0, _MAY_LEAVE_NET, _MATCH_WITHIN)
                continue
            if shadow.shift:
                along = self._heading_of(shadow.lane, shadow.position)
                x, y = x - shadow.shift * math.sin(along), y + shadow.shift * math.cos(along)
            move(shadow.id, "", -1, x, y, angle, _MAY_LEAVE_NET, _MATCH_WITHIN)
        for slot, shadow in [*self.returned.items()]:
            shadow.calm_steps -= 1
            if self._is_centred(shadow) and shadow.calm_steps < 0:
                self._library.vehicle.setLaneChangeMode(shadow.id, _SUMO_LANE_CHANGES)
                del self.returned[slot]

    def _jumps(self, shadow: Shadow, front: tuple[float, float]) -> bool:
        """Return whether a shadow on the net has been moved farther than it can drive; note its new front."""
        last, shadow.front = shadow.front, front
        return bool(shadow.lane) and math.dist(last, front) > self._farthest

    def _is_beside_level(self, slot: int) -> bool:
        """Return whether a vehicle is so far beside the road that SUMO may find one of another level."""
        return self._roads.has_levels and abs(self._states.lane_offset[slot]) > _MATCH_WITHIN

    def settle(self) -> None:
        """Read the shadows' positions in SUMO, correct their speeds, and find the shadows to re-insert."""
        vehicle = self._library.vehicle
        self.lost.clear()
        for (slot, shadow), pose in zip(self._shadows.items(), self._poses, strict=True):
            _, _, _, heading, speed, *size = pose
            lane = vehicle.getLaneID(shadow.id)
            if lane:
                position = vehicle.getLanePosition(shadow.id)
                # In a bend, a vehicle is aligned with the lane at the vehicle's middle.
                lean = heading - self._heading_of(lane, position - size[0] / 2)
                if speed * math.cos(lean) < 0:
                    speed = 0.0
                self._settle_on_lane(shadow, lane, position, lean, *size)
            else:
                if shadow.lane:
                    self.lost.append(slot)
                shadow.lane, shadow.reinsertion, shadow.shift = "", None, 0.0
                self.proxies.remove(shadow.id)
            vehicle.setPreviousSpeed(shadow.id, abs(speed))
        self.proxies.settle()

    def _place_proxy(self, slot: int, shadow: Shadow) -> None:
        states, kind = self._states, self._type_of(slot)
        (x, y), heading = states.position[slot].tolist(), float(states.heading[slot])
        speed = float(states.speed[slot])
        self.proxies.place(shadow.id, kind, (x, y), heading, speed, float(states.length[slot]))

    def _settle_on_lane(
        self, shadow: Shadow, lane: str, position: float, lean: float, length: float, width: float
    ) -> None:
        number = self._roads.lane_of_id(lane)
        half = self._half_widths[number]
        lateral = self._library.vehicle.getLateralLanePosition(shadow.id)
        offset = lateral - shadow.shift
        # Predict one step ahead, when the proxy appears.
        drift = max(offset - shadow.offset, 0.0) if lane == shadow.lane else 0.0
        shadow.offset = offset
        shadow.side = self._side_of(number, lateral) if abs(lateral) + width / 2 > half else 0
        # The part of the vehicle before the lane's beginning may have another direction; ignore it.
        tail, half_box = -min(length, position) * math.sin(lean), width / 2 * abs(math.cos(lean))
        left, right = offset + max(0.0, tail) + half_box, offset + min(0.0, tail) - half_box
        reaches_out = left > half or right < -half
        shadow.shift = self._shift_of(number, offset, left, right, width) if reaches_out else 0.0
        if left + drift > half or self.proxies.has_one(shadow.id):
            self.proxies.reach(shadow.id, number, left + drift)
        # SUMO detects the side when it moves the shadow to this lane from another lane or from off the net.
        is_noted = lane != shadow.lane or shadow.reinsertion is Reinsertion.BESIDE
        if lane != shadow.lane:
            self._extend_route(shadow, lane)
        shadow.lane, shadow.position = lane, position
        if shadow.reinsertion is Reinsertion.AND_BACK:
            shadow.noted_side = 0
        elif is_noted:
            shadow.noted_side = shadow.side
        shadow.reinsertion = None
        if shadow.side != shadow.noted_side or self._library.is_out_of_order(shadow.id, lane, position):
            shadow.reinsertion = Reinsertion.BESIDE if shadow.side else Reinsertion.AND_BACK

    def _heading_of(self, lane: str, position: float) -> float:
        """Return a lane's heading [rad] at the first point at or after SUMO's `position` [m]."""
        if lane not in self._lane_headings:
            roads, number = self._roads, self._roads.lane_of_id(lane)
            rows = slice(int(roads.point_start[number]), int(roads.point_start[number + 1]))
            positions = roads.point_s[rows] * float(
                roads.driven_length[number] / max(roads.length[number], 1e-9)
            )
            self._lane_headings[lane] = positions.tolist(), roads.point_heading[rows].tolist()
        positions, headings = self._lane_headings[lane]
        return headings[min(bisect.bisect_left(positions, position), len(headings) - 1)]

    def _shift_of(self, lane: int, offset: float, left: float, right: float, width: float) -> float:
        """Return the shift to the left that makes SUMO see a vehicle in the lane that its tail reaches [m].

        SUMO assumes that the whole vehicle has the offset of its front. The shift is 0 if the front itself
        crosses the line, or if there is no lane beyond the line.

        Args:
            lane: Lane of the vehicle.
            offset: Offset of the front to the left of the centreline [m].
            left: Largest offset of the footprint [m].
            right: Smallest offset of the footprint [m].
            width: Width of the vehicle [m].
        """
        half, side = self._half_widths[lane], 1.0 if left > -right else -1.0
        if abs(offset) + width / 2 > half or not self._side_of(lane, side):
            return 0.0
        return side * (half - width / 2 + _OVER_THE_LINE) - offset

    def _is_centred(self, shadow: Shadow) -> bool:
        """Move a vehicle that was handed back towards its centreline; return whether it is done.

        SUMO would keep the vehicle's offset, and the side that it has detected, until the next lane change.
        """
        vehicle = self._library.vehicle
        if not shadow.offset and not shadow.noted_side:
            return True
        if abs(vehicle.getLateralLanePosition(shadow.id) - shadow.offset) > 1e-6:
            return True  # SUMO goes on with the lane change in which the vehicle was taken over.
        shadow.offset -= math.copysign(min(abs(shadow.offset), _CENTRING), shadow.offset)
        vehicle.setLateralLanePosition(shadow.id, shadow.offset)
        if shadow.offset:
            return False
        if shadow.side or shadow.noted_side:
            shadow.lane, shadow.position = vehicle.getLaneID(shadow.id), vehicle.getLanePosition(shadow.id)
            shadow.reinsertion = Reinsertion.AND_BACK
            self._reinsert(shadow)
            shadow.side = shadow.noted_side = 0
        return True

    def _reinsert(self, shadow: Shadow) -> bool:
        """Re-insert a shadow into its lane; return whether a neighbouring lane made this possible."""
        beside = self._lane_beside(shadow)
        if not beside:
            return False
        # SUMO raises an error if the lane is not on the shadow's route in SUMO.
        move, accepts = self._library.vehicle.moveTo, self._library.accepts
        return accepts(move, shadow.id, beside, shadow.position) and (
            shadow.reinsertion is Reinsertion.BESIDE or accepts(move, shadow.id, shadow.lane, shadow.position)
        )

    def _lane_beside(self, shadow: Shadow) -> str:
        """Return the lane that a shadow straddles, or else any neighbouring lane, or ""."""
        number = self._roads.lane_of_id(shadow.lane)
        left, right = int(self._roads.left[number]), int(self._roads.right[number])
        beside = left if shadow.side > 0 or right < 0 else right
        return self._roads.lane_ids[beside] if beside >= 0 else ""

    def _side_of(self, lane: int, offset: float) -> int:
        """Return the side of an offset, 1 left or -1 right, if there is a lane on that side, else 0."""
        beside = self._roads.left if offset > 0 else self._roads.right
        return (1 if offset > 0 else -1) if beside[lane] >= 0 else 0

    def _extend_route(self, shadow: Shadow, lane: str) -> None:
        """Give a shadow that is new on a lane a route across the next junction."""
        if lane.startswith(":"):
            return
        edge = lane.rpartition("_")[0]
        if edge in shadow.route:
            shadow.route = shadow.route[shadow.route.index(edge) :]
            ahead = list(shadow.route)
        else:
            ahead = [edge, *self._library.edges_onward(lane)[:1]]
        if tuple(ahead) != self._library.route_ahead(shadow.id):
            # If SUMO rejects the route, because the vehicle may not use a lane, the shadow keeps its old one.
            self._library.accepts(self._library.vehicle.setRoute, shadow.id, ahead)

    def _restore_route(self, shadow: Shadow) -> None:
        """Set the route of a vehicle to its destination: its planned route, or else the fastest one."""
        if not shadow.route:
            return
        vehicle = self._library.vehicle
        present = self._library.route_ahead(shadow.id)
        # Inside a junction, the edge after it is fixed already.
        fixed = present[: 2 if vehicle.getRoadID(shadow.id).startswith(":") else 1]
        here, destination = fixed[-1], shadow.route[-1]
        if here in shadow.route:
            ahead = shadow.route[shadow.route.index(here) :]
        else:
            find = self._library.simulation.findRoute
            ahead = tuple(find(here, destination, vehicle.getTypeID(shadow.id)).edges)
        if ahead and (*fixed[:-1], *ahead) != present:
            vehicle.setRoute(shadow.id, [*fixed[:-1], *ahead])

    def _type_of(self, slot: int) -> str:
        """Return a SUMO vehicle type with the footprint of a slot's vehicle, created on first use."""
        states, kind = self._states, VehicleKind(self._states.kind[slot])
        length, width = float(states.length[slot]), float(states.width[slot])
        name = f"shadow-{kind.name.lower()}-{length!r}x{width!r}"
        if name not in self._types:
            vehicletype = self._library.vehicletype
            vehicletype.copy("DEFAULT_VEHTYPE", name)
            vehicletype.setVehicleClass(name, kind.name.lower())
            vehicletype.setLength(name, length)
            vehicletype.setWidth(name, width)
            # With a speed deviation, the type would draw random numbers from SUMO's stream.
            vehicletype.setSpeedDeviation(name, 0.0)
            self._types.add(name)
        return name
