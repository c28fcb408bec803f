"""Contacts: against shapely's exact predicates on many pairs, and by hand for who, where and how fast."""

import math

import numpy as np
import pytest
import shapely

from smarts.sim.contacts import FRONT, LEFT, REAR, RIGHT, FootprintContacts
from smarts.types.agent_states import AgentStatus
from smarts.types.mission import AgentMission
from smarts.types.tracks import Tracks
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World
from tests import maps
from tests.worlds import Car, world_of

SUBSTEPS = 10
EVERYBODY = np.ones(1, np.bool_)


def polygons(pose, size):
    """Return shapely's polygons of boxes, poses (..., 3) and sizes (..., 2)."""
    x, y, heading = np.moveaxis(pose, -1, 0)
    half = size / 2
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    corners = signs * half[..., None, :]
    cosine, sine = np.cos(heading)[..., None], np.sin(heading)[..., None]
    across = corners[..., 0] * cosine - corners[..., 1] * sine + x[..., None]
    along = corners[..., 0] * sine + corners[..., 1] * cosine + y[..., None]
    return shapely.polygons(np.stack([across, along], -1))


def overlaps(pose, size, pose2, size2):
    """Tell whether boxes share area, by DE-9IM: shapely's predicates are exact on the given corners."""
    return np.asarray(shapely.relate_pattern(polygons(pose, size), polygons(pose2, size2), "T********"))


def evenly(begin, end):
    """Return poses after each of the sub-steps of an even motion, turning the shorter way; (..., S, 3)."""
    share = np.arange(1, SUBSTEPS + 1)[:, None] / SUBSTEPS
    change = end - begin
    change[..., 2] = (change[..., 2] + np.pi) % (2 * np.pi) - np.pi
    return begin[..., None, :] + share * change[..., None, :]


def between(begin, poses, looks=40):
    """Return poses evenly from before the first sub-step to its end, and so on; (..., S, looks, 3)."""
    before = np.concatenate([begin[..., None, :], poses[..., :-1, :]], -2)
    change = poses - before
    change[..., 2] = (change[..., 2] + np.pi) % (2 * np.pi) - np.pi
    share = np.arange(1, looks + 1)[:, None] / looks
    return before[..., None, :] + share * change[..., None, :]


def put(states, pose, size):
    states.alive[:], states.generation[:] = True, 1
    states.position[:], states.heading[:] = pose[..., :2], pose[..., 2]
    states.length[:], states.width[:] = size[..., 0], size[..., 1]


def random_pairs(worlds, others, speed):
    """Return a world of one agent and many others around it, its tracks, and all poses at the sub-steps."""
    draw = np.random.Generator(np.random.Philox(7)).uniform
    shape = (worlds, others + 1)
    size = np.stack([draw(1.0, 15.0, shape), draw(0.8, 3.0, shape)], -1)
    before = np.concatenate([draw(-12, 12, (*shape, 2)), draw(-np.pi, np.pi, (*shape, 1))], -1)
    change = np.concatenate([draw(-speed, speed, (*shape, 2)) * 0.1, draw(-0.5, 0.5, (*shape, 1))], -1)
    now = before + change
    now[..., 2] = (now[..., 2] + np.pi) % (2 * np.pi) - np.pi
    world = World(worlds=worlds, capacity=others + 1, agents=1, lanes=1)
    put(world.before, before, size)
    put(world.vehicles, now, size)
    world.registry.used[:] = others + 1
    world.agents.state[:], world.agents.slot[:] = AgentStatus.ACTIVE, 0
    poses = evenly(before, now)
    # The agent does not move evenly: its track bends.
    bend = np.sin(np.linspace(0.1, np.pi, SUBSTEPS)) * draw(-1.0, 1.0, (worlds, 1))
    poses[:, 0, :, :2] += bend[..., None]
    return world, poses[:, :1].copy(), poses, size


