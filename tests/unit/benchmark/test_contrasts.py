"""Contrasts: what an experiment has fixed to compare, by training seeds."""

import math

import numpy as np
import pytest
from scipy.stats import ttest_ind

from benchmark.experiment.config import read_experiment
from benchmark.report.content import make_report
from benchmark.report.contrasts import contrasts_of, power
from benchmark.report.writing import write_report
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


def write(root, **more):
    write_experiment(root, algorithms=[*COMPLETED], seeds=[1, 2, 3], contrasts=CONTRASTS, **more)
    for algorithm, conditions in COMPLETED.items():
        for seed in range(len(conditions["a"])):
            tables = [
                agent_episodes(
                    [["goal"]] * counts[seed] + [["collision"]] * (10 - counts[seed]),
                    **{"mode": "greedy", "split": "test", "condition": name},
                )
                for name, counts in conditions.items()
            ]
            write_run(root, algorithm, tables, seed=seed + 1)


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
    text = write_report(tmp_path).with_suffix(".md").read_text()
    table = text.partition("## Contrasts")[2].partition("## ")[0]
    rows = [line.strip("| ").split(" | ") for line in table.splitlines() if "PPO | " in line]
    assert rows[0][7] == f"{min(1.0, 2 * expected):.3f}"
    assert [row[8] for row in rows] == ["3 / 3", "3 / 3", "0 / 3"]
    assert "NOT those of the first" not in text


def test_power_is_the_share_of_experiments_in_which_scipy_finds_the_difference():
    seeds = np.array([[0.70, 0.74, 0.78, 0.82, 0.86], [0.50, 0.51, 0.52, 0.53, 0.54]])
    draws = np.random.default_rng(1)
    for gap, level in ((0.0, 0.05), (0.1, 0.05), (0.2, 0.005)):
        sides = [draws.normal(0.0, each.std(ddof=1), (5000, 5)) for each in seeds]
        found = ttest_ind(sides[0] + gap, sides[1], axis=1, equal_var=False).pvalue < level
        assert power(seeds, gap, level) == pytest.approx(found.mean(), abs=0.04)


def test_a_condition_that_no_test_has_is_named(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text(
        "algorithms: [ppo]\ntasks: [{name: mine, train: [loop], test: [{name: far, scenarios: [city]}]}]\n"
        "contrasts: {pairs: [[dqn, ppo]], conditions: [fa]}\n"
    )
    with pytest.raises(
        ConfigError, match=r"contrasts.conditions\[0\]: no test has the condition 'fa'; did you mean"
    ):
        read_experiment(file)
