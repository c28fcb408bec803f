"""The agent `cut-in-v0`: when it cuts in, by hand, and how closely, in traffic."""

import numpy as np
import pytest

from benchmark.running.zoo_contract import ZooDrive
from smarts.observations.surroundings import Lane, Own
from smarts.zoo import make_spec
from smarts.zoo.agents.cut_in import LONGEST, CutIn

from .batches import batch_of, seen_of

GAP = 4.0
TRAFFIC = "random_social_vehicles"
LEFT, RIGHT, NONE = 1, -1, 0


def beside_another(behind=1.0, ahead=np.inf, leader=np.inf, speed=10.0, side=LEFT):
    """Return what a vehicle sees that is `behind` [m] past another one at 10 m/s in the lane to a side."""
    seen = seen_of(speed=speed, allowed=14.0)
    lane = seen.lanes[0, 1 if side == LEFT else 2]
    lane[Lane.OPEN] = 1.0
    lane[[Lane.BEHIND, Lane.BEHIND_SPEED, Lane.BEHIND_DESIRED]] = behind, 10.0, 14.0
    lane[[Lane.AHEAD, Lane.AHEAD_SPEED]] = ahead, 10.0
    seen.lanes[0, 0, [Lane.AHEAD, Lane.AHEAD_SPEED]] = leader, 10.0
    return seen


@pytest.mark.parametrize("side", [LEFT, RIGHT])
@pytest.mark.parametrize(
    ("place", "cuts_in"),
    [
        ({}, True),
        ({"behind": -0.1}, False),
        ({"behind": LONGEST + 0.1}, False),
        ({"speed": 8.9}, False),
        # It draws 4 m ahead of the other vehicle, to 5 m; then 2 m have to be left in front.
        ({"ahead": 6.1}, True),
        ({"ahead": 5.9}, False),
        # Half of that in its own lane, and 1 m.
        ({"leader": 3.1}, True),
        ({"leader": 2.9}, False),
    ],
)
def test_it_cuts_in_where_there_is_room(place, cuts_in, side):
    seen = beside_another(**place, side=side)
    _, change = CutIn(gap=GAP).decide(batch_of(seen), seen)
    assert change.tolist() == [side if cuts_in else NONE]


@pytest.mark.parametrize(("gap", "faster", "time"), [(GAP, 4.0, 3.0), (12.0, 3.0, 4.0), (12.0, 1.0, 5.0)])
def test_the_pose_is_in_front_of_where_the_other_vehicle_will_be(gap, faster, time):
    """It is 1 m past it, and gets as far ahead as its gap and 1 m while the other one drives on at 10 m/s."""
    seen = beside_another()
    goal = CutIn(gap=gap, faster=faster).goal(batch_of(seen), seen, np.array([LEFT]))
    assert [each.tolist() for each in goal] == [[time], [10.0 * time + gap], [10.0]]


def test_it_cuts_in_once():
    agent, seen = CutIn(gap=GAP), beside_another()
    agent.begun(batch_of(seen), seen, np.array([NONE]))
    assert agent.decide(batch_of(seen, 1, is_first=False), seen)[1].tolist() == [LEFT]
    agent.begun(batch_of(seen, 1, is_first=False), seen, np.array([LEFT]))
    assert agent.decide(batch_of(seen, 2, is_first=False), seen)[1].tolist() == [NONE]


def test_the_route_comes_first():
    agent, seen = CutIn(gap=GAP), beside_another()
    seen.own[0, [Own.DEMANDED, Own.REMAINING]] = RIGHT, 50.0
    seen.lanes[0, 2, Lane.OPEN] = 1.0
    assert agent.decide(batch_of(seen), seen)[1].tolist() == [RIGHT]
    agent.begun(batch_of(seen), seen, np.array([RIGHT]))
    seen.own[0, Own.DEMANDED] = NONE
    assert agent.decide(batch_of(seen, 1, is_first=False), seen)[1].tolist() == [LEFT]


class Counting(CutIn):
    """Counts the cut-ins that have begun."""

    begins = 0

    def begun(self, batch, seen, change):
        self.begins += int(((change != 0) & self._is_open(batch, seen)).sum())
        super().begun(batch, seen, change)


def test_vehicles_cut_in_unharmed_in_traffic():
    agent, spec = Counting(gap=GAP), make_spec("cut-in-v0")
    outcomes = set()
    with ZooDrive(spec, agent, "loop", egos=4, seed=7, traffic=TRAFFIC) as drive:
        for _ in range(4):
            drive.reset()
            for _ in range(300):
                drive.step()
                if not drive.active:
                    break
            outcomes |= {*drive.outcomes.values()}
    assert agent.begins >= 3
    assert not {"collision", "off_road"} & outcomes
