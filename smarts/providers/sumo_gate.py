"""The gate between SUMO and agents.

Vehicles come back to SUMO with no jump, no overlap, a way ahead, and no hard braking.
SUMO drives a vehicle on from the lane and the position at which it has the vehicle's shadow, and from nearly
its offset, with both ends on that lane. So the gate compares this pose with the vehicle's own, now and after
the next step. What they differ by fades (`sumo_fading`).

Agents get no vehicle that is on its way through a junction without priority: it goes in a gap that SUMO has
chosen. An agent that gets it where it can no longer stop could not choose another. Nor do they get a long
vehicle whose next turn is too tight for it: SUMO drives it along the lane as no such vehicle can; an agent's
would sweep the lanes beside.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from smarts.controllers.drivable_path import RESERVED
from smarts.dynamics.performance import Abilities
from smarts.geometry.binding import bind
from smarts.providers.gates import compare_with_chord, find_too_close
from smarts.providers.sumo_library import SumoLibrary
from smarts.providers.sumo_shadow import Shadow
from smarts.roads.lane_graph import LaneGraph
from smarts.types.transfers import Refusal
from smarts.types.vehicles import VehicleStates
from smarts.types.world import World

LEAST_TAIL = 0.1
"""Distance of the tail behind the lane's beginning that counts as inside the junction [m]."""
STEPS_BEFORE = 2
"""A vehicle whose front is inside a junction after so many steps is not taken any more."""
MOST_OFFSET = 0.15
"""Largest distance from the lane's centreline at which SUMO gets a vehicle's front [m]."""
MOST_TURN = 0.1
"""Largest angle between the vehicle's heading and SUMO's [rad]; `sumo_fading` lets it fade."""
MOST_SHIFT = 0.5
"""Largest distance between the vehicle's centre and the one that SUMO has for it [m]."""
MOST_BRAKING = 4.5
"""Deceleration that traffic ahead, a light or right of way may demand [m/s^2]."""
TURN_AHEAD = 100.0
"""Distance to a junction at which its turn counts [m]."""
MOST_SWING = 0.45
"""Largest distance by which a vehicle may have to leave its lane in a turn [m]."""
WINDOW = 4
"""Distance over which the bends of a turn are measured [m]."""
SMALL = 6.0
"""Vehicles with a smaller turning radius can make all turns [m]."""
MOST_LEAN = 0.15
"""To its lane of a vehicle that an agent gets [rad]. A slow one in a lane change leans more, and could
straighten only beside its lane; so does one whose tail is still in a turn."""
LOOK_AHEAD = 100.0
"""Distance that SUMO needs to change lanes where a vehicle's lane does not lead on [m]."""