@pytest.mark.parametrize("speed", [10.0, 60.0])
def test_against_exact_predicates(speed):
    worlds, others = 50, 100
    world, tracks, poses, size = random_pairs(worlds, others, speed)
    contacts = FootprintContacts(world).find(tracks_of(tracks, world), np.ones(worlds, np.bool_))
    touching = contacts.touching[:, 0, 1:]
    assert not contacts.touching[:, 0, 0].any()
    expected = overlaps(poses[:, :1], size[:, :1, None], poses[:, 1:], size[:, 1:, None])
    assert 0.1 < expected.any(-1).mean() < 0.9
    # Many pairs only meet on the way: at neither end of the step.
    passing = expected.any(-1) & ~expected[..., -1]
    assert passing.sum() > worlds * (0.2 if speed < 30 else 4)
    # A few only within a sub-step: those that come near are looked at more often.
    begin = np.concatenate([world.before.position, world.before.heading[..., None]], -1)
    boxes = polygons(poses[:, :1], size[:, :1, None]), polygons(poses[:, 1:], size[:, 1:, None])
    near = shapely.dwithin(*boxes, speed * 0.015).any(-1) & ~expected.any(-1)
    row, other = np.nonzero(near)
    own, its = (between(begin[row, who], poses[row, who]) for who in (0, other + 1))
    clipped = overlaps(own, size[row, 0, None, None], its, size[row, other + 1, None, None])
    clipped = clipped.any(-1)
    # Who part in the first sub-step have met in the step before.
    clipped[overlaps(begin[row, 0], size[row, 0], begin[row, other + 1], size[row, other + 1]), 0] = False
    assert 0 < clipped.any(-1).sum() < 0.05 * expected.any(-1).sum()
    expected[row, other] = clipped
    assert (touching == expected.any(-1)).all()
    first = np.where(expected.any(-1), expected.argmax(-1), SUBSTEPS).min(-1)
    hit = first < SUBSTEPS
    assert (contacts.substep[hit, 0] == first[hit]).all()
    assert (contacts.partner[:, 0] >= 0).tolist() == hit.tolist()
    rows = np.flatnonzero(hit)
    assert expected[rows, contacts.partner[rows, 0] - 1, first[rows]].all()


def tracks_of(poses, world):
    """Return tracks of vehicles that touch nothing."""
    worlds, agents, substeps, _ = poses.shape
    return Tracks.allocate(worlds, agents, world.vehicles.capacity, substeps)._replace(poses=poses)


def find(made, tracks=None, rows=EVERYBODY, touches=()):
    """Return the contacts; `touches` are agent, slot, when counted from 1, speed."""
    world = made.world
    tracks = tracks_of(np.zeros((*world.agents.slot.shape, 0, 3)) if tracks is None else tracks, world)
    for agent_id, slot, when, speed in touches:
        tracks.touched[0, agent_id, slot], tracks.touch_speed[0, agent_id, slot] = when, speed
    return FootprintContacts(world).find(tracks, rows)


def moved(cars, moves, touches=()):
    """Return the contacts of a step where cars move evenly by (dx, dy) or (dx, dy, turn); and the world."""
    made = world_of(cars, maps=[maps.straight()])
    world = made.world
    made.advance()
    tracks = np.zeros((*world.agents.slot.shape, SUBSTEPS, 3))
    for slot, (dx, dy, *turn) in enumerate(moves):
        begin = np.array([*world.before.position[0, slot], world.before.heading[0, slot]])
        world.vehicles.position[0, slot] += dx, dy
        world.vehicles.heading[0, slot] += sum(turn)
        for agent_id in np.flatnonzero(world.agents.slot[0] == slot):
            tracks[0, agent_id] = evenly(begin, begin + np.array([dx, dy, sum(turn)]))
    return find(made, tracks, touches=touches), made


EGO = AgentMission()


@pytest.mark.parametrize(
    ("other", "move", "side", "closing_speed"),
    [
        # The ego, 5.0 by 1.8 m, goes 1 m along +x in 0.1 s; the other's length is 5.0 m, too.
        (Car(5.5, 0.5), (0.0, 0.0), FRONT, 10.0),
        (Car(5.5, 0.5), (-0.8, 0.0), FRONT, 18.0),
        (Car(-5.2, -0.5), (1.9, 0.0), REAR, 9.0),
        (Car(0.0, 2.0), (1.0, -0.5), LEFT, 5.0),
        (Car(0.5, -2.0), (1.0, 0.3), RIGHT, 3.0),
        # Crossing from the left: its nose is 0.1 m beside the ego's left side.
        (Car(0.0, 3.5, -math.pi / 2), (0.0, -1.0), LEFT, 10.0),
        # The ego runs into the side of one that crosses ahead of it: 0.9 m half a width away.
        (Car(3.8, 0.0, math.pi / 2), (0.0, 0.6), FRONT, 10.0),
    ],
)
def test_side_and_closing_speed(other, move, side, closing_speed):
    contacts, made = moved([Car(0.0, 0.0, speed=10.0, mission=EGO), other], [(1.0, 0.0), move])
    assert contacts.partner[0, 0] == 1
    assert contacts.partner_generation[0, 0] == made.world.vehicles.generation[0, 1]
    assert contacts.side[0, 0] == side
    assert contacts.closing_speed[0, 0] == pytest.approx(closing_speed)


def test_the_first_of_several_is_the_partner():
    cars = [Car(0.0, 0.0, mission=EGO), Car(5.9, 0.0), Car(5.55, 0.8), Car(30.0, 0.0)]
    contacts, _ = moved(cars, [(1.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)])
    assert contacts.partner[0, 0] == 2
    assert contacts.substep[0, 0] == 5
    assert np.flatnonzero(contacts.touching[0, 0]).tolist() == [1, 2]
    assert contacts.partner[0, 1:].tolist() == [-1, -1, -1]


