"""Whether tasks tell good driving from bad, on results written by hand."""

import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmark.cli import app
from benchmark.metrics import read_table, write_table
from benchmark.report.task_check import score_table, task_checks
from benchmark.results.reading import read_results
from tests.hand_made_results import ALONE, SOCIAL, agent_episodes, write_experiment, write_run

COUNT = 100


def table(goals, traffic, seconds, reward, count=COUNT):
    """Return episodes of one agent, the first `goals` of which reach the goal; others collide."""
    ends = [["goal"]] * goals + [["collision"]] * (count - goals)
    found = agent_episodes(ends, mode="scripted", task_traffic=traffic)
    found["seconds"] = np.asarray(seconds, float)
    found["return"] = np.arange(count) % 7 + np.asarray(reward, float)
    found["met_social"] = float(traffic == SOCIAL)
    return found


def check(
    root,
    *,
    completion=95,
    random=40,
    blind=30,
    creeping=-0.5,
    crept=60,
    seconds=20.0,
    count=COUNT,
    vary=0.01,
    is_invalid=False,
    without=(),
):
    """Write and check a cell with traffic; on empty roads the rule-based policy always arrives after 10 s.

    Args:
        root: Folder of the results.
        completion: Episodes that the rule-based policy completes.
        random: Those that random driving completes.
        blind: Those that empty-road driving completes.
        creeping: Its return minus that of the rule-based policy, every second time larger by `vary`.
        crept: Episodes that creeping completes.
        seconds: Durations of the rule-based policy's episodes.
        count: Number of episodes.
        is_invalid: Whether the rule-based policy's episodes are invalid.
        without: Policy and traffic that are not played.
    """
    policies = ["gap_acceptance", "random", "empty_road", "creep"]
    write_experiment(root, traffic=[ALONE, SOCIAL], scripted=policies)
    lower = creeping + vary * (np.arange(count) % 2)
    cells = {
        ("gap_acceptance", ALONE): table(count, ALONE, 10.0, 0.0, count),
        ("gap_acceptance", SOCIAL): table(completion, SOCIAL, seconds, 0.0, count),
        ("random", SOCIAL): table(random, SOCIAL, 10.0, -2.0, count),
        ("empty_road", SOCIAL): table(blind, SOCIAL, 10.0, -2.0, count),
        ("creep", SOCIAL): table(crept, SOCIAL, 50.0, lower, count),
    }
    for (policy, traffic), rows in cells.items():
        if policy == "gap_acceptance":
            rows["is_invalid"] = is_invalid
        if (policy, traffic) != without:
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
        ({"random": 93}, "random has 0.02 less completion"),
        ({"blind": 95}, "empty_road has 0.00 less completion"),
        ({"creeping": 0.495}, "creep has -0.50 less return"),
        ({"crept": 95}, "creep has 0.00 less completion"),
        ({"seconds": 10.04}, "gap_acceptance ends as on empty roads in 0.95"),
    ],
)
def test_what_a_cell_lacks_is_said(tmp_path, changes, failure):
    found, _ = check(tmp_path, **changes)
    (said,) = found.failures
    assert said.startswith(failure)
    assert f"FAILS: {said}" in str(found)
    assert found.passes is False


@pytest.mark.parametrize(
    ("changes", "unknown"),
    [
        ({"random": 86}, "random has 0.09 less completion (p = 0.00"),  # the interval reaches beyond 0.10
        ({"crept": 93}, "creep has 0.02 less completion (p = 0."),
        ({"without": ("random", SOCIAL)}, "random was not played"),
        ({"without": ("empty_road", SOCIAL)}, "empty_road was not played"),
        (
            {"without": ("gap_acceptance", ALONE)},
            "gap_acceptance was not played both here and on empty roads",
        ),
    ],
)
def test_what_is_not_known_of_a_cell_is_said(tmp_path, changes, unknown):
    found, _ = check(tmp_path, **changes)
    assert found.failures == []
    (said,) = found.unknown
    assert said.startswith(unknown)
    assert f"not known: {said}" in str(found)
    assert found.passes is None


