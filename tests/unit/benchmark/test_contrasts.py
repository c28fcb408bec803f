"""Contrasts: what an experiment has fixed to compare, by training seeds."""

import math

import numpy as np
import pytest
from scipy.stats import ttest_ind

from benchmark.experiment.config import read_experiment
from benchmark.experiment.models import Experiment
from benchmark.report.content import make_report
from benchmark.report.contrasts import contrasts_of, power
from benchmark.report.writing import write_report
from benchmark.results.commands import keep_command
from benchmark.results.reading import read_results
from smarts.config import ConfigError
from tests.hand_made_results import agent_episodes, write_experiment, write_run

COMPLETED = {
    "ppo": {"a": (6, 7, 8), "b": (4, 5, 9)},
    "dqn": {"a": (2, 3, 3), "b": (9, 1, 2)},
    "a2c": {"a": (5,)},
}
"""Completed of ten, by algorithm, condition and seed."""
CONTRASTS = {"pairs": [["dqn", "ppo"], ["ppo", "dqn"], ["a2c", "ppo"]], "conditions": ["a", "b"]}
TASK = {
    "name": "intersection",
    "scenarios": ["intersection"],
    "test": [{"name": name, "scenarios": ["intersection"], "seen": True} for name in "ab"],
}


def write(root, **more):
    given = {"algorithms": [*COMPLETED], "tasks": [TASK], "seeds": [1, 2, 3], "contrasts": CONTRASTS}
    write_experiment(root, **given | more)
    for algorithm, conditions in COMPLETED.items():
        for seed in range(len(conditions["a"])):
            write_tests(root, algorithm, seed + 1, {name: each[seed] for name, each in conditions.items()})


def write_tests(root, algorithm, seed, completed):
    """Write a run that has completed some of ten episodes in each condition."""
    tables = [
        agent_episodes(
            [["goal"]] * count + [["collision"]] * (10 - count),
            **{"mode": "greedy", "split": "test", "condition": name},
        )
        for name, count in completed.items()
    ]
    write_run(root, algorithm, tables, seed=seed)


def test_they_are_of_training_seeds_over_the_conditions_and_corrected_for_their_number(tmp_path):
    write(tmp_path)
    found = contrasts_of(make_report(read_results(tmp_path)))
    of_seeds = {
        name: np.mean([COMPLETED[name][each] for each in "ab"], axis=0) / 10 for name in ("ppo", "dqn")
    }
    assert found[0].seeds[0] == pytest.approx(of_seeds["dqn"])
    expected = ttest_ind(of_seeds["dqn"], of_seeds["ppo"], equal_var=False).pvalue
    assert [each.p_value for each in found[:2]] == pytest.approx([expected] * 2)
    assert math.isnan(found[2].p_value)  # it has not finished the second condition
    text, rows = contrasts_in(tmp_path)
    assert rows[0][7] == f"{min(1.0, 3 * expected):.3f}"  # of all three, though one is not finished
    assert [row[8] for row in rows] == ["3 / 3", "3 / 3", "0 / 3"]
    assert "NOT those of the first" not in text
    assert "A later command" not in text


def test_what_has_not_begun_in_another_traffic_counts(tmp_path):
    write(tmp_path, traffic=["no_social_vehicles", "random_social_vehicles"])
    found = contrasts_of(make_report(read_results(tmp_path)))
    assert len(found) == 6
    _, rows = contrasts_in(tmp_path)
    assert rows[0][7] == f"{min(1.0, 6 * found[0].p_value):.3f}"


def test_without_spread_the_difference_is_shown(tmp_path):
    pairs = {**CONTRASTS, "pairs": [["qmix", "vdn"]]}
    write_experiment(tmp_path, algorithms=["qmix", "vdn"], tasks=[TASK], seeds=[1, 2], contrasts=pairs)
    for algorithm, count in (("qmix", 8), ("vdn", 5)):
        for seed in (1, 2):
            write_tests(tmp_path, algorithm, seed, {"a": count, "b": count})
    _, rows = contrasts_in(tmp_path)
    assert rows[0][4:7] == ["+0.30", "no spread", ""]


def test_a_later_command_does_not_take_them_away(tmp_path):
    write(tmp_path)
    before = read_results(tmp_path)
    given = {"algorithms": [*COMPLETED], "tasks": [TASK], "seeds": [1, 2, 3], "name": tmp_path.name}
    keep_command(tmp_path, Experiment(**given), "smarts-bench run hand.yaml --set contrasts=null")
    after = read_results(tmp_path)
    assert after.contrasts == before.contrasts
    text, rows = contrasts_in(tmp_path)
    assert len(rows) == 3
    assert "A later command has other contrasts, or none; they are not shown." in text
    assert "NOT those of the first" not in text


def contrasts_in(root):
    """Return a report's text, and the rows of its contrasts."""
    text = write_report(root).with_suffix(".md").read_text()
    table = text.partition("## Contrasts")[2].partition("## ")[0]
    rows = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in table.splitlines()]
    return text, [row for row in rows if len(row) > 10][2:]  # without the header


def test_power_is_the_share_of_experiments_in_which_scipy_finds_the_difference():
    seeds = np.array([[0.70, 0.74, 0.78, 0.82, 0.86], [0.50, 0.51, 0.52, 0.53, 0.54]])
    draws = np.random.default_rng(1)
    for gap, level in ((0.0, 0.05), (0.1, 0.05), (0.2, 0.005)):
        sides = [draws.normal(0.0, each.std(ddof=1), (5000, 5)) for each in seeds]
        found = ttest_ind(sides[0] + gap, sides[1], axis=1, equal_var=False).pvalue < level
        assert power(seeds, gap, level) == pytest.approx(found.mean(), abs=0.04)


@pytest.mark.parametrize(
    ("contrasts", "said"),
    [
        (
            "{pairs: [[dqn, ppo]], conditions: [fa]}",
            r"conditions\[0\]: no test has the condition 'fa'; did you mean",
        ),
        ("{pairs: [[dqn, ppo]], conditions: [far, near]}", "conditions: no task has all of them"),
        ("{pairs: [[dqn, ppo]], conditions: [far], metric: generalization}", "metric: generalization is of"),
    ],
)
def test_what_no_report_can_compare_is_named(tmp_path, contrasts, said):
    file = tmp_path / "mine.yaml"
    file.write_text(
        "algorithms: [ppo, dqn]\nseeds: [1]\ntasks:\n"
        "  - {name: mine, train: [loop], test: [{name: far, scenarios: [city]}]}\n"
        "  - {name: other, train: [loop], test: [{name: near, scenarios: [two_way]}]}\n"
        f"contrasts: {contrasts}\n"
    )
    with pytest.raises(ConfigError, match=said):
        read_experiment(file)
