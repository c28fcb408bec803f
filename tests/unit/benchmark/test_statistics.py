"""Intervals: how often they hold the truth, and cases that can be worked out by hand."""

import itertools
import math

import numpy as np
import pytest

from benchmark.statistics import (
    arcsine_interval,
    checkpoint_interval,
    design_effect,
    holm,
    interquartile_mean,
    paired_difference,
    resampled_totals,
    sampled_interval,
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


@pytest.mark.slow
def test_every_cell_is_covered(covered):
    shares = {cell: share for cell, (share, _) in covered.items()}
    assert {cell: share for cell, share in shares.items() if share < 0.91} == {}
    assert 0.93 <= np.mean([*shares.values()]) <= 0.97


@pytest.mark.slow
def test_naive_wilson_fails_where_the_agents_of_an_episode_share_a_fate(covered):
    assert max(naive for cell, (_, naive) in covered.items() if cell[2] == 1.0) < 0.91


def test_design_effect_is_the_agents_of_an_episode_where_they_share_a_fate():
    four, none = np.full(50, 4), np.zeros(50)
    halves = np.where(np.arange(50) % 2, 4, 0)
    assert design_effect(halves, four) == pytest.approx(4.0)
    assert design_effect(none, four) == 4.0
    assert design_effect(np.full(50, 2), four) == 1.0


def test_wilson_of_no_event_in_ten():
    low, high = wilson_interval(0.0, 10.0)
    assert low == 0.0
    assert high == pytest.approx(1.959964**2 / (10 + 1.959964**2))


def test_seeds_that_agree_have_wilsons_interval():
    low, high = arcsine_interval([0.0, 0.0, 0.0], [50.0, 50.0, 50.0])
    assert low == 0.0
    assert high == pytest.approx(float(wilson_interval(0.0, 150.0)[1]))


def test_resampling_keeps_episodes_whole():
    totals = np.array([[1.0, 1.0], [0.0, 2.0], [3.0, 0.0]])
    drawn = resampled_totals(totals, stream(1, Purpose.RESAMPLING), repeats=500)
    sums = {tuple(np.sum(each, axis=0)) for each in itertools.product(totals, repeat=3)}
    assert {tuple(row) for row in drawn} <= sums
    assert len({tuple(row) for row in drawn}) > 5
    assert sampled_interval(np.append(np.arange(101.0), np.nan)) == pytest.approx((2.5, 97.5))


def test_holm_and_interquartile_mean():
    assert holm([0.01, 0.04, np.nan, 0.03]) == pytest.approx([0.03, 0.06, np.nan, 0.06], nan_ok=True)
    assert interquartile_mean([0.0, 1.0, 2.0, 100.0, np.nan]) == pytest.approx(1.5)
    # Of five values, the second and the fourth count by three quarters.
    assert interquartile_mean([0.0, 1.0, 2.0, 4.0, 9.0]) == pytest.approx((0.75 + 2.0 + 3.0) / 2.5)


def test_paired_differences():
    first = np.array([[1.0, 0.5, 1.0, np.nan], [1.0, 1.0, 0.5, 1.0]])
    found = paired_difference(first, np.zeros((2, 4)))
    assert (found.pairs, found.is_tie) == (4, False)
    assert found.value == pytest.approx((1.0 + 0.75 + 0.75 + 1.0) / 4)
    seeds = paired_difference(np.array([[0.2, 0.4], [0.1, 0.1], [-0.3, 0.0]]), np.zeros((3, 2)))
    assert (seeds.pairs, seeds.is_tie) == (3, True)
    assert seeds.value == pytest.approx((0.3 + 0.1 - 0.15) / 3)


def test_two_equal_differences_prove_nothing_and_two_hundred_do():
    assert paired_difference(np.ones((1, 2)), np.zeros((1, 2))).is_tie
    assert not paired_difference(np.ones((1, 200)), np.zeros((1, 200))).is_tie
