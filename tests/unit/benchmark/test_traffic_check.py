"""Whether social vehicles matter in a condition."""

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from benchmark.report.content import make_report
from benchmark.report.paper import impossible_sum, printed
from benchmark.report.traffic_check import traffic_checks
from benchmark.report.wording import not_counted, standing
from benchmark.results.reading import read_results
from tests.hand_made_results import (
    ALONE,
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


def write(root, *, collisions, by_random=0, share=None):
    """Write scripted policies' runs: naive ones collide in so many of 100 episodes more with traffic.

    Otherwise the task is good: gap acceptance arrives, later than on empty roads; random driving does not.

    Args:
        root: Folder of the results.
        collisions: Of keep-lane.
        by_random: Of random driving; None: it is not played.
        share: Of gap acceptance's agent-episodes with a social vehicle; None: its table does not say.
    """
    write_experiment(root, traffic=[ALONE, SOCIAL], scripted=["keep_lane", "random", "gap_acceptance"])
    for traffic in (ALONE, SOCIAL):
        for name, more in (("keep_lane", collisions), ("random", by_random)):
            if more is not None:
                count = 10 + more * (traffic == SOCIAL)
                other = "goal" if name == "keep_lane" else "off_route"
                outcomes = [["collision"]] * count + [[other]] * (100 - count)
                table = agent_episodes(outcomes, mode="scripted", task_traffic=traffic)
                write_run(root, name, [table], traffic=traffic, seed=-1)
        drove = agent_episodes([["goal"]] * 100, mode="scripted", task_traffic=traffic)
        drove["seconds"] = 20.0 if traffic == SOCIAL else 10.0
        drove["met_social"] = (np.arange(100) < 100 * (share or 0.0)) * float(traffic == SOCIAL)
        drove = drove.drop(columns="met_social") if share is None else drove
        write_run(root, "gap_acceptance", [drove], traffic=traffic, seed=-1)


@pytest.mark.parametrize(
    ("collisions", "by_random", "share", "is_one"),
    [
        (30, 0, 0.8, True),
        (2, 2, 0.8, False),
        (9, 2, 0.8, None),  # the interval reaches beyond 0.10
        (0, 0, 0.0, False),
        (30, 0, None, None),
        (2, None, 0.8, None),  # random driving might collide
    ],
)
def test_what_a_cell_with_social_vehicles_is(tmp_path, collisions, by_random, share, is_one):
    write(tmp_path, collisions=collisions, by_random=by_random, share=share)
    (check,) = traffic_checks(read_results(tmp_path))
    assert (check.task, check.traffic, check.passes) == ("intersection", SOCIAL, is_one)
    assert check.differences["keep_lane"].value == pytest.approx(collisions / 100)
    assert check.differences["keep_lane"].pairs == 100
    assert check.share == pytest.approx(share) if share is not None else np.isnan(check.share)
    done = CliRunner().invoke(app, ["check-traffic", str(tmp_path)])
    assert done.exit_code == (0 if is_one else 1)
    assert {True: ": passes", False: ": FAILS", None: ": not known"}[is_one] in done.stdout


@pytest.mark.parametrize("episodes", [1, 2, 4])
def test_a_few_episodes_do_not_tell(tmp_path, episodes):
    write_experiment(tmp_path, traffic=[ALONE, SOCIAL], scripted=["keep_lane", "random", "gap_acceptance"])
    for traffic, end in ((ALONE, "goal"), (SOCIAL, "collision")):
        for name in ("keep_lane", "random", "gap_acceptance"):
            ends = [["goal" if name == "gap_acceptance" else end]] * episodes
            table = agent_episodes(ends, mode="scripted", task_traffic=traffic)
            table["met_social"] = 1.0
            write_run(tmp_path, name, [table], traffic=traffic, seed=-1)
    (check,) = traffic_checks(read_results(tmp_path))
    assert check.differences["keep_lane"].value == 1.0
    assert (check.collides, check.meets, check.passes) == (None, True, None)


def test_a_cell_that_is_one_in_name_only_is_not_counted_against_the_paper(tmp_path):
    write(tmp_path, collisions=2, by_random=2, share=0.9)
    for traffic in (ALONE, SOCIAL):
        drove = agent_episodes([["goal"]] * 100, mode="greedy", task_traffic=traffic)
        write_run(tmp_path, "maddpg", [drove], traffic=traffic)
        write_degenerate(tmp_path, "parked", traffic=traffic)
    report = make_report(read_results(tmp_path))
    (maddpg,) = (row for row in report.main_table("greedy") if row.algorithm == "maddpg")
    assert [(cell.traffic, cell.counts) for cell in maddpg.cells] == [(ALONE, True), (SOCIAL, False)]
    said = " ".join(standing(report))
    assert "Social vehicles hardly matter in intersection" in said
    assert "in 1 of 1 conditions that count" in said
    assert "not counted: Intersection, Random Social Vehicle: MADDPG (" in said
    assert "hardly differs from the condition without social vehicles" in said


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
