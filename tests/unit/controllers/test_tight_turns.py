"""Turns tighter than the vehicle's turning circle, and the lanes after them."""

import math

import numpy as np
import pytest

from smarts.controllers import drivable_path
from smarts.controllers.drivable_path import STEP, plan_drivable_path
from smarts.dynamics.performance import Abilities
from smarts.roads.atlas import RoadAtlas
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.vehicles import VehicleKind
from tests import maps
from tests.unit.controllers.rig import agent, winding

CAR, BUS, TRUCK = VehicleKind.PASSENGER, VehicleKind.BUS, VehicleKind.TRUCK
ABILITIES = Abilities.of_all()


def circle(kind):
    """Return the radius of a vehicle's centre at full lock [m]."""
    return math.hypot(1.0 / (ABILITIES.sharpest[kind] / 0.95), ABILITIES.centre_to_rear[kind])


@pytest.mark.parametrize(
    ("kind", "radius", "model"), [(CAR, 4.0, "bullet"), (TRUCK, 9.0, "dynamic"), (BUS, 13.0, "kinematic")]
)
def test_leaves_a_tight_bend_no_faster_than_the_steering_unwinds(rig, kind, radius, model):
    driven = rig([agent(20.0, 0.0, speed=5.0, kind=kind)], graph=winding(radius, before=60.0), model=model)
    driven.act(12.0, 0.0)
    log = driven.log(400, "lane_offset", "speed", "lane_position")
    behind = log[:, 2] > 60.0 + radius * math.pi / 2
    assert np.abs(log[behind, 0]).max() < 1.0
    assert log[-1, 1] == pytest.approx(12.0, abs=0.3)
    assert log[:, 1].min() > 1.0
    # On the straight lane, no offset remains.
    assert abs(log[-1, 0]) < 0.1


@pytest.mark.parametrize(
    ("kind", "gap", "end"), [(CAR, 4.0, "south_out"), (TRUCK, 8.0, "north_out"), (BUS, 14.0, "south_out")]
)
def test_swings_wide_where_a_junction_is_tighter_than_the_turning_circle(rig, kind, gap, end):
    """The right turn's radius is `gap` less half a lane: 2.4 m for the car, whose centre turns at 4.6 m."""
    graph = maps.crossing(gap=gap)
    car = agent(-60.0, -1.6, speed=8.0, kind=kind, route=("west_in", end))
    driven = rig([car], graph=graph, kind=ActionSpaceType.Lane)
    driven.act(LaneAction.keep_lane)
    offsets = []
    for _ in range(350):
        driven.step()
        assert driven.agents.on_road[0, 0]
        offsets.append(driven.world.vehicles.lane_offset[0, 0])
        if driven.agents.remaining[0, 0] < 10.0:
            break
    assert driven.graph.edge_ids[driven.graph.lane_edge[driven.world.vehicles.lane[0, 0]]] == end
    assert np.abs(offsets).max() < 1.3
    assert driven.agents.remaining[0, 0] < 10.0


def corner(turn, *, before=12.0, after=60):
    """Return a reference along +x that turns by an angle to the left at one point, shape (R, 4)."""
    along = np.arange(float(after)) - before
    x = np.where(along < 0.0, along, along * math.cos(turn))
    y = np.where(along < 0.0, 0.0, along * math.sin(turn))
    heading = np.where(along < 0.0, 0.0, turn)
    heading[along == 0.0] = 0.5 * turn
    return np.stack([x, y, heading, np.full(after, 3.0)], 1)


def offsets_from_corner(points, turn):
    """Return the signed distances of points to the two legs of `corner`, left positive, shape (R,)."""
    first = points[:, 1]
    second = points[:, 1] * math.cos(turn) - points[:, 0] * math.sin(turn)
    is_first = points[:, 0] * math.cos(turn / 2) + points[:, 1] * math.sin(turn / 2) < 0.0
    return np.where(is_first, first, second)


@pytest.fixture(scope="module")
def wide_road():
    """Return a map with one road along +x, 150 m wide, so that no edge is near."""
    return RoadAtlas([maps.graph_of({"road": maps.Road([(-100.0, 0.0), (100.0, 0.0)], width=150.0)})]).roads


