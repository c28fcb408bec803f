"""Games with an opponent whose play is known, and games that punish what independent learners expect."""

from __future__ import annotations

import numpy as np
from gymnasium.spaces import Box, Dict

from tests.games.games import Game


class Turncoat(Game):
    """A follower gets 1 for doing what a leader does, whose action mask leaves it no choice.

    The leader plays 0 nine times of ten, after 1,000 steps of its life 2; the cue tells nothing.
    """

    turn = 1_000

    def __init__(self, config=None):
        super().__init__(agents=2, actions=3, width=3)
        seen = {"observations": Box(-1.0, 1.0, (3,), np.float32), "action_mask": Box(0, 1, (3,), np.int8)}
        self.observation_spaces = {a: Dict(seen) for a in self.agents}
        self.steps = 0

    def observe(self):  # type: ignore[override] - a Dict observation
        self.steps += 1
        cue, favourite = int(self.rng.integers(3)), 0 if self.steps <= self.turn else 2
        chances = 0.05 + 0.85 * np.eye(3)[favourite]
        forced = np.eye(3, dtype=np.int8)[self.rng.choice(3, p=chances)]
        return {
            "agent_0": {"observations": np.eye(3, dtype=np.float32)[cue], "action_mask": np.ones(3, np.int8)},
            "agent_1": {"observations": np.zeros(3, np.float32), "action_mask": forced},
        }

    def reward(self, actions):
        return [float(actions[0] == actions[1]), 0.0]


class Climbing(Game):
    """Claus & Boutilier's climbing game: (0, 0) is worth 11, but against chance 0 is the worst action."""

    WORTH = ((11, -30, 0), (-30, 7, 6), (0, 0, 5))

    def __init__(self, config=None):
        super().__init__(agents=2, actions=3)

    def reward(self, actions):
        return [float(self.WORTH[actions[0]][actions[1]])] * 2


class Hills(Game):
    """PR2's differential game, "max of two quadratics", at 9 points from -10 to 10; a tenth of its rewards.

    A wide hill of height 0 at (-5, -5), a narrow one of height 10 at (5, 5).
    """

    POINTS = np.linspace(-10, 10, 9)

    def __init__(self, config=None):
        super().__init__(agents=2, actions=9)

    @classmethod
    def worth(cls, first, second):
        """Return the reward of points."""
        low = 0.8 * (-((first + 5) ** 2) / 3 - (second + 5) ** 2 / 3)
        high = -((first - 5) ** 2) - (second - 5) ** 2 + 10
        return np.maximum(low, high) / 10

    def reward(self, actions):
        return [float(self.worth(*self.POINTS[actions]))] * 2
