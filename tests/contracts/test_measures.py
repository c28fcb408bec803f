"""Every registered metric: columns of one number per agent, a value of their sums, in bounds."""

import numpy as np
import pytest

from benchmark.metrics.registry import METRICS
from tests.measuring import QUICKLY, SLOWLY, following, meeting, parked


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    """Return episodes with an encounter, a leader, and an agent that stands."""
    folder = tmp_path_factory.mktemp("episodes")
    return [meeting(folder / "a", SLOWLY, QUICKLY), following(folder / "b"), parked(folder / "c")]


def sums_of(metric, *episodes):
    """Return the sums of the columns that a metric needs."""
    sums = {"agents": float(sum(episode.entered.sum() for episode in episodes))}
    for episode in episodes:
        for name, column in metric.measure(episode).items():
            sums[name] = sums.get(name, 0.0) + column[episode.entered].sum()
    return {name: np.array(value) for name, value in sums.items()}


@pytest.mark.parametrize("name", METRICS)
def test_columns_are_a_finite_number_per_agent(name, episodes):
    metric = METRICS[name]
    for episode in episodes:
        columns = metric.measure(episode)
        assert {*metric.columns} <= {*columns}
        assert {*metric.count} <= {*columns, "agents"}
        for column, values in columns.items():
            assert values.shape == episode.entered.shape, column
            assert np.isfinite(values[episode.entered]).all(), column


@pytest.mark.parametrize("name", METRICS)
def test_the_value_is_one_of_sums(name, episodes):
    metric = METRICS[name]
    one, twice = sums_of(metric, *episodes), sums_of(metric, *episodes, *reversed(episodes))
    value = metric.of_whole(one)
    assert value.shape == ()
    # Shares and means of sums do not change where every episode counts twice.
    np.testing.assert_allclose(metric.of_whole(twice), value, equal_nan=True)
    if metric.is_share:
        assert np.isnan(value) or 0.0 <= value <= 1.0


@pytest.mark.parametrize("name", METRICS)
def test_nothing_to_measure_is_no_number(name, episodes):
    metric = METRICS[name]
    empty = {column: np.array(0.0) for column in sums_of(metric, episodes[0])}
    assert np.isnan(metric.known(empty) if metric.least else metric.of_whole(empty))


@pytest.mark.parametrize("name", METRICS)
def test_reports_have_their_texts(name):
    metric = METRICS[name]
    assert metric.label
    assert metric.meaning
    assert metric.missing
    assert metric.better in ("higher", "lower", None)
