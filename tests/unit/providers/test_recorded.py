"""The traffic engine Recorded, on a straight road and on recordings by hand."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import shapely
import shapely.affinity

from smarts.geometry.binding import bind
from smarts.geometry.boxes import boxes_overlap
from smarts.providers.recorded.engine import NAME, Recorded
from smarts.providers.recorded.state import Entry
from smarts.recordings.gaps import gap_on_path
from smarts.recordings.log import make_log
from smarts.types.episode import EpisodeStart
from smarts.types.recorded import RecordedTraffic
from smarts.types.traffic import TrafficFiles
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World
from tests.maps import straight as road
from tests.tracks import straight, track_of, tracks_of

ROADS = road(3, 600.0)
CAPACITY = 64


class Play:
    """Simulations of recordings on one road."""

    def __init__(self, folder, worlds=1, dt=0.1):
        self.folder, self.files = folder, itertools.count()
        self.world = World(worlds=worlds, capacity=CAPACITY, agents=0, lanes=len(ROADS.lane_ids), dt=dt)
        self.vehicles = self.world.vehicles
        self.engine = Recorded(self.world, [ROADS])

    def log(self, tracks, begin=0.0, end=math.inf):
        file = Path(self.folder, f"{next(self.files)}.npz")
        made = tracks_of(tracks) if isinstance(tracks, list) else tracks
        make_log(made, ROADS, begin, end).save(file)
        return file

    def reset(self, *logs, mode="log", begin=0.0, agents=(), rows=None, limit=CAPACITY):
        """Begin an episode of a log in each row; agents' vehicles are (x, y) or (x, y, speed), in all."""
        rows = range(len(logs)) if rows is None else rows
        starts = {}
        for row, log in zip(rows, logs, strict=True):
            self.world.clear(row)
            for x, y, *speed in agents:
                self.put(row, x, y, *speed)
            traffic = TrafficFiles(Path("none"), recording=RecordedTraffic(log, mode, begin, begin))
            starts[row] = EpisodeStart(1, 0, 0, "road", 0, traffic, "recorded", 1, limit, ())
        self.engine.reset(starts)

    def put(self, row, x, y, speed=0.0):
        slot = self.world.registry.admit(row, "agent", Owner.AGENT, VehicleKind.PASSENGER, 5.0, 1.8)
        self.vehicles.position[row, slot] = x, y
        self.vehicles.speed[row, slot] = speed
        return slot

    def step(self, count=1, rows=None):
        mask = np.ones(self.world.worlds, bool) if rows is None else np.array(rows)
        for _ in range(count):
            self.world.advance(mask)
            self.engine.step(mask)

    def slot(self, name, row=0):
        return self.world.registry.slot(row, NAME + name)

    def state(self, name, row=0):
        """Return x, y, heading and speed of a recorded vehicle, None if it is not there."""
        slot, v = self.slot(name, row), self.vehicles
        if slot < 0:
            return None
        return np.array([*v.position[row, slot], v.heading[row, slot], v.speed[row, slot]])

    def content(self, row):
        names = [self.world.registry.name(row, slot) for slot in range(CAPACITY)]
        return [column[row].tobytes() for column in self.vehicles], names


@pytest.fixture
def play(tmp_path):
    return Play(tmp_path)


def wanderer(name, begin, seed, dt=0.2, samples=40):
    """Return the track of a vehicle with a changing speed and heading, through a heading of pi."""
    draws = np.random.default_rng(seed)
    t = begin + dt * np.arange(samples)
    speed = 8.0 + np.cumsum(draws.uniform(-0.3, 0.3, samples))
    heading = 2.8 + np.linspace(0.0, 0.8, samples)
    steps = dt * speed[:-1, None] * np.stack([np.cos(heading), np.sin(heading)], -1)[:-1]
    xy = np.array([500.0, 1.0]) + np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])
    wrapped = np.arctan2(np.sin(heading), np.cos(heading))
    return track_of(name, np.column_stack([t, xy, wrapped, speed]))


@pytest.mark.parametrize("dt", [0.03, 0.1, 0.25])
def test_poses_are_interpolated_between_the_logs_times(tmp_path, dt):
    play = Play(tmp_path, dt=dt)
    play.reset(play.log([straight("a", 0.0, 20.0, 10.0, 0.0, 10.0, dt=0.2)]))
    for step in range(int(20.0 / dt)):
        x, y, heading, speed = play.state("a")
        assert x == pytest.approx(10.0 + 10.0 * step * dt, abs=1e-9)
        assert (y, heading, speed) == pytest.approx((0.0, 0.0, 10.0), abs=1e-9)
        play.step()


