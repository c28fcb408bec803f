"""`smarts-bench data import`: from a file to a folder, or to a sentence."""

import json
import re
import sys

import pytest

from benchmark.cli import main
from smarts.recordings.tracks import read_tracks
from smarts.sstudio import build_scenario
from tests.recording_files import argoverse, commonroad, lanelet, obstacle

ROAD = lanelet("1", [(0, 0), (100, 0)], successors="2"), lanelet("2", [(100, 0), (200, 0)])


def cars(y=0.0):
    """Return two cars that drive east at 10 m/s, one from the begin, one from half a second later."""
    rows = [[(step, x + step, y, 0, 10) for step in range(begin, 60)] for x, begin in ((30, 0), (5, 5))]
    return [obstacle(str(number), "car", each) for number, each in enumerate(rows, 1)]


@pytest.fixture
def importing(monkeypatch, capsys, tmp_path):
    def run(source, *options, licence="CC0"):
        monkeypatch.chdir(tmp_path)
        arguments = [
            "data",
            "import",
            str(source),
            "--out",
            "out",
            *(("--licence", licence) if licence else ()),
        ]
        monkeypatch.setattr(sys, "argv", ["smarts-bench", *arguments, *options])
        with pytest.raises(SystemExit) as end:
            main()
        out, err = capsys.readouterr()
        return end.value.code, out or err

    return run


def test_a_recording_with_its_map_becomes_a_scenario(importing, tmp_path):
    code, text = importing(commonroad(tmp_path / "x.xml", *ROAD, *cars()))
    assert code == 0
    folder = tmp_path / "out"
    assert sorted(each.name for each in folder.iterdir()) == [
        "import.txt",
        "map.net.xml",
        "scenario.py",
        "tracks.parquet",
    ]
    assert "2 road users (2 passenger), 5.9 s at 0.1 s" in text
    assert "1 enter during the recording" in text
    assert "map: 100.00% of the positions" in text
    assert "nothing implausible" in text
    assert (folder / "import.txt").read_text() == text.replace("wrote out\n", "")
    facts = read_tracks(folder).facts
    assert (facts["licence"], facts["is_traffic"], facts["source"]) == ("CC0", "true", "x.xml")
    assert [*build_scenario(folder).traffic] == ["recorded"]
    code, text = importing(commonroad(tmp_path / "y.xml", *ROAD, *cars()))
    assert code == 2
    assert "there is something already" in text


def test_vehicles_beyond_the_map_of_argoverse_are_left_out(importing, tmp_path):
    bound = {
        f"{side}_lane_boundary": [{"x": x, "y": y} for x in (0, 40)]
        for side, y in (("left", 4), ("right", 0))
    }
    segment = bound | {"id": 5, "lane_type": "VEHICLE", "is_intersection": False, "successors": []}
    segment |= {"left_neighbor_id": None, "right_neighbor_id": None}
    (tmp_path / "log_map_archive_a.json").write_text(json.dumps({"lane_segments": {"5": segment}}))
    cars = [
        ("1", "vehicle", 0, 2.0, range(60)),
        ("2", "vehicle", 20, 2.0, range(20)),
        ("3", "vehicle", 0, 9.0, [4, 4]),
        ("4", "vehicle", 0, 2.0, [*range(20, 35), *[60] * 10, *range(10, 25)]),
    ]
    code, text = importing(argoverse(tmp_path / "scenario_a.parquet", cars))
    assert (code, read_tracks(tmp_path / "out").names) == (0, ("1", "4", "2", "4~2"))
    assert (
        "\noff the map: 24% of the positions, which are left out\ngaps: 1, at which tracks are split" in text
    )
    assert "; limits of 1 of 1 lanelets\n" in text
    assert read_tracks(tmp_path / "out").x.max() == 42  # half a width beyond the lane


def test_single_tracks_are_not_called_traffic(importing, tmp_path):
    piled = [obstacle(str(x), "car", [(step, x + step, 0, 0, 10) for step in range(9)]) for x in (10, 11, 12)]
    code, text = importing(commonroad(tmp_path / "x.xml", *ROAD, *piled))
    assert code == 0
    assert text.startswith("NOT TRAFFIC: 3 of 3 tracks begin at 0 s")
    assert read_tracks(tmp_path / "out").facts["is_traffic"] == "false"
    assert {each.name for each in (tmp_path / "out").iterdir()} == {"import.txt", "tracks.parquet"}


def test_repairs_can_be_left_out(importing, tmp_path):
    turned = [obstacle("1", "car", [(step, step, 0, 0.02, 10) for step in range(60)])]
    source = commonroad(tmp_path / "x.xml", *ROAD, *turned)
    code, text = importing(source, "--as-recorded")
    assert code == 0
    assert "repaired" not in text
    assert read_tracks(tmp_path / "out").heading == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("parts", "licence", "options", "problem"),
    [
        (cars(), "", (), "licence of the data is not named.*--licence 'CC BY 4.0'"),
        (cars(y=5.0), "CC0", (), "only 0% of its positions lie on lanes of its own map"),
        (cars(), "CC0", ("--map", "none.net.xml"), "none.net.xml: there is no such file"),
        (cars(), "CC0", ("--format", "NGSIM"), "its lines are not 18 or 24 numbers\n"),
        (cars(), "CC0", ("--format", "SHFF"), "did you mean 'SHF'"),
    ],
)
def test_mistakes_are_one_sentence_and_leave_nothing(importing, tmp_path, parts, licence, options, problem):
    code, text = importing(commonroad(tmp_path / "x.xml", *ROAD, *parts), *options, licence=licence)
    assert code == 2
    assert re.search(problem, text, re.DOTALL)
    assert "Traceback" not in text
    assert [each.name for each in tmp_path.iterdir()] == ["x.xml"]