@pytest.mark.parametrize(("kind", "degrees"), [(CAR, 40.0), (CAR, 90.0), (TRUCK, 60.0)])
def test_a_plan_is_nearly_as_close_to_a_corner_as_possible(wide_road, kind, degrees):
    """The smallest possible offset is R tan(turn / 4)^2, outside and inside: two tangents and an arc."""
    turn = math.radians(degrees)
    points = corner(turn, before=14.0)
    pose = points[0, 0], 0.0, 0.0
    plan_drivable_path(wide_road, 0, points, pose, 0.0, 0.0, 2.0, int(kind), ABILITIES)
    planned = points[: min(int(6.0 * circle(kind)), 46) - 4]
    offsets = offsets_from_corner(planned[:, :2], turn)
    bound = circle(kind) * math.tan(turn / 4.0) ** 2
    # Points are 1 m apart, the plan keeps a reserve of the steering lock, and steering takes time.
    assert 0.9 * bound < np.abs(offsets).max() < 1.3 * bound + 0.35
    # First to the outside: to the right before a left turn.
    first = offsets[: int(np.abs(planned[:, :2]).sum(axis=1).argmin())]
    assert first.min() < -0.3 * bound


@pytest.mark.parametrize("kind", [CAR, TRUCK, BUS])
def test_a_plan_can_be_driven(wide_road, kind):
    points = corner(math.pi / 3, before=14.0)
    plan_drivable_path(wide_road, 0, points, (points[0, 0], 0.3, 0.05), 0.0, 0.02, 4.0, int(kind), ABILITIES)
    count = min(int(6.0 / (0.92 * ABILITIES.sharpest[kind])), 46)
    # The rear axle's headings: the path's less the side slip of the centre.
    steps = np.diff(points[: count + 1, :2], axis=0)
    chords = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    bends = np.diff(chords) / np.hypot(*steps.T)[1:]
    ahead, sharpest = ABILITIES.centre_to_rear[kind], ABILITIES.sharpest[kind]
    assert np.abs(bends).max() < 1.1 * sharpest + 0.5 * ahead * sharpest / STEP
    assert points[0, :2] == pytest.approx([points[0, 0], 0.3])
    # The speed is lowest where the steering turns fastest, but never 0.
    assert points[:count, 3].min() >= drivable_path.CRAWL
    assert points[:count, 3].max() <= 3.0


def test_one_iteration_solves_the_linearised_problem():
    """The reference is the same sum of squares, solved as one dense system."""
    generator = np.random.default_rng(4)
    count, ahead, sharpest, curvature = 12, 1.2, 0.2, 0.05
    bends = generator.uniform(-0.25, 0.25, count)
    smoothness = generator.uniform(5.0, 40.0, count)
    found = np.zeros((count + 1, 4))
    found[:, 0], found[:, 1] = generator.normal(0.0, 0.8, count + 1), generator.normal(0.0, 0.2, count + 1)
    found[::3, 2] = 0.3
    lower = np.tril(np.ones((count, count)))
    turned = STEP * lower
    moved = STEP * (np.tril(np.ones((count, count)), -1) @ turned) + ahead * turned
    rows, targets = [], []

    def add(weight, row, residual):
        rows.append(math.sqrt(weight) * row)
        targets.append(-math.sqrt(weight) * residual)

    part = drivable_path
    for k in range(count):
        offset = found[k + 1, 0]
        add(STEP * (part.END_COST if k == count - 1 else 1.0), moved[k], offset)
        if abs(offset) > part.EASY_OFFSET:
            add(STEP * part.FAR_COST, moved[k], math.copysign(abs(offset) - part.EASY_OFFSET, offset))
        if found[k + 1, 2] != 0.0:
            add(STEP * part.EDGE_COST, moved[k], found[k + 1, 2])
        unit = np.eye(count)[k]
        if abs(bends[k]) > sharpest:
            excess = math.copysign(abs(bends[k]) - sharpest, bends[k])
            add(part.BOUND_COST / sharpest**2, unit, excess)
        before = np.eye(count)[k - 1] if k else np.zeros(count)
        add(smoothness[k] / STEP, unit - before, bends[k] - (bends[k - 1] if k else curvature))
    add(part.END_COST, turned[-1], found[count, 1])
    expected = bends + np.linalg.lstsq(np.array(rows), np.array(targets), rcond=None)[0]
    part._improve(bends, curvature, sharpest, ahead, smoothness, found)
    assert bends == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("kind", "offset", "is_kept"), [(CAR, 2.3, True), (CAR, 2.6, False), (TRUCK, 4.0, True)]
)
def test_a_long_vehicle_that_swings_into_the_lane_beside_keeps_its_own(rig, kind, offset, is_kept):
    """It took the lane beside for its own, so that trucks left their routes behind turns of wide roads."""
    driven = rig([agent(60.0, offset, speed=3.0, kind=kind)], graph=maps.straight(lanes=2), model="kinematic")
    driven.act(3.0, 0.0)
    driven.step()
    driven.agents.target_lane[0, 0] = 0
    driven.step()
    assert (driven.agents.target_lane[0, 0] == 0) == is_kept