def test_what_was_not_measured_is_not_known(tmp_path):
    """As with `metrics: [completion_rate, collision_rate]`."""
    check(tmp_path)
    for file in tmp_path.rglob("episodes.parquet"):
        rows = read_table(file)
        write_table(rows.drop(columns=["return", "seconds", "met_social", "ended_time_out"]), file)
    done = CliRunner().invoke(app, ["check-traffic", str(tmp_path)])
    assert done.exit_code == 1
    assert "creep was not played beside gap_acceptance, or its return is not measured" in done.stdout
    assert "| gap_acceptance | 0.05 | 0.95 |  | n/a | n/a |" in done.stdout


def test_equal_differences_in_return_do_not_fail_creeping(tmp_path):
    found, _ = check(tmp_path, vary=0.0)
    assert found.creeping["return"].value == 0.5
    assert np.isnan(found.creeping["return"].p_value)
    assert found.unknown == ["creep has 0.50 less return (no p, 100 episodes)"]


def test_a_large_difference_over_few_episodes_says_its_p(tmp_path):
    found, _ = check(tmp_path, count=3, completion=3, random=0, blind=0, crept=0)
    assert found.behind["random"].value == 1.0
    assert found.failures == []
    assert any(said.startswith("random has 1.00 less completion (p = 0.0") for said in found.unknown)
    assert found.passes is None


def test_without_valid_or_any_episodes_nothing_is_known(tmp_path):
    found, _ = check(tmp_path, is_invalid=True)
    assert np.isnan(found.completion)
    assert "gap_acceptance was not played" in found.unknown
    assert found.passes is None
    for folder in sorted(tmp_path.rglob("run.json")):
        shutil.rmtree(folder.parent)
    checks = task_checks(read_results(tmp_path))
    assert [(each.traffic, each.passes) for each in checks] == [(ALONE, None), (SOCIAL, None)]


@pytest.mark.parametrize(
    ("names", "is_asked"),
    [(["gap_acceptance", "random"], False), (["gap_acceptance", "creep"], True), (["empty_road"], True)],
)
def test_tasks_are_checked_only_where_a_policy_made_for_it_is_named(tmp_path, names, is_asked):
    write_experiment(tmp_path, traffic=[ALONE], scripted=names)
    for name in names:
        write_run(tmp_path, name, [table(COUNT, ALONE, 10.0, 0.0)], seed=-1)
    done = CliRunner().invoke(app, ["check-traffic", str(tmp_path)])
    assert ("tasks are not checked" in done.stdout) is not is_asked
    assert (f"intersection, {ALONE}: " in done.stdout) is is_asked
    assert done.exit_code == 1  # no check was asked for, or one does not pass


def test_the_command_passes_only_where_both_checks_do(tmp_path):
    check(tmp_path)
    # No naive policy was played on empty roads: the traffic check is not known.
    arguments = ["check-traffic", str(tmp_path)]
    assert CliRunner().invoke(app, arguments).exit_code == 1
    for name, rows in (("random", 80), ("keep_lane", 100), ("empty_road", 100), ("creep", 100)):
        alone = table(rows, ALONE, 10.0, -2.0)
        alone["return"] = -2.0 - np.arange(COUNT) % 5
        write_run(tmp_path, name, [alone], seed=-1)
    write_run(tmp_path, "keep_lane", [table(10, SOCIAL, 5.0, -2.0)], traffic=SOCIAL, seed=-1)
    done = CliRunner().invoke(app, arguments)
    assert ": passes" in done.stdout
    assert done.exit_code == 0, done.stdout
    shutil.rmtree(tmp_path / "scripted" / "creep")
    assert CliRunner().invoke(app, arguments).exit_code == 1


def test_half_of_the_episodes_may_end_as_on_empty_roads(tmp_path):
    halves = np.where(np.arange(COUNT) < 50, 10.0, 20.0)
    found, _ = check(tmp_path, completion=COUNT, seconds=halves)
    assert found.equal == {"gap_acceptance": 0.5}
    assert found.failures == []
