"""Slow vehicles that lean to their lane: how far, and that traffic does not drive through their tails."""

import math
from itertools import combinations

import numpy as np
import pytest

from smarts.geometry.boxes import box_gaps
from smarts.providers.sumo_lean import LaneLines, find_slow, most_lean, straighten
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.build import build_scenario
from smarts.types.vehicles import VehicleStates


def overlapping(states: VehicleStates) -> set[tuple[int, int]]:
    """Return the pairs of slots whose footprints share more than 2 cm."""
    slots = np.flatnonzero(states.alive).tolist()
    boxes = {
        slot: (
            (*states.position[slot].tolist(), float(states.heading[slot])),
            states.length[slot] / 2,
            states.width[slot] / 2,
        )
        for slot in slots
    }
    near = (
        pair
        for pair in combinations(slots, 2)
        if math.dist(states.position[pair[0]], states.position[pair[1]]) < 8.0
    )
    return {(a, b) for a, b in near if max(box_gaps(*boxes[a], *boxes[b])) < -0.02}


@pytest.mark.parametrize(
    ("length", "width", "room", "lean"),
    [
        (4.0, 0.0, 2.0, math.radians(30.0)),
        (3.0, 8.0, 4.0, 0.0),  # Its front takes all the room.
        (3.0, 8.0, 5.0, math.radians(90.0) - math.atan2(4.0, 3.0)),
        (3.0, 2.0, 100.0, math.radians(90.0) - math.atan2(1.0, 3.0)),
    ],
)
def test_a_tail_stays_within_its_room(length, width, room, lean):
    assert most_lean(length, width, room) == pytest.approx(lean)


@pytest.mark.parametrize(("front", "is_turned"), [(15.0, True), (35.0, True), (4.0, False)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_tail_is_turned_to_where_it_leaves_the_other_lane(front, is_turned, side):
    """The lane goes 20 m along x and then turns 30 degrees to the left; its vehicles stand in its middle."""
    bend = math.radians(30.0)
    xy = np.array([[0.0, 0.0], [20.0, 0.0], [20.0 + 30.0 * math.cos(bend), 30.0 * math.sin(bend)]])
    of_lane = np.array([1.6 * 2.0]), np.array([0], np.int32), np.array([0], np.int32), np.array([False])
    lines = LaneLines(xy, np.array([0.0, 20.0, 50.0]), np.array([0, 3], np.int32), *of_lane)
    heading = bend * (front > 20.0)
    place = xy[0] + [front, 0.0] if front < 20.0 else xy[1] + (front - 20.0) * np.array([math.cos(bend), 0.5])
    states, turned = VehicleStates.allocate(1), np.zeros(1)
    states.length[:], states.width[:] = 5.0, 2.0
    lean = side * math.radians(40.0)
    values = np.array([*place, 90.0 - math.degrees(heading + lean), 0.0])
    straighten(states, turned, lines, np.array([0]), values, np.array([0]), np.array([0], np.int32))
    most = most_lean(5.0, 2.0, 1.6 + 0.4) if is_turned else abs(lean)
    assert values[2] == pytest.approx(90.0 - math.degrees(heading + side * most), abs=0.1)
    assert turned[0] == pytest.approx(math.degrees(side * (abs(lean) - most)), abs=0.1)


def test_traffic_does_not_drive_through_a_vehicle_that_has_changed_lanes_while_it_stood():
    # From 70 to 94 s, seven vehicles pass one that stands in the merging section, after a lane change on the
    # spot; SUMO shows it turned by 30 degrees.
    found, turns = set(), []
    with traffic_run(build_scenario("double_merge"), "random_social_vehicles", seed=7) as run:
        for states in run.steps(seconds=94.0):
            if run.world.step[0] > 650:
                found |= overlapping(states)
                change = states.heading - run.world.before.heading[0]
                turns.append(np.abs(change[states.alive & run.world.before.alive[0]]).max())
    assert not found
    # It straightens by and by, no faster than SUMO turns a vehicle that begins to change lanes.
    assert max(turns) < 0.2


@pytest.mark.parametrize("leaves", [False, True])
def test_a_vehicle_that_comes_back_from_an_agent_is_not_turned_as_before(leaves):
    states, is_new = VehicleStates.allocate(2), np.zeros(2, np.bool_)
    states.length[:] = 5.0
    fronts, turned = np.zeros((2, 2)), np.array([20.0, 0.0])
    values = np.array([0.0, 0.0, 90.0, 0.0, 0.0, 0.0])
    rows, other = np.array([0], np.intp), np.array([1], np.intp)
    if leaves:
        find_slow(states, is_new, fronts, turned, other, values.copy())
    slow = find_slow(states, is_new, fronts, turned, rows, values)
    assert values[2] == (90.0 if leaves else 110.0)
    assert len(slow) == leaves
