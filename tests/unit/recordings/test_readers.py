"""Readers of recorded traffic, on files by hand."""

import sqlite3

import numpy as np
import pandas as pd
import pytest

from smarts.recordings.headings import HeadingRule, infer_headings
from smarts.recordings.reading import READERS, Source, guess_format, read
from smarts.recordings.tracks import RecordingError
from smarts.types.vehicles import VehicleKind
from tests.recording_files import argoverse, commonroad, obstacle

CAR = [(5, 1.0, 2.0, 0.5, 4.0), (6, 1.4, 2.0, 0.5, 4.5)]


def shf(path, vehicles=((7, 2, 4.0, 2.0), (8, 3, None, None), (9, 4, 0.5, 0.5)), columns="speed REAL"):
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE Vehicle (id INTEGER, type INTEGER, length REAL, width REAL)")
        columns = f"vehicle_id, sim_time, position_x, position_y, heading_rad, {columns}"
        database.execute(f"CREATE TABLE Trajectory ({columns})")
        database.executemany("INSERT INTO Vehicle VALUES (?, ?, ?, ?)", vehicles)
        rows = [(8, 2.5, 9, 9, 0, 3), (7, 2.1, 1.5, 2, -np.pi / 2, 5), (7, 2.0, 1, 2, -np.pi / 2, 5)]
        rows += [(8, 2.6, 9, 9.3, 0, 3), (9, 2.0, 0, 0, 0, 0)]
        database.executemany("INSERT INTO Trajectory VALUES (?, ?, ?, ?, ?, ?)", rows)
    database.close()
    return path


def samples(tracks, name):
    rows = slice(*tracks.start[tracks.names.index(name) :][:2])
    return np.column_stack([tracks.t, tracks.x, tracks.y, tracks.heading, tracks.speed])[rows]


def test_commonroad(tmp_path):
    circle = "<circle><radius>1.5</radius></circle>"
    file = commonroad(
        tmp_path / "x.xml",
        obstacle("10", "car", CAR),
        obstacle("11", "truck", [(6, 1, 4, 0, 2), (7, 3, 4, 0.1, 2)], shape=circle),
        obstacle("12", "pedestrian", CAR, shape=""),
        obstacle("13", "bicycle", CAR),
        obstacle("14", "train", CAR),
        "<trafficLight/><trafficLight/>",
        dt=0.2,
    )
    tracks = read(Source(file))
    assert tracks.names == ("10", "12", "13", "11")
    kinds = VehicleKind.PASSENGER, VehicleKind.PEDESTRIAN, VehicleKind.BICYCLE, VehicleKind.TRUCK
    assert tracks.kind.tolist() == [*kinds]
    assert (tracks.length.tolist(), tracks.width.tolist()) == ([4, 0.215, 4, 3], [2, 0.478, 2, 3])
    assert samples(tracks, "10") == pytest.approx(np.array([[0, 1, 2, 0.5, 4], [0.2, 1.4, 2, 0.5, 4.5]]))
    assert samples(tracks, "11") == pytest.approx(np.array([[0.2, 1, 4, 0, 2], [0.4, 3, 4, 0.1, 2]]))
    facts = {"name": "X-1", "attribution": "S", "left_out": "train (1), traffic light (2)"}
    assert tracks.facts.items() >= (facts | {"time_step": "0.2", "duration": "0.4"}).items()


def test_histories_of_smarts_2(tmp_path):
    tracks = read(Source(shf(tmp_path / "x.shf")))
    assert tracks.names == ("7", "8")
    assert samples(tracks, "7") == pytest.approx(np.array([[0, 1, 2, 0, 5], [0.1, 1.5, 2, 0, 5]]))
    assert samples(tracks, "8")[:, 3] == pytest.approx(np.pi / 2)
    assert tracks.length.tolist() == [4.0, 7.1]
    assert tracks.facts["left_out"] == "pedestrian or bicycle (1)"
    assert tracks.facts["assumed"] == "1 of 2 vehicles have sizes usual for their kinds"


def test_text_of_ngsim(tmp_path):
    """A car and a truck drive along y at 30 and 20 ft/s; positions are those of front bumpers."""
    rows = []
    for vehicle, first, speed, size, kind in ((2, 0, 30.0, (15, 6), 2), (5, 1, 20.0, (40, 8), 3)):
        for frame in range(first, 5):
            position = (20.0, 100.0 + speed * 0.1 * (frame - first))
            millis = 1113433136100 + 100 * frame
            row = (vehicle, frame, 5 - first, millis, *position, 0, 0, *size, kind, speed, 0, 3, 0, 0, 0, 0)
            rows.append(" ".join(map(str, row)))
    (tmp_path / "trajectories-0400-0415.txt").write_text("\n".join(rows))
    tracks = read(Source(tmp_path / "trajectories-0400-0415.txt"))
    assert (tracks.names, tracks.kind.tolist()) == (("2", "5"), [VehicleKind.PASSENGER, VehicleKind.TRUCK])
    foot = 0.3048
    assert samples(tracks, "2")[1] == pytest.approx([0.1, 20 * foot, 95.5 * foot, np.pi / 2, 30 * foot])
    assert samples(tracks, "5")[0] == pytest.approx([0.1, 20 * foot, 80 * foot, np.pi / 2, 20 * foot])
    assert (tracks.length / foot).tolist() == pytest.approx([15, 40])


