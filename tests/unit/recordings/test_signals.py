"""Traffic lights of recordings: read, found on the map, and shown."""

from contextlib import closing
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

from smarts.agents import AgentInterface, AgentSpec
from smarts.env import HiWayEnv
from smarts.recordings.importing import import_recording
from smarts.recordings.log import make_log
from smarts.recordings.reading import Source, read
from smarts.recordings.signals import SIGNAL, SIGNALS, lights_of
from smarts.recordings.tracks import RecordingError, read_tracks
from smarts.recordings.transforms import Transform, transformed
from smarts.sensors.signals import SignalLightState
from smarts.sim.assembly import assemble
from smarts.sim.episode_files import episodes_in
from smarts.sim.options import Options
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType, LaneAction
from smarts.types.traffic import Signal
from tests import maps
from tests.recording_files import commonroad, lanelet, obstacle

PHASES = (("green", 10), ("yellow", 3), ("red", 20), ("redYellow", 2))
CAR = obstacle("1", "car", [(step, 30 + step, 0, 0, 10) for step in range(0, 51)])


def light(name, phases=PHASES, offset=5, direction="all", active="true"):
    """Return a traffic light of CommonRoad."""
    texts = "".join(
        f"<cycleElement><duration>{length}</duration><color>{colour}</color></cycleElement>"
        for colour, length in phases
    )
    cycle = f"<cycle>{texts}<timeOffset>{offset}</timeOffset></cycle>"
    more = f"<direction>{direction}</direction><active>{active}</active>"
    return f'<trafficLight id="{name}">{cycle}{more}</trafficLight>'


def fork(*lights):
    """Return a road that forks after 100 m, straight on and to the left, with lights at its end."""
    marks = "".join(f'<trafficLightRef ref="{name}"/>' for name in lights)
    road = lanelet("1", [(0, 0), (100, 0)], successors="23").replace("</lanelet>", f"{marks}</lanelet>")
    turns = '<successorsStraight ref="2"/><successorsLeft ref="3"/>'
    ahead, left = lanelet("2", [(100, 0), (220, 0)]), lanelet("3", [(100, 0), (150, 20), (220, 60)])
    return road, ahead, left, f'<intersection id="8"><incoming id="9">{turns}</incoming></intersection>'


def test_cycles_of_commonroad(tmp_path):
    """To step 50, a cycle of 35 steps begins at steps -30, 5 and 40, one of 10 steps at -10, 0, 10, ..."""
    lights = light("7", direction="straightRight"), light("8", [("red", 10)], offset=0, direction="left")
    lost = light("9"), light("10", active="false")
    tracks = read(Source(commonroad(tmp_path / "x.xml", *fork("7", "8", "10"), *lights, *lost, CAR)))
    ahead = tracks.signals[tracks.signals[:, 3] - tracks.signals[:, 4] == 220]
    assert ahead[:, 0] == pytest.approx([-3, -2, -1.7, 0.3, 0.5, 1.5, 1.8, 3.8, 4.0, 5.0])
    caution = [Signal.CAUTION, Signal.STOP, Signal.CAUTION]
    assert ahead[:, 5].tolist() == [*[Signal.GO, *caution] * 2, Signal.GO, Signal.CAUTION]
    assert (ahead[:, 1:5] == (100, 0, 220, 0)).all()
    left = tracks.signals[tracks.signals[:, 4] == 60]
    assert (left == [(t, 100, 0, 220, 60, Signal.STOP) for t in range(-1, 6)]).all()
    assert tracks.facts["left_out"] == "traffic light (1)"
    with pytest.raises(RecordingError, match="'7' has a phase without duration"):
        read(Source(commonroad(tmp_path / "y.xml", *fork("7"), light("7", [("red", 0)]), CAR)))


def test_signals_follow_their_recording_to_another_place(tmp_path):
    tracks = read(Source(commonroad(tmp_path / "x.xml", *fork("7"), light("7", [("red", 99)]), CAR)))
    moved = transformed(tracks, Transform(swap_xy=True, scale=2.0, x_margin=1.0, flip_y=500.0))
    assert moved.signals[0, 1:5].tolist() == [-1, 300, -1, 60]
    assert (moved.x[0], moved.y[0], len(moved.x)) == (-1, 440, len(tracks.x))
    assert tracks.signals[0, 1:5].tolist() == [100, 0, 220, 0]


