"""Faults in collisions, each rule on an episode that can be worked out by hand."""

import dataclasses

import numpy as np
import pytest

from benchmark.metrics.at_fault_collision_rate import Fault, fault_of
from benchmark.metrics.registry import METRICS
from smarts.roads.lane_graph import Yields
from smarts.types.events import Outcome
from tests.measuring import CROSS, ROAD, SOUTH_NORTH, WEST_EAST, totals, value
from tests.recordings import LENGTH, Drive, across, at_speed, at_speeds, episode_of

FRONT, LEFT, REAR, RIGHT = range(4)
STEPS = 40


def struck(folder, s, side=REAR, others=None, leader=None, **drive):
    """Return an episode whose agent is struck, 4 s after the beginning, from behind in the rightmost lane."""
    s = np.asarray(s, float)
    agent = Drive(
        ["road_0"], s, agent="a", outcome=Outcome.COLLISION, partner=1, route=["road"],
        columns={"side": side}, **{"acceleration": 0.0, **drive},
    )  # fmt: skip
    behind = Drive(
        ["road_0"], s[-1] - LENGTH - at_speed(10.0, len(s) - 1)[::-1], route=["road"], **(others or {})
    )
    ahead = [] if leader is None else [Drive(["road_0"], s + LENGTH + leader, route=["road"])]
    return episode_of(folder, ROAD, agent, behind, *ahead)


def at_instants(instants, value):
    """Return an acceleration [m/s^2] of 0 but for some instants."""
    return np.where(np.isin(np.arange(STEPS + 1), instants), value, 0.0)


def changing(settled):
    """Return offsets of a change from the second lane into the first, wholly in it from an instant on [m]."""
    # Lanes are 3.2 m wide, the vehicle 1.8 m: it is within its lane up to 0.7 m beside the middle.
    way = np.linspace(3.2, 0.7, 11)
    return np.concatenate((np.full(settled - 10, 3.2), way, np.full(STEPS - settled, 0.0)))


MOVING = at_speed(5.0, STEPS, 100.0)


@pytest.mark.parametrize(
    ("case", "fault"),
    [
        (dict(s=at_speed(0.0, STEPS, 100.0)), Fault.STOOD),
        (dict(s=at_speed(0.0, STEPS, 100.0), side=FRONT, t=0.9), Fault.STOOD),
        # It stood for 0.9 s.
        (dict(s=at_speeds([5.0] * 30 + [0.0] * 10, 100.0)), Fault.STRUCK_FROM_BEHIND),
        (dict(s=MOVING), Fault.STRUCK_FROM_BEHIND),
        (dict(s=MOVING, t=changing(21)), Fault.CUT_IN),
        (dict(s=MOVING, t=changing(20)), Fault.STRUCK_FROM_BEHIND),
        (dict(s=MOVING, acceleration=at_instants([25], -4.1)), Fault.HARD_BRAKE),
        (dict(s=MOVING, acceleration=at_instants([25], -3.9)), Fault.STRUCK_FROM_BEHIND),
        # The impact itself is not its brake.
        (dict(s=MOVING, acceleration=at_instants([STEPS], -9.0)), Fault.STRUCK_FROM_BEHIND),
        # At 5 m/s a leader counts within 10 + 25 / 8 = 13.1 m.
        (dict(s=MOVING, acceleration=at_instants([25], -4.1), leader=13.0), Fault.STRUCK_FROM_BEHIND),
        (dict(s=MOVING, side=FRONT), Fault.FRONT),
        # Half of the width is 0.9 m, half of the lane's 1.6 m.
        (dict(s=MOVING, t=0.71), Fault.ON_A_LINE),
        (dict(s=MOVING, t=0.69), Fault.STRUCK_FROM_BEHIND),
        # A vehicle in the lane beside that strikes its rear is not behind in its lane.
        (dict(s=MOVING, others=dict(t=1.7)), Fault.UNCLASSIFIED),
    ],
)
def test_on_a_road(tmp_path, case, fault):
    episode = struck(tmp_path, **case)
    assert fault_of(episode, 0) == fault
    is_at_fault = fault not in (Fault.STOOD, Fault.STRUCK_FROM_BEHIND)
    assert value("at_fault_collision_rate", episode) == is_at_fault
    assert value("collision_rate", episode) == 1.0


@pytest.mark.parametrize(
    ("own_way", "side", "fault"),
    [
        (Yields.THIS, RIGHT, Fault.NO_PRIORITY),
        (Yields.BOTH, REAR, Fault.NO_PRIORITY),
        (Yields.OTHER, RIGHT, Fault.SIDE),
        (Yields.NEITHER, REAR, Fault.UNCLASSIFIED),
        (Yields.THIS, FRONT, Fault.FRONT),
    ],
)
def test_at_a_crossing(tmp_path, own_way, side, fault):
    lanes = [across(CROSS, *way)[1] for way in (WEST_EAST, SOUTH_NORTH)]
    is_own = CROSS.conflict_lane == CROSS.lane_of_id(lanes[1])
    graph = dataclasses.replace(CROSS, conflict_yields=np.where(is_own, int(own_way), 0).astype(np.int8))
    both = dict(agent="a", outcome=Outcome.COLLISION, partner=1, columns={"side": side}, route=WEST_EAST)
    # They meet after 91.6 and 88.4 m.
    agent = Drive(across(graph, *WEST_EAST), at_speed(8.0, STEPS, 91.6 - 32.0), **both)
    other = Drive(across(graph, *SOUTH_NORTH), at_speed(8.0, STEPS, 88.4 - 32.0 - 1.0), route=SOUTH_NORTH)
    assert fault_of(episode_of(tmp_path, graph, agent, other), 0) == fault


def test_what_no_rule_classifies_is_counted(tmp_path):
    odd, even = (struck(tmp_path / str(t), MOVING, others=dict(t=t)) for t in (1.7, 0.0))
    metric = METRICS["at_fault_collision_rate"]
    assert value(metric.name, odd, even) == 0.5
    assert metric.terms(totals(odd, even)) == {"unclassified": 1.0}
