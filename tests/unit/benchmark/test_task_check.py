"""Whether tasks tell good driving from bad, on results written by hand."""

import numpy as np
import pytest

from benchmark.report.task_check import score_table, task_checks
from benchmark.results.reading import read_results
from tests.hand_made_results import ALONE, SOCIAL, agent_episodes, write_experiment, write_run

COUNT = 100


def table(goals, traffic, seconds, reward):
    """Return 100 episodes of one agent, the first `goals` of which reach the goal; others collide."""
    ends = [["goal"]] * goals + [["collision"]] * (COUNT - goals)
    found = agent_episodes(ends, mode="scripted", task_traffic=traffic)
    found["seconds"] = np.asarray(seconds, float)
    found["return"] = np.arange(COUNT) % 7 + np.asarray(reward, float)
    return found


def check(root, *, completion=95, random=40, blind=30, creeping=-0.5, crept=60, seconds=20.0):
    """Write and check a cell with traffic; on empty roads the rule-based policy always arrives after 10 s."""
    policies = ["gap_acceptance", "random", "empty_road", "creep"]
    write_experiment(root, traffic=[ALONE, SOCIAL], scripted=policies)
    cells = {
        ("gap_acceptance", ALONE): table(COUNT, ALONE, 10.0, 0.0),
        ("gap_acceptance", SOCIAL): table(completion, SOCIAL, seconds, 0.0),
        ("random", SOCIAL): table(random, SOCIAL, 10.0, -2.0),
        ("empty_road", SOCIAL): table(blind, SOCIAL, 10.0, -2.0),
        # Differences that are all alike have no interval.
        ("creep", SOCIAL): table(crept, SOCIAL, 50.0, creeping + 0.01 * (np.arange(COUNT) % 2)),
    }
    for (policy, traffic), rows in cells.items():
        write_run(root, policy, [rows], traffic=traffic, seed=-1)
    results = read_results(root)
    (found,) = [each for each in task_checks(results) if each.traffic == SOCIAL]
    return found, score_table(results)


def test_a_good_cell_passes(tmp_path):
    found, scores = check(tmp_path)
    assert found.failures == []
    assert found.completion == pytest.approx(0.95)
    assert found.behind["random"].value == pytest.approx(0.55)
    assert found.behind["empty_road"].value == pytest.approx(0.65)
    assert found.creeping["return"].value == pytest.approx(0.495)
    assert found.creeping["completion"].value == pytest.approx(0.35)
    assert found.equal == {"gap_acceptance": 0.0}
    assert "passes" in str(found)
    assert f"| intersection | {SOCIAL} | gap_acceptance | 0.05 | 0.95 |  | 20.0 |" in scores


@pytest.mark.parametrize(
    ("changes", "failure"),
    [
        ({"completion": 89}, "gap_acceptance completes 0.890"),
        ({"random": 86}, "random completes only 0.09 less"),
        ({"blind": 95}, "empty_road completes only 0.00 less"),
        ({"creeping": 0.495}, "creep has a return only -0.50 below"),
        ({"crept": 93}, "creep has a completion only 0.02 below"),
        ({"seconds": 10.04}, "gap_acceptance ends as on empty roads in 0.95"),
    ],
)
def test_what_a_cell_lacks_is_said(tmp_path, changes, failure):
    found, _ = check(tmp_path, **changes)
    (said,) = found.failures
    assert said.startswith(failure)
    assert f"FAILS: {said}" in str(found)


def test_half_of_the_episodes_may_end_as_on_empty_roads(tmp_path):
    halves = np.where(np.arange(COUNT) < 50, 10.0, 20.0)
    found, _ = check(tmp_path, completion=COUNT, seconds=halves)
    assert found.equal == {"gap_acceptance": 0.5}
    assert found.failures == []
