"""How agents of floor policies end, counted, with the uncertainty of the shares."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field

from benchmark.statistics import wilson_interval


@dataclass
class Tally:
    """How the agents of a policy's episodes ended, in one scenario with one kind of traffic."""

    policy: str
    scenario: str
    traffic: str
    agents: int
    """In each episode."""
    episodes: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    """Agents by outcome."""
    steps: float = 0.0
    """Of all episodes."""

    def add(self, outcomes: Counter[str], steps: float) -> None:
        """Count an episode."""
        self.episodes += 1
        self.outcomes += outcomes
        self.steps += steps

    @property
    def seconds(self) -> float:
        """Mean length of an episode [s], NaN without any."""
        return 0.1 * self.steps / self.episodes if self.episodes else math.nan

    def share(self, outcome: str) -> float:
        """Return the share of agent-episodes with an outcome, NaN without any."""
        total = self.outcomes.total()
        return self.outcomes[outcome] / total if total else math.nan

    def interval(self, outcome: str) -> tuple[float, float]:
        """Return the 95% interval of a share.

        It is Wilson's with the episode as unit: agents of one episode may end alike, so that n agent-episodes
        tell no more than n / agents episodes (the largest design effect there is).
        """
        return wilson(self.share(outcome), self.outcomes.total() / self.agents)


def wilson(share: float, count: float) -> tuple[float, float]:
    """Return Wilson's 95% interval of a share of `count` independent trials (1927), all without any."""
    if count <= 0:
        return 0.0, 1.0
    low, high = wilson_interval(share, count)
    return float(low), float(high)
