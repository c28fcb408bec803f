"""Car following against gaps and speeds computed by hand."""

import math

import pytest

from smarts.dynamics import car_following as follow

DT = 0.1


def test_an_euler_vehicle_brakes_in_whole_steps():
    # From 10 m/s by 0.45 m/s a step, 22 steps: 0.1 * (22 * 10 - 0.45 * 22 * 23 / 2) = 10.615 m.
    assert follow.brake_gap(10.0, 4.5, 0.0, DT, False) == pytest.approx(10.615)
    assert follow.brake_gap(10.0, 4.5, 1.0, DT, False) == pytest.approx(20.615)


def test_a_ballistic_vehicle_brakes_evenly():
    assert follow.brake_gap(10.0, 4.5, 1.0, DT, True) == pytest.approx(10.0 + 100.0 / 9.0)
    assert follow.brake_gap(0.0, 4.5, 1.0, DT, True) == 0.0


@pytest.mark.parametrize("ballistic", [False, True])
@pytest.mark.parametrize("speed", [3.0, 8.0, 13.9])
def test_krauss_keeps_speed_at_the_time_headway(ballistic, speed):
    # Both brake equally, so the gap is what is driven until the follower reacts.
    safe = follow.krauss_follow_speed(1.2 * speed, speed, speed, 4.5, 4.5, 4.5, 1.2, DT, ballistic)
    assert safe == pytest.approx(speed, abs=0.03)


@pytest.mark.parametrize("ballistic", [False, True])
def test_krauss_stops_before_a_line(ballistic):
    speed, gap = 12.0, 30.0
    for _ in range(200):
        then = max(follow.krauss_stop_speed(gap, speed, 4.5, 4.5, DT, DT, ballistic), speed - 0.45)
        way = 0.5 * (speed + then) * DT if ballistic else then * DT
        if then < 0.0:
            way = 0.5 * speed * speed / (speed - then) * DT
        speed, gap = max(min(then, 12.0), 0.0), gap - way
        assert gap > -1e-3
    assert speed < 0.01
    assert gap < 0.2


def test_an_emergency_brakes_as_hard_as_a_vehicle_can():
    # 10 m/s, 4 m to a vehicle that stands: 12.5 m/s^2 are needed, 9 is the most.
    hard = follow.krauss_follow_speed(4.0, 10.0, 0.0, 4.5, 9.0, 4.5, 1.0, DT, True)
    assert hard == pytest.approx(10.0 - 9.0 * DT)


def test_a_driver_slows_down_for_a_lower_limit():
    for ballistic in (False, True):
        speed, left = 13.9, 60.0
        while left > 0.0:
            then = min(follow.free_speed(speed, 8.0, left, 4.5, DT, DT, ballistic), 13.9)
            assert speed - then < 0.46
            left -= (0.5 * (speed + then) if ballistic else then) * DT
            speed = then
        assert speed == pytest.approx(8.0, abs=0.2)


def test_idm_neither_brakes_nor_speeds_up_at_its_equilibrium_gap():
    gap = (2.0 + 1.2 * 10.0) / math.sqrt(1.0 - (10.0 / 15.0) ** 4)
    assert follow.idm_acceleration(gap, 10.0, 10.0, 15.0, 2.0, 3.0, 1.2, 2.0) == pytest.approx(0.0, abs=1e-9)
    assert follow.idm_speed(gap, 10.0, 10.0, 15.0, 2.0, 3.0, 1.2, 2.0, DT) == pytest.approx(10.0)


def test_idm_speeds_up_on_a_free_road():
    assert follow.idm_acceleration(1e9, 0.0, 0.0, 15.0, 2.0, 3.0, 1.2, 2.0) == pytest.approx(2.0)
    assert follow.idm_acceleration(1e9, 15.0, 0.0, 15.0, 2.0, 3.0, 1.2, 2.0) == pytest.approx(0.0, abs=1e-9)


def test_arrival_times():
    # 2 s from 5 to 10 m/s by 2.5 m/s^2 are 15 m, then 2 s at 10 m/s.
    assert follow.soonest_arrival(35.0, 5.0, 10.0, 2.5, 4.5) == pytest.approx(4.0)
    assert follow.speed_after(15.0, 5.0, 2.5, 99.0) == pytest.approx(10.0)


def test_a_vehicle_that_can_still_stop_arrives_much_later():
    # 40 m in 4 s; once this driver has arrived after 1 s, 30 m are left, and 10 m/s need 25 m by 2 m/s^2.
    assert follow.delayed_arrival(1.0, 4.0 - DT, 40.0, 2.0, DT) == (pytest.approx(33.9), 0.0)