def test_at_the_logs_times_poses_are_those_of_the_log_from_entry_to_exit(play):
    tracks = [wanderer("a", 0.0, 1), wanderer("b", 3.0, 2), wanderer("c", 5.0, 3, samples=20)]
    play.reset(play.log(tracks))
    for step in range(140):
        for name, _, _, _, samples in tracks:
            t = 0.1 * step
            is_there = samples[0, 0] - 1e-9 <= t <= samples[-1, 0] + 1e-9
            found = play.state(name)
            assert (found is not None) == is_there, (name, t)
            at = np.flatnonzero(np.abs(samples[:, 0] - t) < 1e-9)
            if is_there and len(at):
                assert np.abs(found - samples[at[0], 1:]).max() < 1e-9
            elif is_there:
                rows = np.flatnonzero(np.abs(samples[:, 0] - t) < 0.11)
                middle = samples[rows, 1:3].mean(axis=0)
                assert np.abs(found[:2] - middle).max() < 1e-9
        play.step()


def test_an_episode_that_begins_later_has_the_vehicles_of_that_time(play):
    log = play.log([straight("a", 0.0, 5.0, 0.0, 0.0, 10.0), straight("b", 2.0, 9.0, 0.0, 3.2, 10.0)])
    play.reset(log, begin=4.05)
    assert play.state("a")[0] == pytest.approx(40.5)
    assert play.state("b")[0] == pytest.approx(20.5)
    play.step(10)
    assert play.state("a") is None
    assert play.state("b")[0] == pytest.approx(30.5)


def test_vehicles_do_not_enter_onto_others(play):
    tracks = [straight("late", 1.0, 5.0, 20.0, 0.0, 10.0), straight("never", 1.0, 2.0, 22.0, 3.2, 1.0)]
    tracks += [straight("twin", 1.0, 5.0, 100.0, 6.4, 5.0), straight("twin2", 1.0, 5.0, 101.0, 6.4, 5.0)]
    play.reset(play.log(tracks), agents=[(20.0, 0.0), (22.0, 3.2)])
    play.step(12)
    assert [play.state(each) is not None for each in ("late", "never", "twin", "twin2")] == [0, 0, 1, 0]
    sim, entry = play.engine.sims[0], play.engine._traffic.value.entry[0]
    assert ((entry == Entry.DELAYED).sum(), sim["held_back"]) == (3, 3)
    play.world.registry.dismiss(0, 0)
    play.step()
    assert play.state("late")[0] == pytest.approx(23.0)
    play.step(20)
    assert (entry == Entry.DELAYED).sum() == 1
    assert play.state("never") is None


def test_vehicles_at_the_place_of_an_agent_at_the_begin_never_come(play, caplog):
    play.reset(play.log([straight("a", 0.0, 9.0, 0.0, 0.0, 10.0)]), begin=2.0, agents=[(21.0, 0.0)])
    assert play.engine.sims["held_back"][0] == 1
    play.world.registry.dismiss(0, 0)
    play.step(5)
    assert play.state("a") is None
    with caplog.at_level("INFO", "smarts"):
        play.reset(play.log([straight("a", 0.0, 9.0, 0.0, 0.0, 10.0)]))
    assert [each.args for each in caplog.records] == [(1,)]


def dense(count=40):
    """Return tracks of vehicles that follow each other closely, some of them side by side."""
    draws = np.random.default_rng(5)
    found = []
    for number in range(count):
        track = wanderer(str(number), 0.3 * number, number, samples=60)
        samples = track.samples.copy()
        samples[:, 3] -= 2.8
        samples[:, 1] = 20.0 + np.cumsum(np.append(0.0, 0.2 * samples[:-1, 4]))
        samples[:, 2] = 3.2 * (number % 3) + draws.uniform(-0.3, 0.3)
        samples[:, 3] = 0.0
        found.append(track._replace(samples=samples))
    return found


def test_reactive_traffic_that_is_not_disturbed_is_the_log(tmp_path):
    plays = [Play(tmp_path / mode) for mode in ("log", "reactive")]
    for play, mode in zip(plays, ("log", "reactive"), strict=True):
        play.folder.mkdir()
        play.reset(play.log(tracks_of([*dense(), straight("long", 0.0, 40.0, 0.0, 40.0, 1.0)])), mode=mode)
    for _ in range(150):
        for play in plays:
            play.step()
        assert plays[0].content(0) == plays[1].content(0)
    assert plays[0].vehicles.alive.sum() > 20


