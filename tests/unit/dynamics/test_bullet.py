"""Bullet against mechanics: free flight, collisions, cars on their side."""

import subprocess
import sys

import numpy as np
import pytest

from smarts.dynamics import Box, Fleet, layout
from smarts.dynamics.bullet import BulletWorld
from tests.fleets import put_body

DT = 0.01


def rotation_matrix(q):
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def tumble(inertia, rates, seconds, h=1e-3):
    """Torque-free rotation by fourth-order Runge-Kutta: quaternion and angular velocity in the world."""

    def rate(state):
        (x, y, z, w), (p, q, r) = state[:4], state[4:]
        turn = 0.5 * np.array(
            [w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p, -x * p - y * q - z * r]
        )
        return np.concatenate([turn, np.cross(inertia * state[4:], state[4:]) / inertia])

    state = np.array([0.0, 0.0, 0.0, 1.0, *rates])
    for _ in range(round(seconds / h)):
        a = rate(state)
        b = rate(state + 0.5 * h * a)
        c = rate(state + 0.5 * h * b)
        state = state + h / 6.0 * (a + 2.0 * b + 2.0 * c + rate(state + h * c))
    return state[:4], rotation_matrix(state[:4]) @ state[4:]


def fly(start, seconds, dt):
    bodies = np.zeros((1, layout.BODY_SIZE))
    bodies[0] = start
    world = BulletWorld(bodies, dt)
    world.add(0, layout.pack("passenger", "pacejka"))
    for _ in range(round(seconds / dt)):
        world.substep([[bodies[0, 7:10].tolist(), bodies[0, 10:13].tolist()]])
    world.close()
    return bodies[0]


def test_free_flight_against_an_independent_integrator():
    inertia = np.array(layout.pack("passenger", "pacejka")["inertia"])
    start = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0, 3.0, -2.0, 1.0, 0.4, 0.3, 0.8])
    quaternion, spin = tumble(inertia, start[10:], 2.0)
    errors = []
    for dt in (0.01, 0.005):
        end = fly(start, 2.0, dt)
        assert end[0:3] == pytest.approx([6.0, -4.0, 7.0])
        assert end[7:10] == pytest.approx([3.0, -2.0, 1.0])
        errors.append(np.abs(end[3:7] - quaternion).max() + np.abs(end[10:13] - spin).max())
        momentum = rotation_matrix(end[3:7]) @ (inertia * (rotation_matrix(end[3:7]).T @ end[10:13]))
        assert momentum == pytest.approx(inertia * start[10:], abs=8.0 * dt / 0.01)
    assert errors[0] < 0.01
    assert errors[1] < 0.6 * errors[0], "first order in the sub-step"


def test_rear_end_collision_keeps_momentum():
    with Fleet(1, 2, step=DT, substeps=1) as fleet:
        fleet.road.friction[:] = 0.01
        fleet.spawn(0, "passenger", (0.0, 0.0), 0.0, 12.0)
        fleet.spawn(1, "passenger", (6.0, 0.0), 0.0, 4.0)
        for _ in range(60):
            fleet.step(np.zeros((2, 3)))
        first, second = fleet.motion.velocity[:, 0]
        assert first + second == pytest.approx(16.0, rel=0.01)
        # Restitution 0.1 of both bodies: the product at most 0.1 of the closing speed remains.
        assert 0.0 <= second - first < 1.0
        assert fleet.motion.position[1, 0] - fleet.motion.position[0, 0] > 4.508 - 0.05


def test_a_box_pushes_and_is_not_pushed():
    with Fleet(1, 1) as fleet:
        fleet.spawn(0, "passenger", (0.0, 0.0), 0.0, 0.0)
        front, ahead = -2.0, []
        for _ in range(30):
            fleet.place_boxes(0, {3: Box((0.0, front - 6.0, 1.5), np.pi / 2, 10.0, 12.0, 2.5, 3.0)})
            fleet.step(np.zeros((1, 3)))
            front += 1.0
            ahead.append(fleet.motion.position[0, 1] - front)
        # Pushed sideways by a bus at 10 m/s, which hits it again whenever the tyres have slowed it.
        assert 0.5 * 1.61 - 0.05 < min(ahead[5:]) < max(ahead[5:]) < 0.5 * 1.61 + 1.0


@pytest.mark.parametrize("speed", [5.0, 30.0])
def test_fast_cars_do_not_tunnel_through_a_wall(speed):
    with Fleet(1, 1) as fleet:
        fleet.spawn(0, "passenger", (0.0, 0.3), 0.0, speed)
        fleet.place_boxes(0, {1: Box((15.0, 0.0, 1.0), 0.0, 0.0, 1.0, 20.0, 2.0)})
        for _ in range(40):
            fleet.step(np.zeros((1, 3)))
            assert fleet.motion.position[0, 0] < 15.0
        assert np.isfinite(fleet.motion.velocity[0]).all()


