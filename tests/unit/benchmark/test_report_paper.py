"""Encounters with social vehicles, and figures of the paper that do not count."""

import pytest

from benchmark.report.content import make_report
from benchmark.report.paper import impossible_sum, printed
from benchmark.report.wording import not_counted
from benchmark.results.reading import read_results
from tests.hand_made_results import (
    SOCIAL,
    agent_episodes,
    write_degenerate,
    write_experiment,
    write_run,
)
from tests.measuring import following, meeting, sums


def met(episode):
    return sums("social_encounters", episode)["met_social"]


class TestEncounters:
    def test_a_conflict_with_a_social_vehicle_counts(self, tmp_path):
        assert met(meeting(tmp_path, [10.0] * 60, [10.0] * 60)) == 1.0

    @pytest.mark.parametrize(("gap", "found"), [(9.9, 1.0), (10.1, 0.0)])
    def test_a_leader_counts_within_two_seconds(self, tmp_path, gap, found):
        # Both at 5 m/s.
        assert met(following(tmp_path, speed=5.0, steps=10, gap=gap)) == found


def test_what_is_odd_about_the_papers_figures(tmp_path):
    write_experiment(tmp_path, algorithms=["ppo", "dqn", "maddpg"])
    for name in ("ppo", "dqn", "maddpg"):
        write_run(tmp_path, name, [agent_episodes([["goal"]] * 200, mode="greedy")])
    write_degenerate(tmp_path)
    report = make_report(read_results(tmp_path))
    cells = {row.algorithm: row.cells[0] for row in report.main_table("greedy")}
    assert [cells[name].counts for name in ("ppo", "dqn", "maddpg")] == [False, True, True]
    assert "not counted" in not_counted(cells["ppo"])
    assert "0.17" in not_counted(cells["ppo"])
    assert not_counted(cells["dqn"]) == "the paper's two rates sum to 1.03"
    assert not_counted(cells["maddpg"]) == ""
    assert impossible_sum(printed("maac", "double_merge", SOCIAL)) == "the paper's two rates sum to 1.02"