def oracle(gap, speed, headway=1.0, dt=0.1):
    """Return the least gap to a standing vehicle of a driver who brakes, by the equations in plain Python."""
    lowest, is_on_log = gap, True
    for _ in range(150):
        wanted = 2.0 + speed * headway + speed * speed / (2.0 * math.sqrt(2.0 * 3.0))
        allowed = 2.0 * (1.0 - (wanted / max(gap, 1e-3)) ** 2)
        is_on_log &= allowed >= 0.0
        if not is_on_log:
            speed = max(0.0, speed + dt * min(2.0, max(-8.0, allowed)))
        gap -= speed * dt
        lowest = min(lowest, gap)
    return lowest


def test_a_vehicle_brakes_for_a_standing_agent_as_the_equations_say(tmp_path):
    gaps = [*np.linspace(10.0, 22.0, 13), 40.0, 80.0]
    play = Play(tmp_path, worlds=len(gaps))
    log = play.log([straight("a", 0.0, 30.0, 0.0, 0.0, 15.0)])
    play.reset(*[log] * len(gaps), mode="reactive", begin=1.0)
    slots = [play.put(row, 15.0 + 5.0 + gap, 0.0) for row, gap in enumerate(gaps)]
    lowest = np.full(len(gaps), np.inf)
    for _ in range(150):
        play.step()
        for row, slot in enumerate(slots):
            front = play.vehicles.position[row, play.slot("a", row), 0] + 5.0
            lowest[row] = min(lowest[row], play.vehicles.position[row, slot, 0] - front)
    assert lowest == pytest.approx([oracle(gap, 15.0) for gap in gaps], abs=0.02)
    assert (lowest < 0).any()
    assert (lowest > 0).any()


def test_a_vehicle_that_was_held_up_comes_back_on_schedule_and_its_follower_too(play):
    tracks = [straight("a", 0.0, 45.0, 0.0, 0.0, 12.0), straight("b", 3.0, 48.0, 0.0, 0.0, 12.0)]
    play.reset(play.log(tracks), mode="reactive", begin=3.0)
    agent = play.put(0, 80.0, 0.0)
    play.step(60)
    late = 12.0 * 9.0 - play.state("a")[0]
    assert late > 20.0
    assert play.state("b")[0] < play.state("a")[0] - 5.0
    play.world.registry.dismiss(0, agent)
    play.step(340)
    for name, begin in (("a", 0.0), ("b", 3.0)):
        assert play.state(name)[0] == pytest.approx(12.0 * (43.0 - begin), abs=1e-9)


def test_a_late_vehicle_and_those_beside_it_give_way_to_each_other_where_it_changes_lanes(tmp_path):
    t = np.arange(0.0, 30.0, 0.2)
    y = 3.2 * np.clip((t - 7.0) / 2.5, 0.0, 1.0)
    rows = np.column_stack([t, 10.0 * t, y, np.arctan2(np.gradient(y), 2.0), np.full(len(t), 10.0)])
    begins = np.arange(-2.5, 4.0, 0.5)
    play = Play(tmp_path, worlds=len(begins))
    beside = [straight("b", begin + 2.5, begin + 32.5, 0.0, 3.2, 12.0) for begin in begins]
    play.reset(*(play.log([track_of("a", rows), other]) for other in beside), mode="reactive")
    agents = [play.put(row, 60.0, 0.0) for row in range(len(begins))]
    hits = np.zeros(len(begins), bool)
    for step in range(200):
        play.step()
        for row in range(len(begins)):
            if step == 50:
                play.world.registry.dismiss(row, agents[row])
            if play.slot("a", row) >= 0 and play.slot("b", row) >= 0:
                one, other = play.state("a", row), play.state("b", row)
                size = np.array([5.0, 1.8])
                hits[row] |= boxes_overlap(one[:2], one[2], size, other[:2], other[2], size)
    assert not hits.any()


def test_a_vehicle_does_not_brake_for_one_that_comes_from_behind(play):
    play.reset(play.log([straight("a", 0.0, 20.0, 0.0, 0.0, 10.0)]), mode="reactive")
    for _ in range(20):
        play.step()
    play.put(0, 8.0, 0.0, 25.0)
    play.step()
    assert play.state("a")[0] == pytest.approx(21.0, abs=1e-9)


