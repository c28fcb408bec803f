"""Lane keeping on maps of towns that netconvert makes from OpenStreetMap data."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from perf.real_maps import ENDS, PLACES, drive_all, load, main, random_lanes, turnarounds
from smarts.types.vehicles import VehicleKind

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


def test_routes_follow_links_and_do_not_turn_back(towns):
    graph, generator = towns["old_town"], np.random.default_rng(0)
    back = turnarounds(graph)
    assert back
    for _ in range(20):
        lanes = random_lanes(graph, VehicleKind.PASSENGER, generator)
        links = set(itertools.pairwise(lanes))
        assert all(after in graph.successors(before) for before, after in links)
        assert not links & back
        assert not graph.is_internal[[lanes[0], lanes[-1]]].any()


def test_the_command_counts_all_routes(capsys):
    main([str(DATA / "old_town.osm"), "--vehicle", "sedan", "--routes", "3"])
    heads, row = capsys.readouterr().out.splitlines()
    cells = row.split()
    assert cells[:2] == ["old_town", "sedan"]
    assert sum(map(int, cells[3 : 3 + len(ENDS)])) == 3
    assert all(end in heads for end in ENDS)
