"""The boxes that the vehicle provider places in Bullet, and the contacts that it records."""

import math

import numpy as np
import pytest

from smarts.dynamics import vehicle
from smarts.types.actions import CommandMode
from smarts.types.vehicles import Owner, VehicleKind
from tests.fleets import put_body
from tests.vehicle_stage import MISSION, ego
from tests.worlds import Car


def box_all_vehicles(driven):
    """Make a stage place all vehicles except slot 0, the fleet's own vehicle, as boxes in every step."""
    boxed, alive = driven.vehicles._boxed, driven.world.vehicles.alive

    def find(env_mask):
        boxed[:, 1:] = alive[:, 1:]
        return True

    driven.vehicles._find_touchable = find


def replace(driven, slot):
    """Replace the vehicle of a slot by another one of the same size."""
    registry, vehicles = driven.world.registry, driven.world.vehicles
    length, width = vehicles.length[0, slot], vehicles.width[0, slot]
    registry.dismiss(0, slot)
    assert registry.admit(0, "another", Owner.TRAFFIC, VehicleKind.PASSENGER, length, width) == slot
    vehicles.height[0, slot] = 0.0


class TestBoxesSuffice:
    """A step with boxes for near vehicles only equals the step with boxes for all vehicles."""

    def last_step(self, stage, body, place, kind, brake, all_boxed):
        """Return the poses of a step that begins beside another vehicle, and whether the two touched.

        Args:
            stage: Factory of stages.
            body: Values of the vehicle's body one step before, by index (`layout.BODY_SIZE`).
            place: Centre of the other vehicle, relative to the vehicle's, when the step begins [m]. Both have
                the same speed.
            kind: Kind of the vehicle.
            brake: Brake of the vehicle in that step.
            all_boxed: Whether all vehicles are boxes in Bullet.
        """
        of_type, speed = vehicle(kind.name.lower()), 20.0 if brake else 0.0
        own = Car(
            50.0, 0.0, speed=speed, mission=MISSION, kind=kind, length=of_type.length, width=of_type.width
        )
        driven = stage([own, Car(500.0, 0.0, length=5.0, width=2.0)])
        if all_boxed:
            box_all_vehicles(driven)
        driven.step()
        moved = driven.vehicles.fleet.body(0)
        for index, value in body.items():
            moved[index] = value
        put_body(driven.vehicles.fleet, 0, moved)
        driven.step()
        vehicles = driven.world.vehicles
        vehicles.position[0, 1] = vehicles.position[0, 0] + place
        vehicles.speed[0, 1] = vehicles.speed[0, 0]
        driven.actuate(brake=brake)
        tracks = driven.step()
        return tracks.poses[0, 0].copy(), tracks.touched[0, 0, 1] > 0

    def check(self, stage, body, place, kind=VehicleKind.PASSENGER, brake=0.0):
        poses, _ = self.last_step(stage, body, place, kind, brake, all_boxed=False)
        others, touched = self.last_step(stage, body, place, kind, brake, all_boxed=True)
        assert touched
        assert poses == pytest.approx(others, abs=1e-9)

    def test_a_braking_vehicle(self, stage):
        # They overlap by about 3 cm, before the nose has dived.
        self.check(stage, {}, (-(4.508 + 5.0) / 2 - 0.01, 0.0), brake=1.0)

    def test_a_vehicle_on_its_side(self, stage):
        # It lies on its left; the roof, 3 m from the footprint's centre, slides towards the other vehicle.
        half = math.sqrt(0.5)
        body = {1: -0.82, 2: 1.28, 3: -half, 4: 0.0, 5: 0.0, 6: half, 8: 3.0}
        self.check(stage, body, (0.0, 3.0 + 1.0 + 0.1), kind=VehicleKind.BUS)


class TestBoxesAreRemoved:
    def pushed(self, stage, slot):
        """Return the motion of a vehicle that is pushed by the vehicle in slot 1, then by one in `slot`."""
        driven = stage([ego(20.0, speed=8.0), Car(26.0, 0.0), Car(400.0, 0.0)])
        vehicles = driven.world.vehicles
        driven.actuate(throttle=0.5)
        driven.step(12)
        assert len(driven.boxes) == 1
        if slot == 1:
            replace(driven, slot)
        vehicles.position[0, 1:3, 0] = 400.0
        vehicles.position[0, slot, 0] = vehicles.position[0, 0, 0] + 4.9
        vehicles.speed[0, slot] = -5.0
        driven.step(4)
        return driven.vehicles.fleet.body(0)

    def test_when_another_takes_the_slot(self, stage):
        """Bullet stores the contact points of two bodies; a new vehicle must not inherit them."""
        same_slot, other_slot = self.pushed(stage, 1), self.pushed(stage, 2)
        assert same_slot[7] < 0.0
        assert same_slot.tolist() == other_slot.tolist()


