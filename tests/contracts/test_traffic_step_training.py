"""The comparison of policies trained with and without a longer step of the traffic."""

import numpy as np
import pytest
from scipy.stats import ttest_ind

from benchmark.results.reading import read_results
from perf import traffic_step_training as comparison
from tests.blocks import ROOT


def test_the_difference_is_welchs():
    rng = np.random.Generator(np.random.Philox(5))
    exact, longer = rng.random(3), rng.random(4)
    found = comparison.gap(exact, longer, 1)
    expected = ttest_ind(longer, exact, equal_var=False)
    interval = expected.confidence_interval(0.95)
    assert found.value / found.error == pytest.approx(expected.statistic)
    assert (found.low, found.high) == pytest.approx((interval.low, interval.high))
    assert found.gain == pytest.approx(expected.confidence_interval(0.9).low)
    assert comparison.gap(exact, longer, -1).gain == pytest.approx(-expected.confidence_interval(0.9).high)


def test_one_sided_ends_by_other_ways():
    exact, longer = [0.25, 0.5], [0.5, 0.85]
    # Gaps 0.25 and 0.35: 0.3 +- 6.314 * 0.05.
    assert comparison.gain_by_seed(exact, longer, 1) == pytest.approx(0.3 - 6.3138 * 0.05, abs=1e-4)
    assert comparison.gain_by_seed(exact, longer, -1) == pytest.approx(-0.3 - 6.3138 * 0.05, abs=1e-4)
    # Seeds that agree have Wilson's interval, here of 200 trials each: 0.5 +- 0.0578.
    found = comparison.gain_of_rates([0.5, 0.5], [0.5, 0.5], 1, 100)
    assert found == pytest.approx(-(2**0.5) * 0.0578, abs=1e-4)
    assert comparison.gain_of_rates([0.1, 0.1], [0.9, 0.9], -1, 100) < -0.8


def test_the_page_has_the_comparison_of_the_kept_runs():
    text, is_worse = comparison.page(comparison.read(comparison.CSV))
    assert not is_worse
    assert text in (ROOT / "docs" / "learning.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("longer", "sign", "word"),
    [
        ([0.90, 0.91, 0.92], 1, "non-inferior"),
        ([0.88, 0.89, 0.90], 1, "non-inferior"),
        ([0.50, 0.51, 0.52], 1, "worse"),
        ([0.50, 0.51, 0.52], -1, "better"),
        ([0.70, 0.95, 0.95], 1, "undecided"),
    ],
)
def test_words(longer, sign, word):
    assert comparison.gap([0.90, 0.91, 0.92], longer, sign).word == word


def test_rows_hold_the_rates_of_all_valid_agents():
    (run, *_) = (
        each
        for each in read_results(ROOT / "results" / "paper_track").runs
        if (each.algorithm, each.task, each.traffic) == ("ppo", "intersection_v1", "random_social_vehicles")
    )
    greedy, sampled = comparison.rows_of(run, 0.1)
    played = run.table.query("mode == 'greedy' and split == 'train' and not is_invalid")
    assert greedy.completion == pytest.approx((played["outcome"] == "goal").mean(), abs=1e-4)
    assert greedy.collision == pytest.approx((played["outcome"] == "collision").mean(), abs=1e-4)
    assert (greedy.mode, sampled.mode) == ("greedy", "sampled")
    assert greedy.agent_episodes == len(played)