def test_csv_of_ngsim(tmp_path):
    """A number is used twice; a row is there twice; there are two locations."""
    head = (
        "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,v_length,v_Width,v_Class,v_Vel,Location"
    )
    rows = [(2, k, 3, 1118846980200 + 100 * k, 20, 100 + 3 * k, 15, 6, 2, 30, "i-80") for k in (0, 1, 2, 2)]
    rows += [(2, k, 2, 1118849980200 + 100 * k, 20, 100 + 3 * k, 40, 8, 3, 30, "i-80") for k in (0, 1)]
    rows += [(3, k, 2, 1118846980200 + 100 * k, 0, 0, 15, 6, 2, 0, "us-101") for k in (0, 1)]
    file = tmp_path / "NGSIM.csv"
    file.write_text("\n".join([head, *(",".join(map(str, row)) for row in rows)]))
    tracks = read(Source(tmp_path / "NGSIM.csv#i-80"))
    assert (tracks.names, (tracks.length / 0.3048).tolist()) == (("2-3", "2-2"), pytest.approx([15, 40]))
    assert samples(tracks, "2-3")[1] == pytest.approx([0.1, *0.3048 * np.array([20, 95.5]), np.pi / 2, 9.144])
    with pytest.raises(RecordingError, match=r"i-80, us-101(?s:.*)give NGSIM\.csv#i-80"):
        read(Source(file))


def test_floating_car_data_of_sumo(tmp_path):
    """A car (5 m) drives east, a truck (7.1 m) north."""
    steps = "".join(
        f'<timestep time="{t}"><vehicle id="a" x="{5 + t * 10}" y="2" angle="90" type="slow" speed="10"/>'
        f'<vehicle id="b" x="1" y="{8 + t * 5}" angle="0" type="my_truck" speed="5"/>'
        f'<person id="p" x="1" y="2" angle="180" speed="0"/></timestep>'
        for t in (7.0, 7.5, 8.0)
    )
    (tmp_path / "out.xml").write_text(f"<fcd-export>{steps}</fcd-export>")
    tracks = read(Source(tmp_path / "out.xml"))
    assert samples(tracks, "a")[1] == pytest.approx([0.5, 80 - 2.5, 2, 0, 10])
    assert samples(tracks, "b")[2] == pytest.approx([1.0, 1, 48 - 3.55, np.pi / 2, 5])
    assert tracks.length.tolist() == [5.0, 7.1, 0.215]
    assert tracks.kind.tolist() == [VehicleKind.PASSENGER, VehicleKind.TRUCK, VehicleKind.PEDESTRIAN]


def test_tables_of_interaction(tmp_path):
    """A car and a stroller; a pedestrian, without size and heading, in the file beside."""
    head = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy"
    rows = [(1, "car", 3.0, "0.5,4.0,2.0"), (2, "stroller", 9.0, "0,1,1")]
    cars = [
        f"{name},{k},{100 * k},{kind},{x + k},2,3,4,{rest}" for name, kind, x, rest in rows for k in (1, 2)
    ]
    (tmp_path / "vehicle_tracks_000.csv").write_text("\n".join([f"{head},psi_rad,length,width", *cars]))
    walks = [f"P1,{k},{100 * k},pedestrian/bicycle,1,{5 + k},0,10" for k in (2, 3)]
    (tmp_path / "pedestrian_tracks_000.csv").write_text("\n".join([head, *walks]))
    tracks = read(Source(tmp_path / "vehicle_tracks_000.csv"))
    assert (tracks.names, tracks.kind.tolist()) == (
        ("1", "P1"),
        [VehicleKind.PASSENGER, VehicleKind.PEDESTRIAN],
    )
    assert samples(tracks, "1") == pytest.approx(np.array([[0, 4, 2, 0.5, 5], [0.1, 5, 2, 0.5, 5]]))
    assert samples(tracks, "P1")[0] == pytest.approx([0.1, 1, 7, np.pi / 2, 10])
    assert (tracks.length.tolist(), tracks.facts["left_out"]) == ([4.0, 0.215], "stroller (1)")


def test_scenarios_of_argoverse(tmp_path):
    cars = [
        ("AV", "vehicle", 0, 1.0, [3.0, 4.0]),
        ("7", "cyclist", 1, 2.0, [0.0, 1.0]),
        ("8", "static", 0, 9.0, [5]),
    ]
    tracks = read(Source(argoverse(tmp_path / "scenario_x.parquet", cars)))
    assert (tracks.names, tracks.kind.tolist()) == (("9", "7"), [VehicleKind.PASSENGER, VehicleKind.BICYCLE])
    assert samples(tracks, "7") == pytest.approx(np.array([[0.1, 0, 2, 0, 10], [0.2, 1, 2, 0, 10]]))
    assert tracks.facts["left_out"] == "static (1)"


