import hashlib
import math

import numpy as np
import pytest

from smarts.dynamics import FLAT_TYRE, MODELS, Box, Fleet, MotionError
from tests.raising import raises


def wild_controls(rows, steps, seed=3):
    rng = np.random.Generator(np.random.Philox(key=seed))
    return rng.uniform(-1.0, 1.0, (steps, rows, 3))


def fingerprint(fleet, rows):
    parts = (
        fleet.motion.substeps[rows],
        fleet.motion.velocity[rows],
        fleet.motion.yaw_rate[rows],
        fleet.wheels.slip[rows],
    )
    return hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest()


def fill(fleet, simulation, row0):
    """Four vehicles that come near each other, one faulty, beside a box."""
    for i, (name, model) in enumerate(
        [("passenger", "bullet"), ("bus", "bullet"), ("truck", "dynamic"), ("motorcycle", "kinematic")]
    ):
        fleet.spawn(row0 + i, name, (0.0, 6.0 * i), 0.1 * i, 5.0 + i, model=model)
    fleet.set_fault(row0, 1, FLAT_TYRE)
    fleet.place_boxes(simulation, {5: Box((14.0, 1.0, 0.8), 0.3, 2.0, 4.5, 1.8, 1.6)})


@pytest.mark.parametrize(("slope", "turn"), [(0.0, 0.0), (0.1, 1e-4), (0.1, -1.5e-3)])
def test_a_vehicle_that_heads_west_lies_on_its_road(slope, turn):
    heading = math.pi - turn
    with Fleet(1, 1) as fleet:
        fleet.road.normal[:] = -math.sin(slope), 0.0, math.cos(slope)
        fleet.spawn(0, "passenger", (0.0, 0.0), heading)
        x, y, z, w = fleet.body(0)[3:7]
    forward = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w)
    up = 2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)
    assert math.cos(math.atan2(forward[1], forward[0]) - heading) == pytest.approx(1.0, abs=1e-15)
    assert up == pytest.approx((-math.sin(slope), 0.0, math.cos(slope)), abs=1e-9)


def test_row_of_a_batch_is_the_vehicle_alone_to_the_bit():
    controls = wild_controls(4, 60)
    with Fleet(1, 4) as alone, Fleet(3, 4) as batch:
        fill(alone, 0, 0)
        for simulation in range(3):
            fill(batch, simulation, 4 * simulation)
        others = wild_controls(12, 60, seed=4)
        for step in range(60):
            alone.step(controls[step])
            others[step, 4:8] = controls[step]
            batch.step(others[step])
            assert fingerprint(alone, slice(0, 4)) == fingerprint(batch, slice(4, 8))


def test_cleared_simulation_is_a_fresh_one_to_the_bit_and_its_neighbour_goes_on():
    controls = wild_controls(8, 40)
    seen = set()
    with Fleet(2, 4) as fleet:
        fill(fleet, 0, 0)
        for _ in range(3):
            fill(fleet, 1, 4)
            for step in range(40):
                fleet.step(controls[step])
            seen.add(fingerprint(fleet, slice(4, 8)))
            fleet.clear(1)
            assert fleet.motion.active.tolist() == [True] * 4 + [False] * 4
    assert len(seen) == 1


@pytest.mark.parametrize("model", MODELS)
def test_spawn_shows_the_pose_it_was_given(model):
    with Fleet(1, 2) as fleet:
        fleet.spawn(1, "bus", (12.0, -3.0), 2.5, 8.0, model=model)
        assert fleet.motion.active.tolist() == [False, True]
        assert fleet.motion.position[1].tolist() == [12.0, -3.0]
        assert fleet.motion.heading[1] == 2.5
        assert fleet.motion.velocity[1].tolist() == [8.0, 0.0]
        fleet.step(np.zeros((2, 3)))
        moved = 0.8 * np.array([np.cos(2.5), np.sin(2.5)])
        assert fleet.motion.position[1] == pytest.approx(np.array([12.0, -3.0]) + moved, abs=0.01)
        assert fleet.motion.heading[1] == pytest.approx(2.5)


@pytest.mark.parametrize("model", MODELS)
def test_heading_stays_in_its_range_through_west(model):
    with Fleet(1, 1) as fleet:
        fleet.spawn(0, "passenger", (0.0, 0.0), np.pi, 5.0, model=model)
        fleet.step(np.zeros((1, 3)))
        assert fleet.motion.heading[0] == pytest.approx(np.pi)
        headings = []
        for _ in range(200):
            fleet.step(np.array([[0.1, 0.0, 0.8]]))
            headings.extend(fleet.motion.substeps[0, :, 2])
        assert min(headings) > -np.pi
        assert max(headings) <= np.pi
        assert np.ptp(headings) > 6.0


@pytest.mark.parametrize("model", ["bullet", "dynamic"])
def test_a_motion_that_cannot_be_is_named_leaves_the_others_alone_and_can_be_cleared(model):
    with Fleet(2, 1) as fleet:
        fleet.spawn(0, "passenger", (0.0, 0.0), 0.0, 5.0, model=model)
        fleet.spawn(1, "passenger", (0.0, 0.0), 0.0, 5.0, model=model)
        fleet.road.friction[1] = np.nan
        with raises(MotionError, "row 1"):
            fleet.step(np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.5]]))
        assert fleet.lost.tolist() == [False, True]
        assert fleet.motion.position[0] == pytest.approx([0.5, 0.0], abs=0.01)
        fleet.clear(1)
        fleet.spawn(1, "passenger", (0.0, 0.0), 0.0, 5.0, model=model)
        fleet.step(np.zeros((2, 3)))
        assert fleet.motion.position[1] == pytest.approx([0.5, 0.0], abs=0.01)