def test_a_track_that_the_end_of_the_recording_cuts_off_drives_on_along_its_lane(play):
    tracks = [straight("a", 0.0, 10.0, 0.0, 0.5, 12.0), straight("b", 0.0, 8.0, 100.0, 3.2, 10.0)]
    log = play.log(tracks)
    play.reset(log, mode="reactive")
    play.step(130)
    assert play.state("b") is None
    x, y, heading, speed = play.state("a")
    assert x > 150.0
    assert abs(y) < 0.1
    assert abs(heading) < 0.1
    assert 12.0 < speed <= 14.0
    play.step(350)
    assert play.state("a") is None
    play.reset(log, mode="log")
    play.step(101)
    assert play.state("a") is None


def give_back(play, name, offset, heading=0.0):
    slot = play.slot(name)
    play.vehicles.owner[0, slot] = Owner.AGENT
    play.step(3)
    play.vehicles.position[0, slot, 1] = offset
    play.vehicles.heading[0, slot] = heading
    rows, slots = np.zeros(1, np.int32), np.array([slot], np.int32)
    answer = play.engine.can_accept(rows, slots)[0]
    play.vehicles.owner[0, slot] = Owner.TRAFFIC
    return slot, answer


@pytest.mark.parametrize("mode", ["log", "reactive"])
def test_a_vehicle_that_is_given_back_near_its_path_comes_back_to_it_without_a_jump(play, mode):
    play.reset(play.log([straight("a", 0.0, 40.0, 0.0, 0.3, 12.0)]), mode=mode)
    play.step(10)
    slot, answer = give_back(play, "a", 0.3 + 1.4, heading=0.15)
    assert answer == Refusal.NONE
    v, positions, headings = play.vehicles, [], []
    for _ in range(200):
        positions.append(v.position[0, slot].copy())
        headings.append(v.heading[0, slot])
        play.step()
    moved = np.diff(positions, axis=0)
    assert np.abs(np.diff(headings)).max() < 0.08
    assert np.abs(np.arctan2(moved[:, 1], moved[:, 0]) - headings[1:]).max() < 0.05
    assert np.hypot(*moved.T).max() < 0.1 * 16.0
    assert play.state("a")[:2] == pytest.approx([12.0 * play.world.time[0], 0.3], abs=1e-9)


def test_a_vehicle_that_is_given_back_far_from_its_path_follows_the_lane_there(play):
    play.reset(play.log([straight("a", 0.0, 40.0, 0.0, 0.0, 12.0)]), mode="reactive")
    play.step(10)
    _, answer = give_back(play, "a", 3.2 + 1.2)
    assert answer == Refusal.NONE
    play.step(60)
    assert play.state("a")[1] == pytest.approx(3.2, abs=0.05)
    play.step(500)
    assert play.state("a") is None
    play.reset(play.log([straight("a", 0.0, 40.0, 0.0, 0.0, 12.0)]), mode="reactive")
    play.step(10)
    assert give_back(play, "a", 3.2 + 1.2, heading=0.4)[1] == Refusal.HEADING
    play.reset(play.log([straight("a", 0.0, 40.0, 0.0, 0.0, 12.0)]), mode="reactive", agents=[(80.0, 0.0)])
    play.step(3)
    slot = play.slot("a")
    play.vehicles.position[0, slot, 0] = 71.0
    play.vehicles.speed[0, slot] = 12.0
    play.vehicles.owner[0, slot] = Owner.AGENT
    play.step()
    assert play.engine.can_accept(np.zeros(1, np.int32), np.array([slot], np.int32)) == [Refusal.SPEED]


def test_a_stranger_follows_the_lane_that_it_is_on(play):
    play.reset(play.log([straight("a", 0.0, 40.0, 0.0, 0.0, 12.0)]), agents=[(50.0, 6.0, 5.0)])
    play.step()
    play.vehicles.owner[0, 0] = play.vehicles.home[0, 0] = Owner.TRAFFIC
    play.step(50)
    assert play.vehicles.position[0, 0, 1] == pytest.approx(6.4, abs=0.05)
    assert play.vehicles.position[0, 0, 0] > 80.0
    assert play.world.routes.edges(0, play.vehicles.route[0, 0]).tolist() == [0]