def test_own_episodes(tmp_path):
    """Two vehicles used the same slot one after another."""
    columns = {"kind": 0, "length": 4.0, "width": 2.0, "heading": 0.25, "speed": 3.0}
    rows = [(0, 1, 0, 1.0), (1, 1, 0, 1.3), (1, 1, 1, 9.0), (2, 1, 1, 9.3)]
    vehicles = pd.DataFrame(rows, columns=["step", "slot", "generation", "x"]).assign(y=2.0, **columns)
    vehicles.to_parquet(tmp_path / "vehicles.parquet")
    names = pd.DataFrame({"slot": 1, "generation": [0, 1], "name": ["early", "late"]})
    names.to_parquet(tmp_path / "names.parquet")
    pd.DataFrame(columns=["step", "lane", "signal"]).to_parquet(tmp_path / "signals.parquet")
    pd.DataFrame({"dt": [0.1], "scenario": ["loop"], "map": ["m"]}).to_parquet(tmp_path / "episode.parquet")
    tracks = read(Source(tmp_path))
    assert tracks.names == ("early", "late")
    assert samples(tracks, "late") == pytest.approx(np.array([[0.1, 9, 2, 0.25, 3], [0.2, 9.3, 2, 0.25, 3]]))
    assert tracks.facts["name"] == "loop"
    names.drop(columns="name").to_parquet(tmp_path / "names.parquet")
    with pytest.raises(RecordingError, match="name"):
        read(Source(tmp_path))


def written(name, text=""):
    return lambda folder: (folder / name).write_text(text) and folder / name


MISTAKES = {
    "no such file": (lambda folder: folder / "x.shf", "there is no such file"),
    "another file": (written("x.docx", "x"), "no recording of a known format"),
    "other XML": (written("x.xml", "<net/>"), "no recording of a known format"),
    "cut off": (written("x.xml", "<commonRoad>"), "the format CommonRoad are: no element found"),
    "another version": (lambda folder: commonroad(folder / "x.xml", version="2018b"), "'2018b'"),
    "no time": (
        lambda folder: commonroad(folder / "x.xml", obstacle("3", "car", ["<state></state>"])),
        "obstacle '3' has no <time/exact>",
    ),
    "not a number": (
        lambda folder: commonroad(folder / "x.xml", obstacle("3", "car", [CAR[0], (6, "nan", 0, 0, 0)])),
        "no numbers",
    ),
    "nobody": (lambda folder: commonroad(folder / "x.xml", obstacle("3", "car", CAR[:1])), "no vehicle"),
    "twice": (
        lambda folder: commonroad(folder / "x.xml", obstacle("3", "car", [*CAR, CAR[1]])),
        "at one time",
    ),
    "missing column": (lambda folder: shf(folder / "x.shf", columns="pace REAL"), "no such column: speed"),
    "too few columns": (
        written("x.txt", "1 2 3\n4 5 6\n"),
        "the format NGSIM are: its lines are not 18 or 24 numbers",
    ),
    "no x": (
        written("x.xml", '<fcd-export><timestep time="0"><vehicle id="a" y="1"/></timestep></fcd-export>'),
        "'x' is missing",
    ),
    "no database": (written("x.shf", "x" * 200), "not a database"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_is_no_recording_is_refused(mistake, tmp_path):
    make, problem = MISTAKES[mistake]
    with pytest.raises(RecordingError, match=problem):
        read(Source(make(tmp_path)))


def test_each_format_is_recognised_and_has_a_reader(tmp_path):
    assert guess_format(shf(tmp_path / "x.shf")) == "SHF"
    assert guess_format(commonroad(tmp_path / "x.xml")) == "CommonRoad"
    argoverse(tmp_path / "scenario_x.parquet", [])
    assert guess_format(tmp_path) == guess_format(tmp_path / "scenario_x.parquet") == "Argoverse"
    assert all(callable(READERS[name]) for name in READERS)


def test_headings_follow_from_positions():
    """A vehicle drives east at 5 m/s, stands while its position scatters, and drives north."""
    t = np.arange(0.0, 4.0, 0.5)
    x = np.array([0, 2.5, 5, 5.1, 4.9, 5.0, 5.0, 5.0])
    y = np.array([0, 0.0, 0, 0.1, 0.2, 0.0, 2.5, 5.0])
    rule = HeadingRule(window=1)
    assert infer_headings(t, x, y, rule) == pytest.approx(np.array([0, 0, 0, 0, 0, *[np.pi / 2] * 3]))
    slow = infer_headings(t, x, y, HeadingRule(window=1, max_turn=1.0))
    assert slow == pytest.approx(np.array([0, 0, 0, 0, 0, 0.5, 1.0, 1.5]))
    assert infer_headings(t, 0 * t, 0 * t, HeadingRule(default=2.0)) == pytest.approx(2.0)
