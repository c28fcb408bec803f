"""Recorded traffic in scenarios: `Traffic(engine="Recorded", recording=...)`."""

import math
import sys
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

import perf.recorded
from smarts.agents import AgentInterface
from smarts.errors import SmartsError
from smarts.geometry.boxes import boxes_overlap
from smarts.providers.recorded.engine import NAME
from smarts.recordings.importing import import_recording
from smarts.recordings.log import Log
from smarts.recordings.reading import Source
from smarts.recordings.tracks import read_tracks, write_tracks
from smarts.sim.assembly import Options, assemble
from smarts.sim.schedule import Schedule
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.vehicles import Owner
from tests.recording_files import DATA, needs_data
from tests.tracks import straight, tracks_of
from tests.unit.sstudio.sources import scenario, write_cross

RECORDED = 't.Traffic([], engine="Recorded", recording=t.Recording("recording"{more}))'
MISSION = "ego_missions=[t.Mission(south_north)]"


def tracks(count=20, y=-4.8, **facts):
    """Return vehicles that come from the west, one every 3 s."""
    found = [straight(str(each), 3.0 * each, 3.0 * each + 20.0, -100.0, y, 10.0) for each in range(count)]
    return tracks_of(found, **facts)


def write(folder, body, made=None):
    write_cross(folder)
    folder.joinpath("scenario.py").write_text(scenario(body))
    write_tracks(made or tracks(), folder / "recording")
    return folder


def recorded(**more):
    return RECORDED.format(more="".join(f", {name}={value!r}" for name, value in more.items()))


@pytest.fixture(scope="module")
def split(tmp_path_factory):
    body = f'traffic={{"early": {recorded(end=40.0, window=10.0, mode="log")}}}, {MISSION}, held_out={{'
    body += f'"later": t.Variation("the rest", traffic={{"late": {recorded(begin=40.0)}}})}}'
    return write(tmp_path_factory.mktemp("scenarios") / "split", body)


def test_a_scenario_plays_its_recording(split):
    built = build_scenario(split)
    interface = AgentInterface(action=ActionSpaceType.Lane)
    parts = assemble([built], [interface], worlds=3, options=Options())
    with closing(parts.simulation):
        starts = {row: parts.schedule.start(row, 0) for row in range(3)}
        assert {start.engine for start in starts.values()} == {"Recorded"}
        begins = [start.traffic.recording.begin for start in starts.values()]
        parts.simulation.reset(starts)
        for _ in range(20):
            frame = parts.simulation.step(parts.actions, np.ones(3, bool), np.ones((3, 1), bool))
        vehicles, names = frame.world.vehicles, frame.world.registry
        for row, begin in enumerate(begins):
            newest = math.floor((begin + 2.0) / 3.0)
            slot = names.slot(row, f"history-vehicle-{newest}")
            expected = -100.0 + 10.0 * (begin + 2.0 - 3.0 * newest)
            assert vehicles.position[row, slot] == pytest.approx((expected, -4.8))
            assert vehicles.lane[row, slot] == built.roads().lane_number("from_west", 0)


@pytest.mark.parametrize(
    ("tactic", "taken"),
    [
        ('t.IdEntryTactic(0.0, "history-vehicle-3")', "history-vehicle-3"),
        ('t.TrapEntryTactic(0.0, 30.0, t.MapZone(("from_west", 0, 20), 20, 2))', "history-vehicle-2"),
    ],
)
def test_an_agent_begins_in_a_recorded_vehicle(tmp_path, tactic, taken):
    mission = f't.EndlessMission(("from_west", 0, 10), entry_tactic={tactic})'
    write(tmp_path / "one", f'traffic={{"a": {recorded(begin=6.0)}}}, ego_missions=[{mission}]')
    parts = assemble([build_scenario(tmp_path / "one")], [AgentInterface(action=ActionSpaceType.Lane)])
    with closing(parts.simulation):
        parts.simulation.reset({0: parts.schedule.start(0, 0)})
        for _ in range(60):
            world = parts.simulation.step(parts.actions, np.ones(1, bool), np.ones((1, 1), bool)).world
        (slot,) = np.flatnonzero(world.vehicles.owner[0] == Owner.AGENT)
        assert world.registry.name(0, slot) == taken
        assert world.agents.slot[0, 0] == slot