def test_a_crossing_within_one_step():
    # A motorcycle at 60 m/s passes ahead of the ego's nose: apart at both ends of the step.
    bike = Car(2.0, 3.0, -math.pi / 2, length=1.5, width=0.6)
    contacts, _ = moved([Car(0.0, 0.0, mission=EGO), bike], [(0.0, 0.0), (0.0, -6.0)])
    # Half a width and half a length are 1.65 m: from 3 m it takes the third sub-step to come closer.
    assert contacts.partner[0, 0] == 1
    assert contacts.substep[0, 0] == 2
    assert contacts.side[0, 0] == LEFT
    assert contacts.closing_speed[0, 0] == pytest.approx(60.0)


def test_a_vehicle_that_has_just_come_did_not_move():
    made = world_of([Car(0.0, 0.0, mission=EGO), Car(-20.0, 0.0)], maps=[maps.straight()])
    registry = made.world.registry
    made.advance()
    # Another vehicle takes the slot: it has not driven through the ego from where the old one was.
    registry.dismiss(0, 1)
    assert registry.admit(0, "new", Owner.TRAFFIC, VehicleKind.PASSENGER, 5.0, 1.8) == 1
    made.world.vehicles.position[0, 1] = 20.0, 0.0
    assert find(made, np.zeros((1, 4, SUBSTEPS, 3))).partner[0, 0] == -1
    made.world.vehicles.position[0, 1] = 4.0, 0.0
    contacts = find(made, np.zeros((1, 4, SUBSTEPS, 3)))
    assert contacts.partner[0, 0] == 1
    assert contacts.closing_speed[0, 0] == 0.0


def test_who_is_done_or_waits_has_no_contacts():
    cars = [Car(0.0, 0.0, mission=EGO), Car(4.0, 0.0)]
    made = world_of(cars, maps=[maps.straight()])
    made.world.agents.state[0, 0] = AgentStatus.DONE
    assert find(made).partner[0, 0] == -1


class TestWhatBulletKeptApart:
    """One drives 1 m towards others that stand: 0.1 m in a sub-step."""

    def contacts(self, *gaps, touches=()):
        others = [Car(5.0 + gap, y) for gap, y in zip(gaps, (-1.0, 1.0), strict=False)]
        cars = [Car(0.0, 0.0, mission=EGO), *others]
        return moved(cars, [(1.0, 0.0), *[(0.0, 0.0) for _ in others]], touches)[0]

    @pytest.mark.parametrize("gap", [1.05, 9.0])
    def test_has_touched_though_the_footprints_are_apart(self, gap):
        assert self.contacts(gap).partner[0, 0] == -1
        contacts = self.contacts(gap, touches=[(0, 1, 5, 3.0)])
        assert contacts.partner[0, :2].tolist() == [1, -1]
        assert contacts.substep[0, 0] == 4
        assert contacts.closing_speed[0, 0] == 3.0
        assert contacts.side[0, 0] == FRONT
        assert contacts.touching[0, 0].tolist() == [slot == 1 for slot in range(16)]

    @pytest.mark.parametrize(("speed", "closing_speed"), [(12.0, 12.0), (3.0, 10.0)])
    def test_counts_after_an_earlier_overlap(self, speed, closing_speed):
        """Bullet lets level bodies into each other and parts them in the next sub-step."""
        contacts = self.contacts(0.45, touches=[(0, 1, 6, speed)])
        assert contacts.substep[0, 0] == 4
        assert contacts.closing_speed[0, 0] == pytest.approx(closing_speed)

    def test_came_first_if_within_the_same_substep(self):
        """Bodies that Bullet keeps apart have touched when a sub-step begins."""
        assert self.contacts(0.42, 0.48).partner[0, 0] == 1
        contacts = self.contacts(0.42, 0.48, touches=[(0, 2, 5, 3.0)])
        assert contacts.partner[0, 0] == 2
        assert contacts.substep[0, 0] == 4
        assert contacts.closing_speed[0, 0] == 3.0

    def test_who_takes_the_place_of_the_one_touched_was_not_there(self):
        made = world_of([Car(50.0, 0.0, mission=EGO), Car(190.0, 0.0)], maps=[maps.straight()])
        world, poses = made.world, np.zeros((1, 4, SUBSTEPS, 3))
        poses[0, 0, :, 0] = 50.0
        made.advance()
        assert find(made, poses, touches=[(0, 1, 5, 3.0)]).partner[0, 0] == 1
        world.vehicles.generation[0, 1] += 1
        assert find(made, poses, touches=[(0, 1, 5, 3.0)]).partner[0, 0] == -1
        # It may be touched by itself, but not as fast as the one before.
        world.vehicles.position[0, 1, 0] = 54.0
        contacts = find(made, poses, touches=[(0, 1, 5, 3.0)])
        assert (contacts.partner[0, 0], contacts.closing_speed[0, 0]) == (1, 0.0)