def test_a_car_on_its_side_slides_to_a_stop_on_the_road():
    start = np.zeros((1, layout.BODY_SIZE))
    with Fleet(1, 1) as fleet:
        fleet.spawn(0, "passenger", (0.0, 0.0), 0.0, 0.0)
        start[0] = 0.0, 0.0, 1.2, np.sin(0.85), 0.0, 0.0, np.cos(0.85), 10.0, 0.0, 0.0, 0.0, 0.0, 0.0
        put_body(fleet, 0, start[0])
        for _ in range(50):
            motion = fleet.step(np.array([[1.0, 0.0, 0.0]]))
        assert fleet.wheels.load[0].max() == 0.0
        assert np.abs(motion.velocity[0]).max() < 0.3
        # From 10 m/s with a friction of 0.6: 8.5 m, and it rests near the road.
        assert 5.0 < motion.position[0, 0] < 20.0
        assert 0.5 < fleet.body(0)[2] < 1.0


def test_importing_it_prints_nothing_and_leaves_the_streams_alone():
    code = """
import os, sys
open_files = os.listdir('/dev/fd')
sys.stderr.write('before ')
import smarts.dynamics
os.write(2, b'after')
print(open_files == os.listdir('/dev/fd'))
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (run.stdout, run.stderr) == ("True\n", "before after")


class TestTouches:
    """Who touched whom, and how fast the two approached each other there, by hand."""

    LENGTH, WIDTH = 4.508, 1.61

    def first(self, *bodies, box=None, box_first=False):
        """Return the touches of the first sub-step. Bullet sees who touches before it moves them."""
        motions = np.array(bodies)
        world = BulletWorld(motions, DT)
        boxes = {7: box} if box else {}
        if box_first:
            world.place_boxes(boxes)
        for row in range(len(motions)):
            world.add(row, layout.pack("passenger", "pacejka"))
        world.place_boxes(boxes)
        velocities = motions[:, 7:].reshape(-1, 2, 3).tolist()
        world.substep(velocities)
        touches = list(world.contacts(velocities))
        world.close()
        return touches

    def body(self, x, speed=0.0, yaw_rate=0.0):
        """Return the motion of a car along x whose centre of gravity is at x."""
        return [x, 0.0, 0.6, 0.0, 0.0, 0.0, 1.0, speed, 0.0, 0.0, 0.0, 0.0, yaw_rate]

    @pytest.mark.parametrize("order", [1, -1], ids=["the faster first", "the slower first"])
    def test_of_two_vehicles(self, order):
        pair = self.body(0.0, 12.0), self.body(self.LENGTH - 0.01, 4.0)
        touches = self.first(*pair[::order])
        assert touches
        for touch in touches:
            assert {touch.row, touch.other_row} == {0, 1}
            assert (touch.box, touch.speed) == (-1, pytest.approx(8.0))

    @pytest.mark.parametrize("box_first", [False, True])
    def test_of_a_box_that_comes(self, box_first):
        wall = Box((0.01 - self.LENGTH - 0.258, 0.0, 0.7), 0.0, 9.0, self.LENGTH, 2.0, 1.4)
        touches = self.first(self.body(0.0, 2.0), box=wall, box_first=box_first)
        assert touches
        for touch in touches:
            assert (touch.row, touch.other_row, touch.box) == (0, -1, 7)
            assert touch.speed == pytest.approx(7.0, abs=0.01)

    @pytest.mark.parametrize("speed", [0.0, 30.0])
    def test_of_a_corner_that_swings(self, speed):
        """However fast the car is: what it goes beside the box in the sub-step is no part of the lever."""
        corner = self.LENGTH / 2 - 0.258
        beside = Box((2.5, self.WIDTH / 2 + 0.99, 0.7), 0.0, 0.0, 3.0, 2.0, 1.4)
        touches = self.first(self.body(0.0, speed, yaw_rate=2.0), box=beside)
        assert max(touch.speed for touch in touches) == pytest.approx(2.0 * corner, rel=0.01)

    def test_of_the_rear_of_a_box_that_turns(self):
        """A bus ahead in the next lane moves on and away, but its rear corner swings out."""
        bus = Box((6.0, self.WIDTH / 2 + 1.24, 1.5), 0.0, 5.0, 12.0, 2.5, 3.0, 0.5, 1.0)
        touches = self.first(self.body(0.0), box=bus)
        # The car's front right of it; 6 m behind its centre a bus at 1 rad/s swings at 6 m/s.
        assert max(touch.speed for touch in touches) == pytest.approx(6.0 - 0.5, rel=0.01)

    @pytest.mark.parametrize(("axis", "reach"), [(0, 5.5), (1, 2.5)])
    def test_of_bodies_that_are_as_large_as_told(self, axis, reach):
        place = [0.0, 0.0]
        place[axis] = reach + 1.0
        with Fleet(1, 2) as fleet:
            fleet.spawn(0, "truck", (0.0, 0.0), 0.0, size=(6.0, 3.0))
            fleet.spawn(1, "passenger", tuple(place), 0.0, size=(5.0, 2.0))
            body = fleet.body(1)
            body[7 + axis] = -10.0
            put_body(fleet, 1, body)
            for _ in range(5):
                fleet.step(np.zeros((2, 3)))
                if fleet.contacts:
                    break
            first, _ = fleet.contacts[0]
            apart = fleet.motion.substeps[1, first, axis] - fleet.motion.substeps[0, first, axis]
        assert apart == pytest.approx(reach, abs=0.2)
