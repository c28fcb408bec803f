"""Many experiments against each other: ranks, protocols, differences."""

import csv
import re

import pytest
import yaml
from typer.testing import CliRunner

from benchmark.cli import app
from benchmark.report.leaderboard import make_leaderboard, write_leaderboard
from benchmark.report.writing import write_report
from tests.hand_made_results import (
    ALONE,
    BUDGET,
    ENVIRONMENT,
    SOCIAL,
    agent_episodes,
    write_degenerate,
    write_experiment,
    write_run,
)

GOOD = [["goal", "goal"]] * 12
BAD = [["collision", "collision"]] * 12
SLOW = [["time_out", "time_out"]] * 12
ON_NATIVE, MARK = {"traffic_engine": "Native"}, "tested on the traffic engine Native"


def experiment(root, runs, budget=BUDGET, traffic=ALONE, settings=None):
    """Write an experiment with one greedy run for each algorithm."""
    names = [name for name in runs if name != "parked"]
    write_experiment(root, algorithms=names, traffic=[traffic])
    for name, outcomes in runs.items():
        mode, seed = ("scripted", -1) if name == "parked" else ("greedy", 1)
        table = agent_episodes(outcomes, mode=mode, task_traffic=traffic)
        more = {"budget": budget, "traffic": traffic, "settings": settings}
        write_run(root, name, [table], seed=seed, **more)
    return root


def test_ranks_over_experiments(tmp_path):
    one = experiment(tmp_path / "one", {"ppo": GOOD, "dqn": BAD, "parked": SLOW})
    two = experiment(tmp_path / "two", {"ppo": GOOD, "maddpg": SLOW})
    board = make_leaderboard([one, two])
    assert [*board.protocols] == ["A"]
    found = {
        (place.experiment, place.algorithm): (place.standing.rank, place.standing.is_tied)
        for place in board.places
    }
    # Completion decides; where nobody arrives, collisions do.
    assert found == {
        ("one", "ppo"): (1, True),
        ("two", "ppo"): (1, True),
        ("two", "maddpg"): (3, False),
        ("one", "dqn"): (4, False),
        ("one", "parked"): (None, False),
    }
    assert [place.standing.rank for place in board.places] == [1, 1, 3, 4, None]
    paradigms = {place.algorithm: place.paradigm for place in board.places}
    assert paradigms["ppo"] == "fully decentralised"
    assert paradigms["maddpg"] == "centralised training, decentralised execution"
    assert paradigms["parked"] == "scripted policy"


def test_protocols_are_not_mixed(tmp_path):
    one = experiment(tmp_path / "one", {"ppo": GOOD, "parked": SLOW})
    two = experiment(tmp_path / "two", {"dqn": BAD}, budget={"agent_steps": 7, "minutes": None})
    board = make_leaderboard([one, two])
    assert board.protocols == {"A": "budget.agent_steps 1000", "B": "budget.agent_steps 7"}
    assert {(place.algorithm, place.protocol, place.standing.rank) for place in board.places} == {
        ("ppo", "A", None),  # first of one is no rank
        ("parked", "A", None),
        ("dqn", "B", None),
    }
    page = tmp_path / "page.html"
    write_leaderboard([one, two], page, "greedy")
    assert "do not have the same protocol" in page.read_text()


def test_figures_of_another_engine_are_marked(tmp_path):
    sumo, native = tmp_path / "sumo", tmp_path / "native"
    write_experiment(sumo, algorithms=["ppo", "dqn"])
    write_run(sumo, "dqn", [agent_episodes(BAD, mode="greedy")])
    write_run(sumo, "ppo", [agent_episodes(GOOD, mode="greedy")], environment={**ENVIRONMENT, **ON_NATIVE})
    write_experiment(native, algorithms=["ppo"])
    write_run(native, "ppo", [agent_episodes(GOOD, mode="greedy")], environment={**ENVIRONMENT, **ON_NATIVE})
    for root in (sumo, native):
        text = (write_report(root).parent / "report.md").read_text()
        (row,) = [line for line in text.splitlines() if line.startswith("| PPO")][:1]
        assert MARK in row
        assert "rank" not in row
    write_leaderboard([sumo, native], tmp_path / "page.html", "greedy")
    rows = re.findall(r'<tr class="entry".*?</tr>', (tmp_path / "page.html").read_text(), re.DOTALL)
    assert all((MARK in row) == ("PPO" in row) for row in rows)
    assert len(rows) == 6


