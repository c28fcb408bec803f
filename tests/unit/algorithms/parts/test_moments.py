"""Running moments against those of the samples themselves."""

import pytest
import torch

from algorithms.parts.moments import RunningMoments


@pytest.mark.parametrize(("mean", "std"), [(-3.0, 50.0), (1e4, 1.0)])
def test_values_are_standardised_whatever_their_mean(mean, std):
    generator = torch.Generator().manual_seed(1)
    moments = RunningMoments(enabled=True)
    for _ in range(5):
        x = mean + std * torch.randn(4000, generator=generator, dtype=torch.float64)
        moments.observe(x.float(), torch.ones(4000, dtype=torch.bool))
    scaled = moments.scaled(x.float())
    assert scaled.dtype == torch.float32
    assert float(scaled.mean()) == pytest.approx(0, abs=0.05)
    assert float(scaled.std()) == pytest.approx(1, rel=0.05)
    torch.testing.assert_close(moments.unscaled(scaled).double(), x, rtol=1e-6, atol=1e-4 * std)


def test_only_what_is_there_counts_and_averages_forget():
    moments = RunningMoments(enabled=True, decay=0.5)
    seen = torch.tensor([True, True, False])
    for x in ([0.0, 2.0, 1e9], [4.0, 8.0, -1e9]):
        moments.observe(torch.tensor(x), seen)
    # Means 1 and 6, mean squares 2 and 40, of the weights 1/4 and 1/2.
    mean, square = (1 / 4 + 6 / 2) / 0.75, (2 / 4 + 40 / 2) / 0.75
    expected = (torch.tensor([1.0]) - mean) / (square - mean**2) ** 0.5
    torch.testing.assert_close(moments.scaled(torch.tensor([1.0])), expected)


def test_without_moments_values_are_as_they_are():
    off, new = RunningMoments(enabled=False), RunningMoments(enabled=True)
    x = torch.tensor([5.0, -1.0])
    off.observe(x, torch.ones(2, dtype=torch.bool))
    for each in (off, new):
        assert torch.equal(each.scaled(x), x)
        assert torch.equal(each.unscaled(x), x)