def test_a_light_of_commonroad_is_shown_to_sensors(tmp_path):
    """The light is red to 0.3 s, amber to 0.5 s, green to 1.5 s."""
    folder = tmp_path / "out"
    source = commonroad(tmp_path / "x.xml", *fork("7"), light("7", direction="straight"), CAR)
    lines = import_recording(Source(source), folder, licence="CC0")
    assert "1 ways with signals, 1 of them found on the map" in lines[0]
    assert pq.read_table(folder / SIGNALS).column_names == [*SIGNAL]
    script = folder / "scenario.py"
    mission = 'ego_missions=[t.Mission(t.Route(("road-1", 0, 70), ("road-2", 0, "max")))], traffic='
    script.write_text(script.read_text().replace("traffic=", mission, 1))
    built = build_scenario(folder)
    roads = built.roads()
    (governed,) = np.unique(lights_of(read_tracks(folder).signals, roads)[0][:, 1]).astype(int).tolist()
    assert roads.signal[governed] >= 0  # so that Envision draws it
    assert roads.successors(governed).tolist() == [roads.lane_number("road-2", 0)]
    interface = AgentInterface(action=ActionSpaceType.Lane, signals=True)
    with closing(HiWayEnv([folder], {"agent": AgentSpec(interface=interface)})) as env:
        seen, _ = env.reset()
        found = [seen["agent"].signals]
        for _ in range(19):
            seen, *_ = env.step({"agent": LaneAction.keep_lane})
            found.append(seen["agent"].signals)
    states = [each.state for (each,) in found]
    red, amber, green = SignalLightState.STOP, SignalLightState.CAUTION, SignalLightState.GO
    assert states == [*[red] * 3, *[amber] * 2, *[green] * 10, *[amber] * 3, *[red] * 2]
    assert {each.controlled_lanes for (each,) in found} == {(roads.lane_ids[governed],)}
    part = make_log(read_tracks(folder), roads, 1.0, 2.0)  # a part's lights end with it
    assert part.lights[:, 0] == pytest.approx([-3, -2, -1.7, 0.3, 0.5, 1.5, 1.8])
    files = built.traffic["recorded"]
    later = replace(files.recording, begin=2.0, latest=2.0)
    built.traffic["recorded"] = replace(files, recording=later)
    with traffic_run(built, "recorded") as run:  # amber from 3.8 s, green from 4 s on
        shown = [int(run.world.signals[0, governed])]
        shown += [int(run.world.signals[0, governed]) for _ in run.steps(2.1)]
    assert shown == [*[Signal.STOP] * 18, *[Signal.CAUTION] * 2, *[Signal.GO] * 2]


def test_a_light_governs_the_nearest_of_the_ways_over_its_places():
    """The stop position is at the end of a short road, whose way on and the next road's both lead over it."""
    ways = {
        "a": maps.Road([(0.0, 0.0), (50.0, 0.0)]),
        "b": maps.Road([(51.0, 0.0), (61.0, 0.0)]),
        "c": maps.Road([(62.0, 0.0), (120.0, 0.0)]),
    }
    roads = maps.graph_of(ways, [(("a", 0), ("b", 0)), (("b", 0), ("c", 0))])
    found, count = lights_of(np.array([[0.0, 50.0, 0.0, 61.0, 0.0, Signal.STOP]]), roads)
    assert count == 1
    assert found.tolist() == [[0.0, roads.successors(roads.lane_number("a", 0))[0], Signal.STOP]]


def test_an_episode_with_signals_comes_back(tmp_path):
    built = build_scenario("unprotected_left_turn@signalised")
    interface, shown = AgentInterface(action=ActionSpaceType.Lane), []
    options = Options(record=tmp_path / "store", traffic_engine="Native")
    parts = assemble([built], [interface] * 3, options=options)
    with closing(parts.simulation):
        parts.simulation.reset({0: parts.schedule.start(0, 0)})
        for _ in range(460):
            shown.append(parts.simulation.world.signals[0].copy())
            parts.simulation.step(parts.actions, np.ones(1, bool), np.ones((1, 3), bool))
    assert len(np.unique(shown, axis=0)) == 4  # Native's lights show nothing before the first step
    (episode,) = episodes_in(tmp_path / "store")
    import_recording(Source(episode), tmp_path / "out", licence="CC0", map_file=built.net_file)
    with traffic_run(build_scenario(tmp_path / "out"), "recorded") as run:
        replayed = [run.world.signals[0].copy()]
        replayed += [run.world.signals[0].copy() for _ in run.steps(45.9)]
    assert np.array_equal(replayed, shown)