def of_version_1(root, algorithm, task, agent_steps, sharing):
    """Write a run of version 1 of the benchmark."""
    write_experiment(root, algorithms=[algorithm])
    more = {"budget": {"agent_steps": agent_steps, "minutes": None}, "settings": {"sharing": sharing}}
    run = write_run(root, algorithm, [agent_episodes(GOOD, mode="greedy", task=task)], task=task, **more)
    config = yaml.safe_load((run / "config.yaml").read_text())
    (run / "config.yaml").write_text(yaml.safe_dump(config | {"benchmark_version": 1}))


def test_what_a_version_prescribes_is_one_protocol(tmp_path):
    """Budgets by cell, and an algorithm whose agents do not share."""
    for name, task, steps, sharing in (
        ("dqn", "two_way_v1", 500_000, "all"),
        ("networked_q", "two_way_v1", 500_000, "none"),
        ("dqn", "double_merge_v1", 1_000_000, "all"),
        ("happo", "double_merge_v1", 1_000_000, "none"),
    ):
        of_version_1(tmp_path / "one", name, task, steps, sharing)
    of_version_1(tmp_path / "two", "dqn", "two_way_v1", 1_000_000, "all")
    board = make_leaderboard([tmp_path / "one", tmp_path / "two"])
    found = {
        (place.experiment, place.algorithm, place.task): (
            board.protocols[place.protocol],
            place.standing.rank,
        )
        for place in board.places
    }
    assert found["one", "networked_q", "two_way_v1"][1] == found["one", "dqn", "two_way_v1"][1] == 1
    assert {key: protocol for key, (protocol, _) in found.items()} == {
        ("one", "dqn", "two_way_v1"): "budget of the version, sharing of the version",
        ("one", "networked_q", "two_way_v1"): "budget of the version, sharing of the version",
        ("one", "dqn", "double_merge_v1"): "budget of the version, sharing of the version",
        ("one", "happo", "double_merge_v1"): "budget of the version, sharing none",
        (
            "two",
            "dqn",
            "two_way_v1",
        ): "budget.agent_steps 1000000, budget.minutes none, sharing of the version",
    }


def test_summary_is_the_interquartile_mean_over_conditions(tmp_path):
    one = experiment(tmp_path / "one", {"ppo": [["goal", "collision"]] * 12})
    experiment(tmp_path / "two", {"ppo": GOOD, "dqn": GOOD}, traffic=SOCIAL)
    place = f"ppo/intersection/{SOCIAL}"
    (tmp_path / "two" / place).rename(one / place)
    summary = {
        (each.experiment, each.algorithm): each
        for each in make_leaderboard([one, tmp_path / "two"]).summaries
    }
    # Of 0.5 and 1, half of each counts.
    assert summary["one", "ppo"].completion == pytest.approx(0.75)
    one, two = summary["one", "ppo"], summary["two", "dqn"]
    assert (one.conditions, two.conditions, two.most_conditions) == (2, 1, 2)


def test_a_comparison_names_what_only_one_side_has(tmp_path):
    one = experiment(tmp_path / "one", {"ppo": GOOD, "dqn": GOOD})
    two = experiment(tmp_path / "two", {"ppo": BAD})
    write_run(two, "ppo", [agent_episodes(BAD, mode="greedy", task_traffic=SOCIAL)], traffic=SOCIAL)
    write_degenerate(one, "keep_lane")
    code, said = compared(one, two)
    assert code == 0
    assert "keep_lane" not in said
    end = "the other side has no such finished run"
    assert f"left out: one: dqn, intersection, {ALONE}: {end}" in said
    assert f"left out: two: ppo, intersection, {SOCIAL}: {end}" in said
    assert "< 0.001" in said
    assert end not in compared(one / "ppo", one / "dqn")[1]


def test_two_experiments(tmp_path):
    one = experiment(tmp_path / "one", {"ppo": GOOD, "dqn": GOOD})
    two = experiment(tmp_path / "two", {"ppo": BAD, "dqn": GOOD, "maac": GOOD})
    table = tmp_path / "table.csv"
    done = CliRunner().invoke(app, ["compare", str(one), str(two), "--csv", str(table)])
    assert done.exit_code == 0, done.output
    rows = list(csv.DictReader(table.open()))
    assert [(row["first"], row["second"], row["metric"], row["value"], row["better"]) for row in rows] == [
        ("one: dqn", "two: dqn", "completion_rate", "0", ""),
        ("one: dqn", "two: dqn", "collision_rate", "0", ""),
        ("one: ppo", "two: ppo", "completion_rate", "1", "one: ppo"),
        ("one: ppo", "two: ppo", "collision_rate", "-1", "one: ppo"),
    ]
    assert "+1.000" in done.output
    assert "tie" in done.output


def compared(*arguments):
    """Return exit code and what a comparison says, or its error."""
    done = CliRunner().invoke(app, ["compare", *map(str, arguments)])
    return done.exit_code, done.exception or done.output
