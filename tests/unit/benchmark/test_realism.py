"""Realism, by hand and against recordings whose drivers are known."""

import math
import sys

import numpy as np
import pytest

import perf.recorded_brakes
from benchmark.metrics.realism import BINS, LEAST_SCENES, Features, collides, log_likelihoods, realism
from benchmark.running.realism import measure_realism
from benchmark.running.recorded_windows import idm, noisy_speed, play_engine, windows_of
from smarts.recordings.log import Log, make_log
from smarts.recordings.tracks import write_tracks
from smarts.sstudio.build import build_scenario
from smarts.types.vehicles import VehicleKind
from tests.maps import straight as road
from tests.tracks import straight, track_of, tracks_of
from tests.unit.benchmark.untrained import write_untrained
from tests.unit.sstudio.sources import scenario, write_cross

CAR = np.array([5.0, 2.0])
INSTANTS = 51


def driving(x, y, speed):
    """Return poses of a vehicle that drives east, shape (1, T, 4)."""
    along = x + speed * 0.1 * np.arange(INSTANTS)
    return np.stack([along, *(np.full(INSTANTS, each) for each in (y, 0.0, speed))], axis=-1)[None]


def test_likelihood_of_two_bins_by_hand():
    values = {name: np.full((2, 8), edges[0]) for name, edges in BINS.items()}
    simulated = values | {"speed": np.array([[3.0] * 8, [7.0] * 8])}
    found = log_likelihoods(values | {"speed": np.full((1, 8), 3.0)}, simulated)
    # One of 33 parts is spread over the 41 bins of speeds; half of the others is in the logged bin.
    assert math.exp(found[0]) == pytest.approx(32 / 33 / 2 + 1 / 33 / 41)
    assert math.exp(found[-1]) == pytest.approx(32 / 33 + 1 / 33 / 21)
    simulated["speed"][1, 4:] = np.nan  # it is no longer there: 8 of 12 are left in the logged bin
    found = log_likelihoods(values | {"speed": np.full((1, 8), 3.0)}, simulated)
    assert math.exp(found[0]) == pytest.approx(32 / 33 * 8 / 12 + 1 / 33 / 41)


def test_realism_is_the_mean_of_the_features_and_needs_scenes():
    likelihoods = np.log(np.tile([0.5, 0.1, 0.2, 0.4, 1.0, 0.2], (LEAST_SCENES, 1)))
    found = realism(likelihoods)
    assert [found["realism"], found["low"], found["high"], found["speed"]] == pytest.approx([0.4] * 3 + [0.5])
    assert math.isnan(realism(likelihoods[1:])["realism"])


def test_features_by_hand():
    features = Features(road(2, 400.0))
    other = [driving(25.0, 0.0, 7.0), driving(10.0, 3.2, 7.0), np.full((1, INSTANTS, 4), np.nan)]
    others = features.motion(np.stack(other, axis=2), np.tile(CAR, (3, 1)))
    own = features.motion(driving(5.0, 0.5, 10.0), CAR)
    found = features.measure(own, others)
    # The leader is 20 m ahead, bumper to bumper 15 m, and 3 m/s slower; the vehicle on the left is none.
    assert found["leader_gap"][0, [0, 10]] == pytest.approx([15.0, 12.0])
    assert found["time_to_collision"][0, [0, 10]] == pytest.approx([5.0, 4.0])
    assert found["lane_offset"] == pytest.approx(0.5)
    bent = driving(5.0, 0.5, 10.0)
    bent[..., 2:] += np.arange(INSTANTS)[:, None] * (0.01, 0.2)  # 0.1 rad/s, 2 m/s^2
    changes = features.measure(features.motion(bent, CAR), others)
    assert changes["acceleration"].shape == (1, INSTANTS - 5)
    assert changes["acceleration"] == pytest.approx(2.0)
    assert changes["yaw_rate"] == pytest.approx(0.1)
    gone = np.where(np.arange(INSTANTS)[:, None] > 20, np.nan, driving(5.0, 0.5, 10.0))
    for name, until in features.measure(features.motion(gone, CAR), others).items():
        is_there = np.arange(until.shape[1]) <= 20 - (INSTANTS - until.shape[1])
        np.testing.assert_array_equal(until, np.where(is_there, found[name], np.nan), err_msg=name)
    for speed, hits in ((9.9, False), (10.1, True)):  # 15 m in 5 s are 3 m/s
        assert collides(features.motion(driving(5.0, 0.5, speed), CAR), others).tolist() == [hits]


def test_scenes_of_a_vehicle_follow_each_other():
    tracks = [straight("a", 0.0, 12.0, 0.0, 0.0, 10.0), straight("b", 1.5, 9.0, 0.0, 3.2, 10.0)]
    log = make_log(tracks_of(tracks), road(2, 400.0))
    scenes = [[log.names[each.tracks[column]] for column in each.scenes] for each in windows_of(log, 0.0)]
    assert scenes == [["a"], ["b"], ["a"]]
    assert [each.begin for each in windows_of(log, 0.0)] == [0.0, 2.0, 5.0]