@pytest.fixture(scope="module")
def west(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenarios") / "west"
    file = DATA / "mona" / "DEU_MONAWest-2_1_T-300.xml"
    import_recording(Source(file), folder, licence="CC BY-NC 4.0")
    return build_scenario(folder)


@needs_data
def test_mona_west_is_played_as_it_was_recorded(west):
    made, compared = read_tracks(west.source), 0
    with traffic_run(west, "recorded") as run:
        for states in run.steps(60.0):
            t, names = run.world.time[0], run.world.registry
            found = {names.name(0, slot).removeprefix(NAME): slot for slot in np.flatnonzero(states.alive)}
            first, last = made.t[made.start[:-1]], made.t[made.start[1:] - 1]
            is_there = (first <= t + 1e-6) & (last >= t - 1e-6)
            assert set(found) == {name for name, here in zip(made.names, is_there, strict=True) if here}
            for row in np.flatnonzero(np.abs(made.t - t) < 1e-6):
                slot = found[made.names[made.track[row]]]
                assert np.hypot(*(states.position[slot] - (made.x[row], made.y[row]))) < 0.01
                compared += 1
        assert compared > 4700


def brake(west, mode, episodes):
    """Brake one vehicle of each episode until it stops; return the accelerations of those that hit it."""
    files, draws, found = west.traffic["recorded"], np.random.default_rng(7), []
    west.traffic["recorded"] = replace(files, recording=replace(files.recording, mode=mode, latest=45.0))
    for episode in range(episodes):
        with traffic_run(west, "recorded", episode=episode) as run:
            steps, hit = run.steps(8.0), set()
            v = next(steps)
            slot = draws.choice(np.flatnonzero(v.alive & (v.speed > 6.0)))
            v.owner[slot] = Owner.AGENT
            course = np.array([np.cos(v.heading[slot]), np.sin(v.heading[slot])])
            for _ in range(79):
                v.speed[slot] = max(0.0, v.speed[slot] - 0.8)
                v.position[slot] += 0.1 * v.speed[slot] * course
                next(steps)
                boxes = v.position, v.heading, np.stack([v.length, v.width], -1)
                touched = v.alive & boxes_overlap(*(each[slot] for each in boxes), *boxes)
                touched[slot] = False
                new = set(np.flatnonzero(touched).tolist()) - hit
                hit |= new
                found += v.acceleration[[*new]].tolist()
    west.traffic["recorded"] = files
    return found


@needs_data
def test_vehicles_brake_for_one_that_stops_among_them(west):
    assert len(brake(west, "log", 10)) >= 10
    # A vehicle that cuts in too late brakes as hard as it can.
    assert all(acceleration < -7.9 for acceleration in brake(west, "reactive", 20))


def test_train_and_test_share_no_time(split):
    early, late = build_scenario(split), build_scenario(f"{split}@later")
    files = early.traffic["early"].recording, late.traffic["late"].recording
    logs = [Log.load(each.log).paths for each in files]
    assert logs[0].t.max() == 40.0 == logs[1].t.min()
    assert (files[0].begin, files[0].latest) == (0.0, 30.0)
    assert (files[1].begin, files[1].latest, files[1].mode) == (40.0, 40.0, "reactive")


def taking(name, start=2.0):
    tactic = f't.IdEntryTactic({start}, "{name}")'
    return MISSION.replace("south_north", f"south_north, entry_tactic={tactic}")


def test_episodes_begin_while_a_vehicle_that_is_taken_over_is_there(tmp_path):
    """Vehicle 3 leaves at 29 s and is taken 2 s after the begin, with a second to spare."""
    traffic = recorded(end=40.0, window=10.0)
    built = build_scenario(
        write(tmp_path / "one", f'traffic={{"a": {traffic}}}, {taking("history-vehicle-3")}')
    )
    assert built.traffic["a"].recording.latest == pytest.approx(26.0)
    assert "traffic['a'] ends 14 to 40 s after an episode's begin" in built.notes


@pytest.mark.parametrize(
    ("mission", "problem"),
    [
        (taking("history-vehicle-33"), "no vehicle(?s:.*)did you mean 'history-vehicle-3'"),
        (taking("3"), "no vehicle '3'"),
        (
            taking("history-vehicle-0", 19.5),
            "is recorded 19.5 s after the begin(?s:.*)mean 'history-vehicle-10'",
        ),
    ],
)
def test_vehicles_that_cannot_be_taken_over_are_named(tmp_path, mission, problem):
    write(tmp_path / "one", f'traffic={{"a": {recorded()}}}, {mission}')
    with pytest.raises(SmartsError, match=problem):
        build_scenario(tmp_path / "one")


def test_episodes_begin_evenly_within_the_part(split):
    schedule = Schedule([build_scenario(split)], ["ego"])
    begins = [
        schedule.start(world, episode).traffic.recording.begin for world in range(8) for episode in range(8)
    ]
    assert min(begins) >= 0.0
    assert max(begins) < 30.0
    counts, _ = np.histogram(begins, bins=8, range=(0.0, 30.0))
    assert counts.min() >= 6
    assert schedule.start(3, 4) == schedule.start(3, 4)


@pytest.mark.parametrize(
    ("traffic", "made", "problem"),
    [
        (recorded(mode="exact"), None, "'exact'"),
        (recorded(begin=90.0), None, "begin=90"),
        (recorded(window=90.0), None, "window=90"),
        ('t.Traffic([], engine="Recorded")', None, "drives recordings"),
        (recorded().replace("Recorded", "SUMO"), None, "drives recordings"),
        (recorded().replace("[]", "[flow()]"), None, "nothing else"),
        (recorded().replace('"recording"', '"nowhere"'), None, "there is no recording"),
        ('t.Traffic([], engine="Recorded", recording=".")', None, "not a Recording: '.'"),
        (recorded(), tracks(is_traffic="false"), "is no traffic"),
        (recorded(), tracks(y=30.0), "only 6% of the positions"),
    ],
)
def test_mistakes_are_named(tmp_path, traffic, made, problem):
    write(tmp_path / "one", f'traffic={{"a": {traffic}}}, {MISSION}', made)
    with pytest.raises(SmartsError, match=problem):
        build_scenario(tmp_path / "one")


FCD = """<fcd-export>{steps}</fcd-export>"""


def write_fcd(file, y):
    """Write SUMO's output of a car of 5 m that drives east at 10 m/s from x = -100 on."""
    steps = "".join(
        f'<timestep time="{0.5 * k}"><vehicle id="7" x="{-97.5 + 5.0 * k}" y="{y}" '
        'angle="90" type="car" speed="10"/></timestep>'
        for k in range(40)
    )
    file.write_text(FCD.format(steps=steps))


def history(**more):
    fields = {"name": "own", "source_type": "FCD", "input_path": "own.xml"} | more
    return f"t.TrafficHistoryDataset({', '.join(f'{name}={value!r}' for name, value in fields.items())})"


def test_traffic_histories_are_variations_of_the_traffic(tmp_path):
    body = f"traffic_histories=[{history(flip_y=True, filter_off_map=True)}], {MISSION}"
    folder = write(tmp_path / "one", body)
    # The map's largest y is 110 m.
    write_fcd(folder / "own.xml", 110.0 + 4.8)
    built = build_scenario(folder)
    recording = built.traffic["own"].recording
    assert (recording.mode, recording.begin) == ("log", 0.0)
    log = Log.load(recording.log)
    assert log.names == ("7",)
    assert log.paths.x[:2].tolist() == [-100.0, -95.0]
    assert np.abs(log.paths.y + 4.8).max() < 1e-9


def test_bad_traffic_histories_are_named(tmp_path):
    for number, (entry, problem) in enumerate(
        (
            (history(source_type="NGSMI"), "'NGSMI'"),
            (history(input_path="nowhere.xml"), "nowhere.xml"),
            ("'i80.yaml'", "TrafficHistoryDataset"),
        )
    ):
        folder = write(tmp_path / str(number), f"traffic_histories=[{entry}], {MISSION}")
        with pytest.raises(SmartsError, match=problem):
            build_scenario(folder)


def test_engines_do_not_drive_what_they_cannot(split):
    built = build_scenario(split)
    with pytest.raises(SmartsError, match="'SUMO' cannot drive the traffic 'early'"):
        Schedule([built], ["ego"], engine="SUMO")
    with pytest.raises(SmartsError, match="'Recorded' cannot drive"):
        Schedule([build_scenario("intersection")], ["ego"], engine="Recorded")


@pytest.mark.nightly
def test_its_time_is_measured_beside_sumos(split, monkeypatch, capsys):
    options = ["--traffic", "early", "--worlds", "2", "--seconds", "20"]
    monkeypatch.setattr(sys, "argv", ["recorded", str(split), *options])
    perf.recorded.main()
    rows = [line.rsplit(maxsplit=4) for line in capsys.readouterr().out.splitlines()[1:]]
    assert [row[0] for row in rows] == ["SUMO", "Recorded, log", "Recorded, reactive"]
    assert all(2.0 < float(row[1]) < 8.0 for row in rows)


def test_a_changed_recording_is_built_again(tmp_path):
    folder = write(tmp_path / "one", f'traffic={{"a": {recorded()}}}, {MISSION}')
    first = build_scenario(folder)
    assert build_scenario(folder).directory == first.directory
    write_tracks(tracks(count=3), folder / "recording")
    assert len(Log.load(build_scenario(folder).traffic["a"].recording.log).names) == 3
