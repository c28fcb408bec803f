"""The vehicle provider: the fleet's vehicles, hand-overs, boxes, poses, friction, masked simulations."""

import math

import numpy as np
import pytest

from smarts.controllers import tracking
from smarts.dynamics import Fleet, vehicle
from smarts.providers.vehicle_surface import RoadSurfaces
from smarts.sstudio import types as t
from smarts.types.actions import KINKED, CommandMode
from smarts.types.agent_states import AgentStatus
from smarts.types.transfers import Reason, Refusal, Transfer
from smarts.types.vehicles import Owner, VehicleKind
from tests import maps
from tests.vehicle_stage import ego
from tests.worlds import Car


@pytest.mark.parametrize("model", ["bullet", "dynamic", "kinematic"])
def test_writes_rows_and_tracks(stage, model):
    driven = stage([ego(), Car(300.0, 3.2, speed=5.0)], model=model)
    driven.actuate(throttle=0.3)
    tracks = driven.step(5).poses
    vehicles, agents = driven.world.vehicles, driven.world.agents
    assert tracks.shape == (1, 4, 10, 3)
    assert tracks[0, 0, -1].tolist() == [*vehicles.position[0, 0], vehicles.heading[0, 0]]
    assert np.diff(tracks[0, 0, :, 0]) == pytest.approx(vehicles.speed[0, 0] / 100.0, rel=0.03)
    gained = vehicles.speed[0, 0] - driven.world.before.speed[0, 0]
    assert vehicles.acceleration[0, 0] == pytest.approx(gained / 0.1, rel=1e-3)
    assert agents.throttle[0, 0] == 0.3
    assert agents.distance_travelled[0, 0] == pytest.approx(vehicles.position[0, 0, 0] - 20.0)
    # Another provider moves traffic.
    assert vehicles.position[0, 1].tolist() == [300.0, 3.2]


def test_kinematic_vehicles_drive_alike_each_by_itself_and_all_in_turn():
    turned = np.linspace(0.0, 2.0, 64)
    reference = np.stack([20.0 * np.sin(turned), 20.0 - 20.0 * np.cos(turned), turned, 9.0 - turned], 1)
    driven = []
    for alone in (False, True):
        memory, shown, most = np.zeros((3, tracking.MEMORY)), np.zeros((3, 3)), len(turned)
        mode = np.array([CommandMode.TRACK, CommandMode.ACTUATORS_RATE, CommandMode.NONE], np.int8)
        actuators, window = np.array([[0.3, 0.0, 0.5]] * 3), np.array([KINKED] * 3)
        points, slips = np.array([most] * 3, np.int32), np.zeros(3, np.bool_)
        rows = mode, actuators, np.stack([reference] * 3), points, window, slips, memory, shown
        with Fleet(1, 3) as fleet:
            for row in range(3):
                fleet.spawn(row, "passenger", (0.0, 9.0 * row), 0.05, 8.0, model="kinematic")
            laws = [
                fleet.driver(law, tracking.Followed(*rows))
                for law in (tracking.drive, tracking.drive_kinematic)
            ]
            for _ in range(30):
                fleet.step(np.zeros((3, 3)), driver=laws[0], kinematic=laws[1] if alone else None)
            driven.append([*(column.copy() for column in fleet.motion), shown, memory])
    for one, other in zip(*driven, strict=True):
        assert one == pytest.approx(other, abs=1e-9)
    assert driven[0][1][0, -1, 2] > 1.0  # it has followed the bend


