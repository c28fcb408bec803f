"""Car following against gaps and speeds computed by hand."""

import math

import numpy as np
import pytest

from smarts.dynamics import car_following as follow

DT = 0.1


def driver(ballistic=False, *, hardest=4.5, tau=1.0, reaction=DT):
    """Return a driver that brakes by 4.5 m/s^2."""
    return follow.Driver(2.6, 4.5, hardest, tau, 0.5, 2.5, 55.0, reaction, DT, False, ballistic)


IDM = follow.Driver(2.0, 3.0, 9.0, 1.2, 0.0, 2.0, 55.0, DT, DT, is_idm=True)


def test_an_euler_vehicle_brakes_in_whole_steps():
    # From 10 m/s by 0.45 m/s a step, 22 steps: 0.1 * (22 * 10 - 0.45 * 22 * 23 / 2) = 10.615 m.
    assert follow.brake_gap(driver(), 10.0, 4.5, 0.0) == pytest.approx(10.615)
    assert follow.brake_gap(driver(), 10.0, 4.5, 1.0) == pytest.approx(20.615)


def test_a_ballistic_vehicle_brakes_evenly():
    assert follow.brake_gap(driver(True), 10.0, 4.5, 1.0) == pytest.approx(10.0 + 100.0 / 9.0)
    assert follow.brake_gap(driver(True), 0.0, 4.5, 1.0) == 0.0


@pytest.mark.parametrize("ballistic", [False, True])
@pytest.mark.parametrize("speed", [3.0, 8.0, 13.9])
def test_krauss_keeps_speed_at_the_time_headway(ballistic, speed):
    # Both brake equally, so the gap is what is driven until the follower reacts.
    safe = follow.follow_speed(driver(ballistic, tau=1.2), 1.2 * speed, speed, speed, 4.5, 99.0)
    assert safe == pytest.approx(speed, abs=0.03)


@pytest.mark.parametrize("ballistic", [False, True])
def test_krauss_stops_before_a_line(ballistic):
    speed, gap = 12.0, 30.0
    for _ in range(200):
        then = max(follow.stop_speed(driver(ballistic), gap, speed, 4.5, 99.0), speed - 0.45)
        way = 0.5 * (speed + then) * DT if ballistic else then * DT
        if then < 0.0:
            way = 0.5 * speed * speed / (speed - then) * DT
        speed, gap = max(min(then, 12.0), 0.0), gap - way
        assert gap > -1e-3
    assert speed < 0.01
    assert gap < 0.2


def test_an_emergency_brakes_as_hard_as_a_vehicle_can():
    # 10 m/s, 4 m to a vehicle that stands: 12.5 m/s^2 are needed, 9 is the most.
    hard = follow.follow_speed(driver(True, hardest=9.0), 4.0, 10.0, 0.0, 4.5, 99.0)
    assert hard == pytest.approx(10.0 - 9.0 * DT)


def test_krauss_needs_the_way_of_its_reaction_more_than_its_leader():
    # 10 m/s against 8 m/s by 4.5 m/s^2 after 1 s: 10 + 100 / 9 - 64 / 9.
    assert follow.secure_gap(driver(True), 10.0, 8.0, 4.5) == pytest.approx(14.0)
    # 10 m behind a standing vehicle: v + v^2 / 9 = 10.
    assert follow.insertion_stop_speed(driver(True), 10.0 + follow.SLACK) == pytest.approx(6.0)


def test_a_braking_vehicle_stands_in_the_end():
    # 2 s from 10 m/s by 4 m/s^2 are 12 m; it stands after 2.5 s and 12.5 m.
    ways = follow.braked_way.py_func(10.0, 4.0, np.array([0.0, 2.0, 9.0]))
    assert ways == pytest.approx([0.0, 12.0, 12.5])


def test_a_driver_slows_down_for_a_lower_limit():
    for ballistic in (False, True):
        speed, left = 13.9, 60.0
        while left > 0.0:
            then = min(follow.free_speed(driver(ballistic), speed, 8.0, left, DT), 13.9)
            assert speed - then < 0.46
            left -= (0.5 * (speed + then) if ballistic else then) * DT
            speed = then
        assert speed == pytest.approx(8.0, abs=0.2)


def test_idm_neither_brakes_nor_speeds_up_at_its_equilibrium_gap():
    gap = (2.0 + 1.2 * 10.0) / math.sqrt(1.0 - (10.0 / 15.0) ** 4)
    slower = follow.idm_interaction(2.0, 3.0, 1.2, 2.0, gap, 10.0, 10.0)
    assert slower == pytest.approx(follow.idm_free(2.0, 10.0, 15.0))
    assert follow.follow_speed(IDM, gap - 2.0, 10.0, 10.0, 4.5, 15.0) == pytest.approx(10.0)


def test_idm_speeds_up_on_a_free_road():
    assert follow.idm_free(2.0, 0.0, 15.0) == pytest.approx(2.0)
    assert follow.idm_free(2.0, 15.0, 15.0) == pytest.approx(0.0, abs=1e-9)
    # 16 m wanted of 32: a quarter of the acceleration is lost.
    assert follow.idm_interaction(2.0, 3.0, 1.4, 2.0, 32.0, 10.0, 10.0) == pytest.approx(0.5)


def test_arrival_times():
    # 2 s from 5 to 10 m/s by 2.5 m/s^2 are 15 m, then 2 s at 10 m/s.
    assert follow.soonest_arrival(driver()._replace(accel=2.5), 35.0, 5.0, 10.0) == pytest.approx(4.0)
    assert follow.speed_after(15.0, 5.0, 2.5, 99.0) == pytest.approx(10.0)


def test_a_vehicle_that_can_still_stop_arrives_much_later():
    # 40 m in 4 s; once this driver has arrived after 1 s, 30 m are left, and 10 m/s need 25 m by 2 m/s^2.
    assert follow.delayed_arrival(1.0, 4.0 - DT, 40.0, 2.0, DT) == (pytest.approx(33.9), 0.0)