def test_floors_by_hand():
    """The intelligent driver model brakes behind a slow leader; random accelerations last for 0.5 s."""
    tracks = [straight("own", 0.0, 5.0, 0.0, 0.0, 10.0), straight("leader", 0.0, 5.0, 30.0, 0.0, 3.0)]
    roads = road(1, 400.0)
    log = make_log(tracks_of(tracks), roads)
    (window,) = windows_of(log, 0.0)
    own, leader = (window.tracks.index(log.names.index(name)) for name in ("own", "leader"))
    pose = idm(log, window, own, roads)[0]
    assert (window.pose[:, leader, 0] - pose[:, 0]).min() > 5.0 + 2.0
    assert pose[-1, 3] < 6.0
    speed = noisy_speed(log, window, own, roads, 400)[..., 3]
    changes = (np.diff(speed) / 0.1).reshape(400, 10, 5)
    assert np.ptp(changes, axis=2).max() < 1e-9
    assert (changes.mean(), changes.std()) == (pytest.approx(0, abs=0.02), pytest.approx(0.3, abs=0.02))


TRAINED = """
algorithms: [ppo]
tasks: [loop]
traffic: [no_social_vehicles]
environment: {agents: 2}
settings: {ppo: {sharing: all, hidden: [8, 8]}}
"""


@pytest.fixture(scope="module")
def steady_and_changing(tmp_path_factory):
    """Return scenarios whose vehicles keep their speeds, change them, or drive over a pedestrian."""
    t = np.arange(0.0, 20.0, 0.1)
    speed = 8.0 + 3.0 * np.sin(t)
    x = -100.0 + 8.0 * t + 3.0 * (1.0 - np.cos(t))
    wave = [
        track_of(str(each), np.column_stack([t + 4.0 * each, x, 0 * t - 4.8, 0 * t, speed]))
        for each in range(12)
    ]
    steady = [straight(str(each), 4.0 * each, 4.0 * each + 16.0, -100.0, -4.8, 10.0) for each in range(12)]
    standing = straight("standing", 0.0, 60.0, -40.0, -4.8, 0.0, kind=VehicleKind.PEDESTRIAN)
    found = []
    for tracks in (steady, wave, [*steady, standing]):
        folder = tmp_path_factory.mktemp("scenario") / "recorded"
        write_cross(folder)
        body = 'traffic={"recorded": t.Traffic([], engine="Recorded", recording=t.Recording("recording"))}'
        folder.joinpath("scenario.py").write_text(scenario(body))
        write_tracks(tracks_of(tracks), folder / "recording")
        found.append(str(folder))
    return found


def by_name(*args, **given):
    rows = [*measure_realism(*args, **given)]
    assert {row.pop("traffic") for row in rows} == {"recorded"}
    return {row.pop("driver"): row for row in rows}


def test_what_drives_as_recorded_scores_as_the_log(steady_and_changing):
    name = "smarts.zoo:non-interactive-v0"  # drives 10 m/s in its lane
    found = by_name(steady_and_changing[0], policies=[name], rollouts=2)
    log, constant, agent = found["log"], found["constant speed"], found[name]
    assert log["scenes"] == agent["scenes"] >= LEAST_SCENES
    assert (log["displacement"], log["collisions"]) == (0.0, 0.0)
    assert constant == pytest.approx(log)
    assert agent["displacement"] < 0.2
    assert agent["realism"] == pytest.approx(log["realism"], abs=0.02)


def test_vehicles_of_sumo_depart_at_their_recorded_speed(steady_and_changing):
    built = build_scenario(steady_and_changing[0])
    log = Log.load(built.traffic["recorded"].recording.log)
    window = next(windows_of(log, 0.0))
    (pose,) = play_engine("SUMO", log, [window], built.roads(), built.net_file, 1)
    assert pose[0, 0, window.scenes, 3] == pytest.approx(10.0, abs=0.01)


def test_an_agent_drives_on_after_a_collision(steady_and_changing):
    name = "smarts.zoo:non-interactive-v0"
    found = by_name(steady_and_changing[2], policies=[name], engines=[], rollouts=1)
    assert found[name]["collisions"] > 0.3
    assert found[name]["displacement"] < 0.2


def test_a_run_drives_alone_whatever_it_was_trained_on(steady_and_changing, tmp_path):
    _, folder = write_untrained(tmp_path, TRAINED)
    policy = str(folder.path)
    found = by_name(steady_and_changing[0], policies=[policy], engines=[], rollouts=1)
    assert found[policy]["scenes"] == found["log"]["scenes"]


def test_the_log_is_the_ceiling(steady_and_changing):
    found = by_name(steady_and_changing[1], rollouts=2)
    log = found.pop("log")
    assert found["SUMO"]["scenes"] >= LEAST_SCENES
    for driver in found.values():
        assert driver["high"] < log["low"]
        assert all(driver[name] <= log[name] + 1e-9 for name in BINS)
        assert driver["displacement"] > 0.5


def test_collisions_of_a_braking_agent_are_the_oracles(steady_and_changing, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["recorded_brakes", steady_and_changing[0]])
    perf.recorded_brakes.main()
    log, difference, reactive = capsys.readouterr().out.splitlines()
    assert int(log.split()[3]) > 10, log
    assert difference == "they differ in 0"
    assert int(reactive.split()[3]) == 0