class TestHandOver:
    def take(self, driven, slot, agent_id):
        world = driven.world
        generation = int(world.vehicles.generation[0, slot])
        row = (0, slot, generation, Owner.TRAFFIC, -1, Owner.AGENT, agent_id, Reason.TAKE)
        driven.made.ownership.submit([Transfer(*row)])

    @pytest.mark.parametrize(
        ("model", "yaw_rate"), [("bullet", 0.0), ("bullet", 0.2), ("dynamic", 0.2), ("kinematic", 0.2)]
    )
    def test_from_traffic_without_a_jump(self, stage, model, yaw_rate):
        driven = stage([Car(50.0, 3.2, 0.1, 12.0), ego()], model=model)
        vehicles = driven.world.vehicles
        vehicles.yaw_rate[0, 0] = yaw_rate
        driven.step(3)
        self.take(driven, slot=0, agent_id=2)
        driven.commands.mode[0, 2] = CommandMode.NONE
        tracks = driven.step().poses
        assert driven.world.agents.state[0, 2] == AgentStatus.ACTIVE
        assert tracks[0, 2, 0, :2] == pytest.approx(
            [50.0 + 0.12 * math.cos(0.1), 3.2 + 0.12 * math.sin(0.1)], abs=0.02
        )
        assert vehicles.speed[0, 0] == pytest.approx(12.0, abs=0.05)
        assert vehicles.heading[0, 0] == pytest.approx(0.1 + 0.1 * yaw_rate, abs=0.005)
        assert abs(vehicles.acceleration[0, 0]) < 0.5
        assert vehicles.yaw_rate[0, 0] == pytest.approx(yaw_rate, abs=0.04)

    def test_a_vehicle_handed_to_traffic_leaves_the_fleet(self, stage):
        driven = stage([ego()])
        driven.step()
        generation = int(driven.world.vehicles.generation[0, 0])
        row = (0, 0, generation, Owner.AGENT, 0, Owner.TRAFFIC, -1, Reason.RELEASE)
        driven.made.ownership.submit([Transfer(*row)])
        driven.step()
        assert not driven.vehicles.fleet.motion.active.any()
        before = driven.world.vehicles.position[0, 0].copy()
        driven.step()
        assert driven.world.vehicles.position[0, 0].tolist() == before.tolist()

    def test_another_vehicle_in_the_same_slot_is_spawned(self, stage):
        driven = stage([ego(speed=20.0)])
        driven.step()
        world = driven.world
        world.vehicles.generation[0, 0] += 1
        world.agents.generation[0, 0] += 1
        world.vehicles.position[0, 0], world.vehicles.speed[0, 0] = (100.0, 3.2), 2.0
        driven.step()
        assert world.vehicles.position[0, 0] == pytest.approx([100.2, 3.2], abs=0.01)

    def test_a_trailer_cannot_be_accepted(self, stage):
        driven = stage([Car(50.0, 0.0, kind=VehicleKind.TRAILER), Car(80.0, 0.0, kind=VehicleKind.BUS)])
        refusals = driven.vehicles.can_accept(np.zeros(2, np.int32), np.arange(2, dtype=np.int32))
        assert refusals.tolist() == [Refusal.KIND, Refusal.NONE]

    @pytest.mark.parametrize(("ahead", "refusal"), [(0.0, Refusal.NONE), (1.6, Refusal.SIDEWAYS)])
    @pytest.mark.parametrize(("kind", "turn"), [(VehicleKind.PASSENGER, -0.5), (VehicleKind.BUS, 0.5)])
    def test_a_vehicle_that_turns_swings_about_its_rear_axle(self, stage, kind, turn, ahead, refusal):
        """Its centre moves sideways by the turn; it may not as if it turned the other way."""
        driven, car = stage([Car(50.0, 0.0, kind=kind)]), vehicle(kind.name.lower())
        vehicles = driven.world.vehicles
        vehicles.yaw_rate[0, 0] = turn
        of_turn = turn * (car.cog_to_rear_axle - car.centre_to_cog)
        vehicles.lateral_speed[0, 0] = of_turn - math.copysign(ahead, turn)
        assert driven.vehicles.can_accept(np.zeros(1, np.int32), np.zeros(1, np.int32)).tolist() == [refusal]

    @pytest.mark.parametrize(
        ("sideways", "refusal"), [(-1.1, Refusal.NONE), (2.1, Refusal.SIDEWAYS), (-2.1, Refusal.SIDEWAYS)]
    )
    def test_a_vehicle_that_traffic_swings_cannot_be_accepted(self, stage, sideways, refusal):
        driven = stage([Car(50.0, 0.0)])
        driven.world.vehicles.lateral_speed[0, 0] = sideways
        assert driven.vehicles.can_accept(np.zeros(1, np.int32), np.zeros(1, np.int32)).tolist() == [refusal]


