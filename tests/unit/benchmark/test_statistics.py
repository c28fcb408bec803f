"""Intervals: how often they hold the truth, and cases that can be worked out by hand."""

import itertools
import math

import numpy as np
import pytest

from benchmark.statistics import (
    arcsine_interval,
    bootstrap_counts,
    bootstrap_interval,
    checkpoint_interval,
    holm,
    interquartile_mean,
    paired_difference,
    performance_profile,
    probability_of_improvement,
    stratified_interval,
    wilson_interval,
)
from smarts.types.streams import Purpose, stream

EPISODES, AGENTS, REPEATS = 100, 4, 1000
CELLS: list[tuple[int, float, float, bool]] = [
    *itertools.product((1, 3, 5), (0.02, 0.2, 0.5), (0.0, 0.3, 1.0), (False, True))
]


def successes(draws, seeds: int, p: float, correlation: float, spread: bool):
    """Return the rate of each seed, and the agents of each episode to whom it happened."""
    rates = np.full((REPEATS, seeds), p)
    if spread:
        # Beta with mean p and standard deviation p / 2.
        total = p * (1 - p) / (p / 2) ** 2 - 1
        rates = draws.beta(p * total, (1 - p) * total, size=rates.shape)
    shape = (REPEATS, seeds, EPISODES)
    shared = draws.random(shape)[..., None] < rates[..., None, None]
    own = draws.random((*shape, AGENTS)) < rates[..., None, None]
    is_shared = draws.random((*shape, AGENTS)) < math.sqrt(correlation)
    return rates, np.where(is_shared, shared, own).sum(axis=-1)


def coverage(seeds: int, p: float, correlation: float, spread: bool) -> tuple[float, float]:
    """Return how often the interval holds the truth, and how often Wilson's does."""
    number = CELLS.index((seeds, p, correlation, spread))
    rates, hits = successes(stream(7, Purpose.AGENTS, world=number), seeds, p, correlation, spread)
    agents = np.full(hits.shape, AGENTS)
    seed_means = hits.mean(axis=-1) / AGENTS
    if seeds == 1:
        low, high = checkpoint_interval(hits[:, 0], agents[:, 0])
        truth = rates[:, 0]
    else:
        low, high = arcsine_interval(seed_means, agents.sum(axis=-1) / AGENTS)
        truth = np.full(REPEATS, p)
    naive_low, naive_high = wilson_interval(seed_means.mean(axis=-1), seeds * EPISODES * AGENTS)
    holds = (low <= truth) & (truth <= high)
    return holds.mean(), ((naive_low <= truth) & (truth <= naive_high)).mean()


@pytest.fixture(scope="module")
def covered():
    return {cell: coverage(*cell) for cell in CELLS}


@pytest.mark.nightly
def test_every_cell_is_covered(covered):
    shares = {cell: share for cell, (share, _) in covered.items()}
    assert {cell: share for cell, share in shares.items() if share < 0.91} == {}
    assert 0.93 <= np.mean([*shares.values()]) <= 0.97


def test_wilson_of_no_event_in_ten():
    low, high = wilson_interval(0.0, 10.0)
    assert low == 0.0
    assert high == pytest.approx(1.959964**2 / (10 + 1.959964**2))


def test_resampling_keeps_episodes_whole():
    totals = np.array([[1.0, 1.0], [0.0, 2.0], [3.0, 0.0]])
    drawn = bootstrap_counts([0, 0, 0], stream(1, Purpose.RESAMPLING), repeats=500) @ totals
    sums = {tuple(np.sum(each, axis=0)) for each in itertools.product(totals, repeat=3)}
    assert {tuple(row) for row in drawn} <= sums
    assert len({tuple(row) for row in drawn}) > 5
    assert bootstrap_interval(np.append(np.arange(101.0), np.nan)) == pytest.approx((2.5, 97.5))


def test_holm_and_interquartile_mean():
    assert holm([0.01, 0.04, np.nan, 0.03]) == pytest.approx([0.03, 0.06, np.nan, 0.06], nan_ok=True)
    assert interquartile_mean([0.0, 1.0, 2.0, 100.0, np.nan]) == pytest.approx(1.5)
    # A quarter of five, rounded down, is one value at each end.
    assert interquartile_mean([0.0, 1.0, 2.0, 4.0, 9.0]) == pytest.approx((1.0 + 2.0 + 4.0) / 3)