class SumoGate:
    """Decides which vehicles of one simulation SUMO can take back, and which it gives to agents.

    Args:
        library: The copy of libsumo that runs the simulation.
        world: The world.
        row: The simulation.
    """

    def __init__(self, library: SumoLibrary, world: World, row: int) -> None:
        self._library, self._dt = library, world.dt
        self._vehicles = world.vehicles
        self._states: VehicleStates = world.vehicles.of(row)
        self._find_too_close = bind(find_too_close, world.vehicles)
        self._rows, self._slots = np.full(1, row, np.int32), np.zeros(1, np.int32)
        self._found = np.zeros(1, np.bool_)
        self._swings: dict[tuple[int, float], float] = {}
        self._radii: list[float] = (1.0 / np.maximum(Abilities.of_all().sharpest, 1e-9)).tolist()
        self._bound_to: LaneGraph | None = None

    def reset(self, roads: LaneGraph) -> None:
        """Begin an episode on a map."""
        self._swings.clear()
        if roads is self._bound_to:
            return
        self._roads = self._bound_to = roads
        lines = np.array(roads.point_xy), np.array(roads.point_s)
        self._compare = bind(compare_with_chord, self._vehicles, self._rows[0].item(), *lines)
        self._starts = roads.point_start.tolist()

    def refusal(self, slot: int, shadow: Shadow) -> Refusal:
        """Return why SUMO cannot take a vehicle now; if it can, write the way ahead into its shadow."""
        if not shadow.lane:
            return Refusal.OFF_LANES
        found = self._place(slot, shadow)
        if found != Refusal.NONE:
            return found
        self._slots[0] = slot
        self._find_too_close(self._rows, self._slots, 0.0, 0.0, self._found)
        if self._found[0]:
            return Refusal.TOO_CLOSE
        way = self._way(shadow)
        if not way:
            return Refusal.NO_WAY
        if not self._is_smooth(slot, shadow):
            return Refusal.SPEED
        shadow.way = way
        return Refusal.NONE

    def refusal_to_give(self, slot: int, name: str) -> Refusal:
        """Return why an agent cannot take over a vehicle that SUMO drives.

        That is WITHOUT_PRIORITY from where the vehicle can no longer stop before a junction that it enters
        without priority, or against the light, until its front and its centre are out of the junction;
        TIGHT_TURN from `TURN_AHEAD` before a turn that is too tight for it, until it is through; SIDEWAYS
        where the vehicle leans to its lane. The junction that the vehicle is in counts, and those ahead.
        """
        name_of_lane, roads, states = self._library.vehicle.getLaneID(name), self._roads, self._states
        if not name_of_lane:
            return Refusal.NONE
        radius, lane = self._radii[states.kind[slot]], roads.lane_of_id(name_of_lane)
        for number in {lane, int(states.lane[slot])}:
            if number < 0 or not roads.is_internal[number]:
                continue
            if self._is_tight(number, radius):
                return Refusal.TIGHT_TURN
            if not self._has_priority(number):
                return Refusal.WITHOUT_PRIORITY
        position = self._library.vehicle.getLanePosition(name)
        if not roads.is_internal[lane] and self._lean(slot, lane, position) > MOST_LEAN:
            return Refusal.SIDEWAYS
        return self._refusal_ahead(name, self._length_onward(lane) - position, states.speed[slot], radius)

    def _refusal_ahead(self, name: str, left: float, speed: float, radius: float) -> Refusal:
        """Return why an agent cannot take over a vehicle because of junctions ahead.

        Args:
            name: SUMO's name of the vehicle.
            left: Distance to the end of the road that it is on, or comes to from its junction [m].
            speed: Its speed [m/s].
            radius: Radius of its tightest turn [m].
        """
        needed = self._dt * speed + 0.5 * speed * speed / MOST_BRAKING
        reach, found = (needed if radius < SMALL else max(needed, TURN_AHEAD)), Refusal.NONE
        if left >= reach:
            return found
        for lane, has_priority, _, _, via, _, _, length in self._library.vehicle.getNextLinks(name):
            if left >= reach:
                break
            inside = self._roads.lane_of_id(via) if via else -1
            if left < TURN_AHEAD and self._is_tight(inside, radius):
                return Refusal.TIGHT_TURN
            if left < needed and not has_priority:
                found = Refusal.WITHOUT_PRIORITY
            left += self._length_onward(inside) if via else length + self._library.lane.getLength(lane)
        return found

    def _length_onward(self, lane: int) -> float:
        """Return the length of a lane, or from one inside a junction to the end of the next road [m]."""
        return sum(float(self._roads.driven_length[each]) for each in self._roads.way_across(lane))

    def _lean(self, slot: int, lane: int, position: float) -> float:
        """Return the angle of a vehicle to a lane on which its front is at SUMO's `position` [m] [rad]."""
        roads = self._roads
        front = position * float(roads.length[lane] / max(roads.driven_length[lane], 1e-9))
        return self._compare(slot, self._starts[lane], self._starts[lane + 1], front, 0.0, 0.0)[0]

    def _is_tight(self, lane: int, radius: float) -> bool:
        """Return whether a vehicle with some turning radius [m] leaves a lane inside a junction by too much.

        Of two arcs that touch the same two straight lines, the wider one is nearer to their corner's inside.
        """
        if radius < SMALL or lane < 0:
            return False
        key = lane, radius
        if key not in self._swings:
            self._swings[key] = self._swing(lane, radius / RESERVED)
        return self._swings[key] > MOST_SWING

    def _swing(self, lane: int, radius: float) -> float:
        """Return by how much a vehicle leaves its way from a lane through its junction [m].

        What counts of the way is the part that is tighter than the vehicle's turning radius [m].
        """
        roads, headings, at, length = self._roads, [], [], 0.0
        while lane >= 0 and roads.is_internal[lane]:
            points = slice(int(roads.point_start[lane]), int(roads.point_start[lane + 1]))
            headings.append(roads.point_heading[points])
            at.append(length + roads.point_s[points])
            length += float(roads.length[lane])
            following = roads.successors(lane)
            if not len(following):
                break
            lane = int(following[0])
        if not at:
            return 0.0
        # Before and behind the junction the way is straight.
        s = np.arange(-WINDOW, length + WINDOW + 1.0)
        turned = np.asarray(np.unwrap(np.concatenate(headings)), np.float64)
        heading = np.interp(s, np.concatenate(at), turned)
        bends = np.abs(heading[WINDOW:] - heading[:-WINDOW]) / WINDOW
        bends = bends[bends * radius > 1.0]
        if not len(bends):
            return 0.0
        turn = min(0.5 * float(bends.sum()), 1.25)
        return (radius - 1.0 / float(bends.mean())) * (1.0 / math.cos(turn) - 1.0)

    def _has_priority(self, lane: int) -> bool:
        """Return whether vehicles that now enter a lane inside a junction have priority."""
        roads = self._roads
        for before in roads.predecessors(lane).tolist():
            if roads.is_internal[before]:
                if not self._has_priority(before):
                    return False
                continue
            for link in self._library.lane.getLinks(roads.lane_ids[before]):
                if link[4] == roads.lane_ids[lane] and not link[1]:
                    return False
        return True

    def _place(self, slot: int, shadow: Shadow) -> Refusal:
        """Return what is wrong with a vehicle's pose on SUMO's lane."""
        states, roads = self._states, self._roads
        lane, length = roads.lane_of_id(shadow.lane), float(states.length[slot])
        front = shadow.position * float(roads.length[lane] / max(roads.driven_length[lane], 1e-9))
        ahead = front + STEPS_BEFORE * self._dt * float(states.speed[slot])
        if roads.is_internal[lane] or front - length < -LEAST_TAIL or ahead > roads.length[lane]:
            return Refusal.IN_JUNCTION
        if shadow.shift or shadow.reinsertion or states.lane[slot] not in (lane, -1):
            return Refusal.OTHER_LANE
        shadow.back = min(max(shadow.offset, -MOST_OFFSET), MOST_OFFSET)
        begin, end = self._starts[lane], self._starts[lane + 1]
        turn, aside = self._compare(slot, begin, end, front, shadow.back, self._dt)
        if turn > MOST_TURN:
            return Refusal.HEADING
        return Refusal.OFFSET if aside > MOST_SHIFT else Refusal.NONE

    def _is_smooth(self, slot: int, shadow: Shadow) -> bool:
        """Return whether SUMO's driver would not brake the vehicle hard."""
        vehicle, name, speed = self._library.vehicle, shadow.id, float(self._states.speed[slot])
        least = speed - MOST_BRAKING * self._dt
        if speed < -0.1:
            return False
        if least <= 0.0:
            return True
        reach = 10.0 + 0.5 * speed * speed / MOST_BRAKING + 2.0 * speed
        leader = vehicle.getLeader(name, reach)
        if leader and leader[0]:
            other, gap = leader
            ahead = vehicle.getSpeed(other), vehicle.getDecel(other)
            if vehicle.getFollowSpeed(name, speed, gap, *ahead, other) < least:
                return False
        return all(vehicle.getStopSpeed(name, speed, gap) >= least for gap in self._stops(shadow, reach))

    def _stops(self, shadow: Shadow, reach: float) -> Sequence[float]:
        """Return the distances at which the vehicle may have to stop, for a light or for right of way [m]."""
        vehicle, stops = self._library.vehicle, []
        for _, _, distance, state in vehicle.getNextTLS(shadow.id):
            if state in "rRu" and distance < reach:
                stops.append(distance)
        left = self._library.lane.getLength(shadow.lane) - shadow.position
        if left < reach:
            for lane, has_priority, is_open, _, _, state, _, length in vehicle.getNextLinks(shadow.id):
                if not has_priority and (not is_open or state == "s") and left < reach:
                    stops.append(left)
                left += length + self._library.lane.getLength(lane)
        return stops

    def _way(self, shadow: Shadow) -> tuple[str, ...]:
        """Return the edges on which a vehicle is to continue from its lane, () if it cannot.

        That is its route; if this does not lead on from the lane, a fastest way to its destination that does;
        if there is none, whatever the lane leads into.
        """
        edge, onward = shadow.lane.rpartition("_")[0], self._library.edges_onward(shadow.lane)
        planned = shadow.route[shadow.route.index(edge) :] if edge in shadow.route else ()
        left = self._library.lane.getLength(shadow.lane) - shadow.position
        if planned and (len(planned) == 1 or planned[1] in onward or left > LOOK_AHEAD):
            return planned
        if shadow.route:
            find, kind = self._library.simulation.findRoute, self._library.vehicle.getTypeID(shadow.id)
            for following in onward:
                found = tuple(find(following, shadow.route[-1], kind).edges)
                if found and edge not in found[:1]:
                    return (edge, *found)
        if onward:
            return (edge, onward[0])
        return () if planned else (edge,)
