"""Who is left to Bullet: whoever may touch somebody within the step, by a fleet that is always in Bullet."""

import numpy as np
import pytest

from smarts.dynamics import Box, Fleet, layout
from tests.fleets import put_body

FAR = {1: Box((9000.0, 0.0, 1.0), 0.0, 0.0, 4.0, 2.0, 2.0)}
"""With any box, all of a simulation is Bullet's."""
CAR, BUS = (layout.pack(name, "pacejka") for name in ("passenger", "bus"))


class Twice:
    """The same vehicles in two fleets, one of which is always in Bullet."""

    def __init__(self, *vehicles):
        """Spawn vehicles: name, centre of the footprint, speed along x, roll [rad], drift along y [m/s]."""
        self.fleets = Fleet(1, len(vehicles)), Fleet(1, len(vehicles))
        for fleet in self.fleets:
            for row, (name, (x, y), speed, *tilt) in enumerate(vehicles):
                fleet.spawn(row, name, (x, y), 0.0, speed)
                if tilt:
                    put_body(fleet, row, tilted(layout.pack(name, "pacejka"), x, y, *tilt))
        self.fleets[1].place_boxes(0, FAR)

    def step(self, controls=(0.0, 0.0, 0.0)):
        """Return how far the fleets are apart then, and whether anybody has touched anybody in Bullet."""
        for fleet in self.fleets:
            fleet.step(np.broadcast_to(controls, (len(fleet.motion.active), 3)))
        ours, bullets = self.fleets
        return np.abs(ours.motion.substeps - bullets.motion.substeps).max(), bool(bullets.contacts)

    def close(self):
        for fleet in self.fleets:
            fleet.close()


@pytest.fixture
def twice(closing):
    return lambda *vehicles: closing(Twice(*vehicles))


def tilted(car, x, y, roll, drift):
    """Return the body of a vehicle along x that has rolled to the right of its footprint's centre."""
    body = np.zeros(layout.BODY_SIZE)
    up = np.array([0.0, -np.sin(roll), np.cos(roll)])
    body[:3] = np.array([x + car["centre_to_cog"], y, 0.0]) + car["cog_height"] * up
    # Its lower edge stands on the road.
    body[2] += abs(np.sin(roll)) * car["half_size"][1]
    body[3], body[6], body[8] = np.sin(roll / 2), np.cos(roll / 2), drift
    return body


def test_one_that_brakes_is_hit_by_one_as_fast(twice):
    length = 2.0 * CAR["half_size"][0]
    pair = twice(("passenger", (0.0, 0.0), 20.0), ("passenger", (length + 0.03, 0.0), 20.0))
    apart, touched = pair.step([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert touched
    assert apart < 1e-9


def test_a_bus_on_its_side_reaches_as_far_as_it_is_high(twice):
    height = BUS["cog_height"] + BUS["box_height"] + BUS["half_size"][2]
    beside = -(height + CAR["half_size"][1] + 0.2)
    vehicles = [("bus", (0.0, 0.0), 0.0, np.pi / 2, -4.0), ("passenger", (0.0, beside), 0.0)]
    apart, touched = twice(*vehicles).step()
    assert touched
    assert apart < 1e-9


def test_overhang_by_hand():
    """A roof 3 m above the road hangs over by half of that at 30 degrees, half the width comes on top."""
    with Fleet(1, 1) as fleet:
        fleet.spawn(0, "bus", (0.0, 0.0), 0.0)
        put_body(fleet, 0, tilted(BUS, 0.0, 0.0, np.radians(30.0), 0.0))
        assert fleet.motion.overhang[0] == pytest.approx(0.5 * (3.0 + 0.5 * 2.55))
        fleet.step(np.zeros((1, 3)))
        x, y = fleet.body(0)[3:5]
        upright = 1.0 - 2.0 * (x * x + y * y)
        assert abs(upright - np.cos(np.radians(30.0))) > 1e-3
        assert fleet.motion.overhang[0] == pytest.approx(np.sqrt(1.0 - upright**2) * (3.0 + 0.5 * 2.55))
