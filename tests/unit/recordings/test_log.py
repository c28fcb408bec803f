"""Logs: parts of recordings on a map."""

import numpy as np
import pytest

from smarts.recordings.log import Log, lane_path, make_log
from smarts.recordings.tracks import RecordingError
from smarts.sstudio.build import build_scenario
from tests import maps
from tests.tracks import straight, track_of, tracks_of

ROADS = maps.straight(3, 400.0)


def test_a_part_of_a_recording_has_nothing_from_outside_it():
    tracks = tracks_of([straight("a", 0.0, 10.0, 0.0, 0.0, 10.0), straight("b", 7.0, 12.0, 0.0, 3.2, 10.0)])
    log = make_log(tracks, ROADS, 2.05, 6.5)
    assert log.names == ("a",)
    assert log.paths.t[0] == 2.05
    assert log.paths.t[-1] == 6.5
    assert log.paths.x[[0, -1]] == pytest.approx([20.5, 65.0])
    early, late = make_log(tracks, ROADS, end=6.0).paths.t, make_log(tracks, ROADS, 6.0).paths.t
    assert early.max() == 6.0 == late.min()
    with pytest.raises(RecordingError, match="no vehicle is recorded from 20 to 30 s"):
        make_log(tracks, ROADS, 20.0, 30.0)


def test_a_path_has_no_scribble_of_a_standing_vehicle_and_no_way_back():
    draws = np.random.default_rng(3)
    t = np.arange(0.0, 30.0, 0.1)
    x = np.concatenate([np.arange(100) * 0.5, np.full(100, 49.5), 49.5 - np.arange(20) * 0.1])
    x = np.concatenate([x, 47.6 + np.arange(80) * 0.5])
    noise = np.where((x > 47.0) & (x < 50.0), draws.normal(0.0, 0.05, 300), 0.0)
    samples = np.column_stack([t, x + noise, noise, 0.0 * t, np.gradient(x, t)])
    paths = make_log(tracks_of([track_of("a", samples)]), ROADS).paths
    assert (np.diff(paths.s) >= 0).all()
    assert (np.diff(paths.point_s) > 0.15).all()
    assert paths.s[-1] == pytest.approx(x[-1], abs=0.3)


def test_the_pace_of_a_place_is_the_speed_that_is_reached_within_ten_metres():
    t = np.arange(0.0, 10.0, 0.1)
    samples = np.column_stack([t, 5 * t + 0.5 * t**2, 0 * t, 0 * t, 5 + t])
    paths = make_log(tracks_of([track_of("a", samples)]), ROADS, end=9.0).paths
    s = paths.point_s[paths.point_s < 60.0]
    assert paths.point_pace[: len(s)] == pytest.approx(np.sqrt(25 + 2 * (s + 10)), abs=0.11)


def test_a_log_is_read_as_it_was_written(tmp_path):
    tracks = [straight("a", 0.0, 9.0, 0.0, 0.0, 10.0), straight("b", 9.5, 12.0, 0.0, 3.2, 10.0)]
    tracks += [straight("out", 1.0, 2.0, 0.0, 90.0, 3.0)]
    log = make_log(tracks_of(tracks), ROADS)
    log.save(tmp_path / "log.npz")
    read = Log.load(tmp_path / "log.npz")
    assert read.names == log.names == ("a", "out", "b")
    assert read.routes == log.routes == ((0,), (), (0,))
    assert read.most_at_once() == 2
    for name, column in log.paths._asdict().items():
        assert np.array_equal(column, getattr(read.paths, name)), name


def test_routes_lead_through_junctions():
    roads = maps.crossing()
    track = straight("a", 0.0, 10.0, -60.0, -1.6, 12.0)
    (route,) = make_log(tracks_of([track]), roads).routes
    assert len(route) == 2
    assert roads.edge_to[route[0]] == roads.edge_from[route[1]]


def test_vehicles_slow_down_before_bends_of_lanes():
    roads = build_scenario("intersection").roads()
    for lane in range(len(roads.lane_ids)):
        path = lane_path(roads, lane)
        apart, turned = np.diff(path.point_s), np.abs(np.diff(path.point_turn))
        assert apart.min() > 0.1
        bend = np.interp(path.point_s, path.point_s[1:], turned / apart)
        assert (path.point_pace**2 * bend).max() < 6.0
        assert (np.diff(path.point_pace**2) > -2.0 * 2.0 * apart - 1e-6).all()