def test_a_row_does_not_depend_on_other_rows_and_their_resets(tmp_path):
    (tmp_path / "both").mkdir()
    (tmp_path / "alone").mkdir()
    both, alone = Play(tmp_path / "both", 2), Play(tmp_path / "alone")
    stranger = [(300.0, 6.0, 5.0)]
    both.reset(*[both.log(dense())] * 2, mode="reactive", agents=stranger)
    alone.reset(alone.log(dense()), mode="reactive", agents=stranger)
    for step in range(120):
        if step == 20:
            for play in (both, alone):
                play.vehicles.owner[:, 0] = Owner.TRAFFIC
        if step == 40:
            both.reset(both.log([straight("x", 0.0, 9.0, 0.0, 0.0, 9.0)]), rows=[1])
        both.step()
        alone.step()
        assert both.content(0) == alone.content(0)


def test_what_enters_is_there_has_left_or_is_taken(play):
    play.reset(play.log(dense()), mode="reactive", agents=[(90.0, 0.0)])
    seen = set()
    for step in range(200):
        play.step()
        names = {play.world.registry.name(0, slot) for slot in np.flatnonzero(play.vehicles.alive[0])}
        seen |= names - {"agent"}
        if step == 60:
            play.vehicles.owner[0, play.slot("3")] = Owner.AGENT
    to_come = (play.engine._traffic.value.entry[0] != Entry.DONE).sum()
    assert len(seen) + to_come == 40
    assert NAME + "3" in names


def test_the_gap_on_a_path_is_that_between_outlines():
    paths = make_log(tracks_of([straight("a", 0.0, 10.0, 0.0, 0.0, 10.0)]), ROADS).paths
    measure, draws = bind(gap_on_path, paths), np.random.default_rng(2)
    corridor = shapely.box(20.0, -1.0, 20.0 + 70.0, 1.0)
    for _ in range(200):
        x, y, heading = draws.uniform(25.0, 80.0), draws.uniform(-6.0, 6.0), draws.uniform(-3.0, 3.0)
        box = shapely.affinity.rotate(
            shapely.box(x - 2.5, y - 0.9, x + 2.5, y + 0.9), heading, use_radians=True
        )
        found, cosine = measure(0, 20.0, 2.5, 0.9, 70.0, (x, y, heading), 2.5, 0.9)
        if not box.intersects(corridor):
            assert found == np.inf
            continue
        assert cosine == pytest.approx(math.cos(heading))
        assert found == pytest.approx(box.bounds[0] - 22.5)


def test_headways_are_the_tracks_own():
    def headway(behind, speed=10.0, seconds=10.0, leader=10.0):
        ahead = straight("ahead", 0.0, seconds, behind, 0.0, leader)
        return make_log(tracks_of([straight("own", 0.0, seconds, 0.0, 0.0, speed), ahead]), ROADS)

    names = headway(20.0).names
    found = dict(zip(names, headway(20.0).paths.headway, strict=True))
    assert found["own"] == pytest.approx(1.3)  # 15 m of gap, of which 2 m are those when standing
    assert found["ahead"] == 1.0
    assert headway(9.0).paths.headway[names.index("own")] == 0.5
    assert headway(38.0).paths.headway[names.index("own")] == 2.0
    # The gap grows from 12 to 22 m; half a second after the begin it is 12.5 m.
    assert headway(17.0, leader=11.0).paths.headway[names.index("own")] == pytest.approx(1.05)


def test_pedestrians_stay_on_their_log_and_vehicles_brake_for_what_stands(play):
    size = {"length": 0.3, "width": 0.5}
    walker = straight("walker", 0.0, 18.0, 100.0, 0.0, 1.0, kind=VehicleKind.PEDESTRIAN, **size)
    cyclist = straight("cyclist", 0.0, 18.0, 60.0, 3.2, 3.0, kind=VehicleKind.BICYCLE, **size)
    play.reset(play.log([walker, cyclist]), mode="reactive", agents=[(110.0, 0.0), (110.0, 3.2)])
    for step in range(181):
        assert play.state("walker")[0] == pytest.approx(100.0 + 0.1 * step)  # through the standing car
        play.step()
    assert 107.5 - 5.0 < play.state("cyclist")[0] < 107.5
    assert play.state("walker") is None  # vehicles that the recording cuts off drive on
    kinds = play.vehicles.kind[0][play.vehicles.alive[0]].tolist()
    assert VehicleKind.BICYCLE in kinds
