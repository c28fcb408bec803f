"""Distributions of drivers' parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from smarts.sstudio.sstypes.drawing import drawing
from smarts.sstudio.sstypes.identity import Described

if TYPE_CHECKING:
    from numpy.random import Generator


@dataclass(frozen=True, eq=False)
class Distribution(Described):
    """A normal distribution."""

    mean: float
    """The mean."""
    sigma: float
    """The standard deviation; 0 makes a constant."""

    def sample(self, generator: Generator | None = None) -> float:
        """Draw a value, from the stream of the running build unless another is given."""
        return float((generator or drawing().generator).normal(self.mean, self.sigma))


@dataclass(frozen=True, eq=False)
class UniformDistribution(Described):
    """All values between `a` and `b`, whichever is the smaller, are equally likely."""

    a: float
    b: float

    def __post_init__(self) -> None:
        low, high = sorted((self.a, self.b))
        object.__setattr__(self, "a", low)
        object.__setattr__(self, "b", high)

    def sample(self, generator: Generator | None = None) -> float:
        """Draw a value, from the stream of the running build unless another is given."""
        return float((generator or drawing().generator).uniform(self.a, self.b))

    @property
    def mean(self) -> float:
        """The mean."""
        return (self.a + self.b) / 2


@dataclass(frozen=True, eq=False)
class TruncatedDistribution(Described):
    """A normal distribution of mean `loc` and deviation `scale`, cut off at both ends.

    The ends `a` and `b` are given in deviations from the mean, as in `scipy.stats.truncnorm`.
    """

    a: float
    b: float
    loc: float = 0
    scale: float = 1

    def __post_init__(self) -> None:
        low, high = sorted((self.a, self.b))
        object.__setattr__(self, "a", low)
        object.__setattr__(self, "b", high)

    def sample(self, generator: Generator | None = None) -> float:
        """Draw a value, from the stream of the running build unless another is given."""
        from statistics import NormalDist

        normal = NormalDist()
        low, high = normal.cdf(self.a), normal.cdf(self.b)
        share = (generator or drawing().generator).uniform(low, high)
        # Far out in a tail the share rounds to 0 or 1, where the inverse is infinite.
        deviation = normal.inv_cdf(share) if 0.0 < share < 1.0 else self._likeliest
        return self.loc + self.scale * min(max(deviation, self.a), self.b)

    @property
    def mean(self) -> float:
        """The mean."""
        from statistics import NormalDist

        normal = NormalDist()
        share = normal.cdf(self.b) - normal.cdf(self.a)
        # Far out in a tail both ends have the same share of the distribution.
        deviation = (normal.pdf(self.a) - normal.pdf(self.b)) / share if share > 0.0 else self._likeliest
        return self.loc + self.scale * min(max(deviation, self.a), self.b)

    @property
    def _likeliest(self) -> float:
        """Near which all values of a far tail lie."""
        return min(max(self.a, 0.0), self.b)