class TestContacts:
    """Contacts are recorded for both vehicles, also if bodies touch before their footprints overlap."""

    def drive_up(self, stage, gap):
        """Brake fully towards a standing car; return the first contact, and the car's maximum speed."""
        length = vehicle("passenger").length
        back = Car(50.0, 0.0, speed=11.0, length=length, mission=MISSION)
        driven = stage([back, Car(50.0 + length + gap, 0.0, length=length, mission=MISSION)])
        driven.actuate(brake=1.0)
        pushed, first = 0.0, None
        for _ in range(25):
            tracks = driven.step()
            if first is None and tracks.touched.any():
                first = tracks.touched.copy(), tracks.touch_speed.copy()
            pushed = max(pushed, abs(driven.world.vehicles.speed[0, 1]))
        return first, pushed

    def test_a_pushed_vehicle_has_a_contact(self, stage):
        touched = 0
        for gap in np.arange(1.0, 11.0, 1.0):
            first, pushed = self.drive_up(stage, gap)
            assert (first is not None) == (pushed > 0.02), gap
            touched += first is not None
            if first is not None:
                substeps, speeds = first
                # The contact is recorded for both vehicles, in the same sub-step.
                assert 1 <= substeps[0, 0, 1] == substeps[0, 1, 0] <= 10
                assert not substeps[0, 0, [0, *range(2, substeps.shape[2])]].any()
                assert 0.0 <= speeds[0, 0, 1] == speeds[0, 1, 0] <= 11.1
        assert 2 < touched < 10

    def test_contacts_are_cleared_in_the_next_step(self, stage):
        driven = stage([Car(50.0, 0.0, speed=10.0, mission=MISSION), Car(56.0, 0.0, mission=MISSION)])
        steps = []
        for _ in range(20):
            tracks = driven.step()
            steps.append(bool(tracks.touched.any()))
            assert not tracks.touch_speed[tracks.touched == 0].any()
        assert any(steps)
        assert not steps[0]
        assert not steps[-1]

    def test_vehicles_moved_by_poses_are_touched_too(self, stage):
        """The vehicle that is moved by poses is a box, which the other vehicle runs into."""
        driven = stage([ego(20.0, speed=10.0), ego(26.0, speed=0.0)])
        driven.actuate(agent_id=0)
        driven.commands.mode[0, 1] = CommandMode.PLACE
        driven.commands.poses[0, 1] = 26.0, 0.0, 0.0, 0.0
        while not (tracks := driven.step()).touched.any():
            assert driven.world.vehicles.position[0, 0, 0] < 26.0
        assert tracks.touched[0, 0, 1] == tracks.touched[0, 1, 0] > 0
        assert tracks.touch_speed[0, :2, :2].tolist() == [
            [0.0, pytest.approx(10.0, abs=0.2)],
            [pytest.approx(10.0, abs=0.2), 0.0],
        ]

    @pytest.mark.parametrize("lag", [0.0, 0.7])
    def test_a_bus_turns_past_a_standing_vehicle_without_contact(self, stage, lag):
        """A bus drives on a circle of 14 m at 6 m/s; a car is 10 cm off the path of its outer corners."""
        radius, rate = 14.0, 6.0 / 14.0

        def pose(time):
            angle = rate * time
            return 60.0 + radius * math.sin(angle), radius - radius * math.cos(angle), angle

        x, y, turned = pose(1.0 + lag)
        corners = math.hypot(radius + 2.5 / 2, 12.0 / 2)
        out = corners - radius + 0.1 + 1.8 / 2
        car = Car(x + out * math.sin(turned), y - out * math.cos(turned), turned, mission=MISSION)
        driven = stage([car, Car(*pose(0.0)[:2], 0.0, 6.0, kind=VehicleKind.BUS, length=12.0, width=2.5)])
        vehicles = driven.world.vehicles
        vehicles.yaw_rate[0, 1] = rate
        driven.actuate(brake=1.0)
        for step in range(1, 25):
            assert not driven.step().touched.any()
            *vehicles.position[0, 1], vehicles.heading[0, 1] = pose(0.1 * step)