def test_traffic_is_in_bullet_only_while_an_ego_may_touch_it(stage):
    driven = stage([ego(speed=10.0), Car(60.0, 0.0, speed=0.0), Car(60.0, 3.2)])
    vehicles = driven.world.vehicles
    present = []
    for _ in range(62):
        gap = vehicles.position[0, 1, 0] - vehicles.position[0, 0, 0] - vehicles.length[0, 0]
        driven.step()
        present.append((gap, [key % vehicles.capacity for key in driven.boxes]))
    # The ego moves 1 m in a step, and 0.4 m are slack; the vehicle in the next lane cannot be touched.
    assert all(slots == [] for gap, slots in present if gap > 1.5)
    assert all(slots == [1] for gap, slots in present if gap < 1.3)
    # The ego ran into the standing vehicle, which is a box and does not move.
    assert min(gap for gap, _ in present) < 0.1
    assert vehicles.position[0, 0, 0] < 60.0 - 4.0
    assert vehicles.speed[0, 0] < 2.0
    driven.vehicles.reset(driven.all)
    assert driven.boxes == []


class TestPlaced:
    def test_takes_the_commanded_poses(self, stage):
        driven = stage([ego()])
        commands = driven.commands
        commands.mode[0, 0] = CommandMode.PLACE
        commands.poses[0, 0] = np.linspace((20.1, 0.05, 0.01, 10.0), (21.0, 0.5, 0.1, 11.0), 10)
        tracks = driven.step().poses
        vehicles = driven.world.vehicles
        assert np.array_equal(tracks[0, 0], commands.poses[0, 0, :, :3])
        assert vehicles.position[0, 0].tolist() == [21.0, 0.5]
        assert vehicles.speed[0, 0] == 11.0
        assert vehicles.acceleration[0, 0] == pytest.approx(10.0)
        assert vehicles.yaw_rate[0, 0] == pytest.approx(1.0)
        assert not driven.vehicles.fleet.motion.active.any()


class TestFriction:
    def braked(self, stage, *patches):
        graph = maps.straight(lanes=3, length=600.0)
        surfaces = RoadSurfaces([patches], [graph])
        driven = stage([ego(speed=20.0)], surfaces=surfaces)
        driven.actuate(brake=1.0)
        driven.step(15)
        return float(driven.world.vehicles.speed[0, 0])

    def test_a_slippery_patch_makes_braking_longer(self, stage):
        whole = t.PositionalZone(pos=(100.0, 0.0), size=(400.0, 20.0))
        assert self.braked(stage) == pytest.approx(20.0 - 1.5 * 0.9 * 9.81, abs=0.8)
        slippery = t.RoadSurfacePatch(whole, 0.0, 100.0, 0.3)
        assert self.braked(stage, slippery) == pytest.approx(20.0 - 1.5 * 0.3 * 9.81, abs=0.8)

    def test_patches_have_an_area_and_a_period(self, stage):
        far = t.RoadSurfacePatch(t.PositionalZone(pos=(500.0, 0.0), size=(20.0, 20.0)), 0.0, 100.0, 0.3)
        later = t.RoadSurfacePatch(t.PositionalZone(pos=(100.0, 0.0), size=(400.0, 20.0)), 50.0, 100.0, 0.3)
        assert self.braked(stage, far, later) == pytest.approx(self.braked(stage))

    def test_under_the_left_wheels_only(self, stage):
        left = t.RoadSurfacePatch(t.PositionalZone(pos=(100.0, 10.0), size=(400.0, 20.0)), 0.0, 100.0, 0.3)
        graph = maps.straight(lanes=3, length=600.0)
        driven = stage([ego(speed=20.0)], surfaces=RoadSurfaces([[left]], [graph]))
        driven.step()
        assert driven.vehicles.fleet.road.friction[0].tolist() == [0.3, 0.9, 0.3, 0.9]
