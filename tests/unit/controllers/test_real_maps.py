"""Lane keeping on maps of towns that netconvert makes from OpenStreetMap data."""

from pathlib import Path

import pytest

from perf.real_maps import PLACES, drive_all, load

DATA = Path(__file__).parents[2] / "data"
TOWNS = "old_town", "mini_roundabouts", "slanted_crossing"


@pytest.fixture(scope="module")
def towns(tmp_path_factory):
    folder = tmp_path_factory.mktemp("towns")
    return {name: load(DATA / f"{name}.osm", folder) for name in TOWNS}


@pytest.mark.parametrize(
    "name", [TOWNS[0], *(pytest.param(town, marks=pytest.mark.nightly) for town in TOWNS[1:])]
)
def test_cars_stay_on_the_road(towns, name):
    drives = drive_all(towns[name], "sedan", 12, seed=1)
    off = [drive.place for drive in drives if drive.ends in PLACES]
    assert not off
    assert sum(drive.ends == "done" for drive in drives) >= 10