def test_a_difference_by_hand():
    found = paired_difference([0.0, 1.0, 2.0])
    # Mean 1, standard error 1 / sqrt(3), Student's quantile of 2 degrees of freedom 4.302653.
    reach = 4.302653 / math.sqrt(3)
    assert (found.value, found.low, found.high) == pytest.approx((1.0, 1 - reach, 1 + reach))
    # P(|T| > t) with 2 degrees of freedom is 1 - t / sqrt(2 + t^2), t = sqrt(3).
    assert found.p_value == pytest.approx(1 - math.sqrt(3 / 5))
    assert found.pairs == 3


def test_starts_that_all_agree_are_as_certain_as_they_are_many():
    # Agresti and Min with K starts: ((K + 1) - K^2 / (K + 2)) / (K + 2)^2, for 12 it is 38 / 14^3.
    twelve = paired_difference(np.ones(12), is_share_of_counts=True)
    assert twelve.value == 1.0
    assert twelve.low == pytest.approx(1 - 2.200985 * math.sqrt(38 / 14**3))
    assert twelve.high == 1.0
    p_values = [paired_difference(np.ones(count), True).p_value for count in (2, 3, 4, 12, 200)]
    assert p_values == sorted(p_values, reverse=True)
    assert p_values[1] > 0.05 > p_values[3] > 1e-6 > p_values[4]
    # A start that disagrees makes no difference more certain.
    assert paired_difference([1.0] * 11 + [0.75], True).p_value > p_values[3]


def test_what_cannot_be_compared():
    for gaps in ([], [0.5]):
        found = paired_difference(gaps, is_share_of_counts=True)
        assert math.isnan(found.p_value)
        assert math.isnan(found.low)
        assert found.pairs == len(gaps)
    alike = paired_difference([2.0, 2.0, 2.0])
    assert alike.value == 2.0
    assert math.isnan(alike.p_value)
    assert paired_difference([0.0, 0.0, 0.0]).p_value == 1.0


@pytest.mark.parametrize(("rate", "other", "starts"), [(0.98, 0.98, 50), (0.8, 0.8, 200), (0.5, 0.5, 12)])
def test_equals_are_told_apart_in_one_of_twenty_at_most(rate, other, starts):
    p_values = simulated(rate, other, starts)
    assert np.mean(p_values < 0.05) <= 0.06


def simulated(rate, other, starts):
    """Return p-values of two checkpoints whose 4 agents at a start end alike half the time."""
    draws = stream(3, Purpose.AGENTS, world=starts)

    def play(p):
        alike = draws.random((1000, starts, 1)) < 0.5
        ends = np.where(alike, draws.random((1000, starts, 1)), draws.random((1000, starts, 4)))
        return (ends < p).mean(axis=-1)

    return np.array([paired_difference(each, True).p_value for each in play(rate) - play(other)])


class TestSummaries:
    """The values are those of rliable 1.2.0."""

    SCORES = np.array([[0.0, 0.5], [0.25, 0.75], [1.0, 1.0], [0.5, 0.25]])

    def test_the_interquartile_mean_is_over_runs_and_tasks(self):
        # Of 0, 0.25, 0.25, 0.5, 0.5, 0.75, 1, 1 the middle four.
        assert interquartile_mean(self.SCORES) == (0.25 + 0.5 + 0.5 + 0.75) / 4

    def test_a_profile_counts_what_is_above(self):
        assert performance_profile(self.SCORES, [-0.1, 0.25, 0.5, 1.0]).tolist() == [1.0, 5 / 8, 3 / 8, 0.0]

    def test_improvement_counts_ties_half(self):
        one, other = np.array([[1.0, 0.5], [0.0, 0.5]]), np.array([[0.5, 0.5]])
        # In the first task 1 of 2 pairs, in the second 2 ties.
        assert probability_of_improvement(one, other) == 0.5
        assert probability_of_improvement(one + 1.0, other) == 1.0
        assert probability_of_improvement(self.SCORES[:3], self.SCORES[1:]) == pytest.approx(
            1.0 - probability_of_improvement(self.SCORES[1:], self.SCORES[:3])
        )

    def test_runs_are_drawn_within_their_task(self):
        # Each task has one value, so that every resample is alike.
        scores = np.tile([0.2, 0.8], (5, 1))
        low, high = stratified_interval(np.mean, stream(1, Purpose.RESAMPLING), scores, repeats=50)
        assert (low, high) == pytest.approx((0.5, 0.5))
        low, high = stratified_interval(interquartile_mean, stream(1, Purpose.RESAMPLING), self.SCORES)
        assert 0.0 < low < 0.5 < high < 1.0
        ends = stratified_interval(
            lambda each: performance_profile(each, [0.1, 0.6]), stream(1, Purpose.RESAMPLING), self.SCORES
        )
        assert np.shape(ends) == (2, 2)
