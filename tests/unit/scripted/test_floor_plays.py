"""Scripted policies in a scenario of the benchmark."""

import csv
from collections import Counter
from pathlib import Path

import pytest

from benchmark.cli.scripted import scripted
from benchmark.scripted.play import Tally, play
from smarts.errors import SmartsError, UnknownNameError
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.sstudio.locating import SUITE
from tests.raising import raises


def test_keep_lane_drives_and_parked_stands(tmp_path):
    table = tmp_path / "scripted.csv"
    scripted(
        ["keep_lane", "parked"], ["two_way"], episodes=1, seed=42, out=table, record=tmp_path / "records"
    )
    with table.open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["policy"], row["traffic"]) for row in rows] == [
        (policy, traffic)
        for policy in ("keep_lane", "parked")
        for traffic in ("no_social_vehicles", "random_social_vehicles")
    ]
    assert all(row["agent_episodes"] == "4" for row in rows)
    assert float(rows[0]["not_moving"]) == 0.0
    assert float(rows[2]["not_moving"]) == 1.0
    recorded = [
        RecordedEpisode(folder) for folder in episodes_in(tmp_path / "records" / "parked" / "two_way")
    ]
    assert len(recorded) >= 2


def test_a_scenario_without_traffic_is_played(tmp_path):
    (tmp_path / "scenario.py").write_text(
        "from pathlib import Path\n"
        "from smarts.sstudio import gen_scenario, types as t\n"
        f"loop = t.MapSpec(source={str(SUITE / 'loop')!r})\n"
        "route = t.Route(begin=('east_half', 0, 30), end=('west_half', 0, 60))\n"
        "bare = t.Scenario(map_spec=loop, ego_missions=[t.Mission(route)])\n"
        "gen_scenario(bare, output_dir=Path(__file__).parent)\n"
    )
    (tally,) = play("keep_lane", str(tmp_path), episodes=1, agents=1)
    assert (tally.traffic, tally.episodes) == ("none", 1)


def test_bad_input_is_refused_before_anything_is_played():
    with pytest.raises(UnknownNameError, match="yeilder"):
        scripted(["yeilder"])
    with raises(SmartsError, "/proc/x.csv") as caught:
        scripted(["parked"], out=Path("/proc/x.csv"))
    assert "place that can be written to" in caught.value.remedy


def test_the_number_of_agents_is_given_and_the_header_follows_the_first_result(tmp_path, capsys):
    table = tmp_path / "scripted.csv"
    with raises(SmartsError, "loop: ego_missions", values=[60, 4]):
        scripted(["parked"], ["loop"], episodes=1, agents=60)
    assert capsys.readouterr().out == ""
    scripted(["parked"], ["loop"], episodes=1, agents=1, out=table)
    with table.open() as file:
        assert {row["agent_episodes"] for row in csv.DictReader(file)} == {"1"}
    assert capsys.readouterr().out.splitlines()[0].split()[:2] == ["policy", "scenario"]


def test_the_unit_of_an_interval_is_the_episode():
    tally = Tally("keep_lane", "two_way", "none", agents=4)
    for _ in range(10):
        tally.add(Counter(goal=4), 100.0)
    assert tally.interval("goal") == pytest.approx((10 / (10 + 1.959964**2), 1.0))
