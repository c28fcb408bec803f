"""Compact episodes against the recordings that they are made of."""

import numpy as np
import pytest
import shapely

from smarts.envision.compact_episode import compact_episode
from smarts.sim.episode_files import RecordedEpisode
from smarts.stream.arrays import unpacked_array, unpacked_runs
from smarts.stream.motion import AIR_LOCK, COLLIDED, LEAVING, OWNER_BITS
from smarts.stream.road_map import CENTRE, EDGE, map_message, origin_of
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Event, Outcome
from smarts.types.traffic import Signal
from smarts.types.vehicles import Owner
from tests.compact_fixtures import FOLDER
from tests.compact_reading import CompactEpisode
from tests.maps import straight
from tests.recordings import Drive, at_speed, at_speeds, record

LONG = 250


@pytest.fixture(scope="module")
def graph():
    return straight(length=900.0)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory, graph):
    lane = graph.lane_ids[0]
    drives = [
        Drive([lane], at_speed(2.0, LONG, 10.0), agent="ego", outcome=Outcome.COLLISION, partner=1),
        Drive([lane], at_speeds([10.0] * 60 + [9.5, 8.0, 6.0, 6.0], 40.0), begin=20),
    ]
    drives[0].decisions = [{"step": step, "is_effective": True} for step in (20, 40)]
    drives[0].agents = {"events": np.where(np.arange(LONG + 1) == 60, int(Event.COLLISION), 0)}
    tables = {"signals": [dict(step=5, lane=0, signal=int(Signal.GO)), dict(step=120, lane=0, signal=1)]}
    folder = record(tmp_path_factory.mktemp("recorded"), graph, drives, tables=tables)
    return RecordedEpisode(folder)


def test_every_row_is_there_to_the_centimetre(recorded):
    episode, rows = CompactEpisode(compact_episode(recorded)), recorded.table("vehicles")
    motion, vehicles = episode.motion, episode.vehicles
    assert episode.is_whole
    order = np.lexsort((rows["step"], rows["slot"]))
    slot = vehicles["slot"][np.searchsorted(vehicles["number"], motion.number)]
    found = np.lexsort((motion.step, slot))
    np.testing.assert_array_equal(motion.step[found], rows["step"][order])
    np.testing.assert_array_equal(slot[found], rows["slot"][order])
    for axis, name in enumerate("xy"):
        off = getattr(motion, name)[found] / 100 + episode.origin[axis] - rows[name][order]
        assert np.abs(off).max() <= 0.005 + 1e-9
    assert np.abs(motion.speed[found] / 100 - rows["speed"][order]).max() <= 0.005 + 1e-5
    np.testing.assert_array_equal(motion.flags[found] & OWNER_BITS, rows["owner"][order])


def test_the_bytes_of_a_vehicle_and_step():
    data = (FOLDER / "intersection.smarts").read_bytes()
    episode = CompactEpisode(data)
    # Of everything: the map, all tables and the motion.
    assert len(data) / len(episode.motion.step) < 8


def test_flags_of_a_recording_with_bubbles():
    episode = CompactEpisode((FOLDER / "bubbles.smarts").read_bytes())
    states, motion, vehicles = episode.tables["agent_states"], episode.motion, episode.vehicles
    keys = dict(
        zip(zip(vehicles["slot"], vehicles["generation"], strict=True), vehicles["number"], strict=True)
    )
    flags = dict(zip(zip(motion.number, motion.step, strict=True), motion.flags, strict=True))
    is_active = states["state"] == AgentStatus.ACTIVE
    expected = {
        AIR_LOCK: states["state"] == AgentStatus.SHADOWING,
        LEAVING: (states["state"] == AgentStatus.LEAVING) | (is_active & (states["release_step"] >= 0)),
    }
    for bit, chosen in expected.items():
        assert chosen.any()
        held = set()
        for row in np.flatnonzero(chosen).tolist():
            key = keys[states["slot"][row], states["generation"][row]], states["step"][row]
            assert flags[key] & bit
            held.add(key)
        assert sum(bool(value & bit) for value in flags.values()) == len(held)
    owners = set((motion.flags & OWNER_BITS).tolist())
    assert owners == {Owner.TRAFFIC, Owner.AGENT}
    assert bool((motion.flags & COLLIDED).any()) == bool((states["events"] & Event.COLLISION).any())


def test_the_map_is_less_than_two_centimetres_off(graph):
    lanes = map_message(graph, "d")["lanes"]
    start = unpacked_array(lanes["start"]).astype(int)
    xy = np.stack([unpacked_runs(lanes[name], start[:-1]) for name in "xy"], -1) / 100 + origin_of(graph)
    for lane in range(len(graph.lane_ids)):
        drawn = shapely.LineString(xy[start[lane] : start[lane + 1]])
        assert shapely.hausdorff_distance(drawn, shapely.LineString(graph.centreline(lane))) < 0.021


def test_roads_of_two_directions_have_a_line_between_them():
    lanes = CompactEpisode((FOLDER / "intersection.smarts").read_bytes()).map["lanes"]
    left, right, junction, edge = (
        unpacked_array(lanes[name]) for name in ("left", "right", "junction", "edge")
    )
    roads = np.unique(edge[junction == 0])
    # Each road of the scenario has the other direction to its left, and nothing to its right.
    assert [(left[edge == road][-1], right[edge == road][0]) for road in roads] == [(CENTRE, EDGE)] * len(
        roads
    )
