"""A game that requires memory."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.games.games import Game


class Recall(Game):
    """A cue (-1 or 1) is observed in the first of four steps and rewarded in the last: 0.5 without memory.

    Each of the two agents has its own cue; observations are (cue or 0, time).
    """

    length = 4
    ends = True

    def __init__(self, config=None):
        super().__init__(agents=2, actions=2, width=2)

    def observe(self) -> dict[Any, np.ndarray]:
        if self.t == 0:
            self.cue = self.rng.integers(2, size=2)
        shown = 2.0 * self.cue - 1 if self.t == 0 else np.zeros(2)
        time = self.t / self.length
        return {a: np.array([s, time], np.float32) for a, s in zip(self.agents, shown, strict=True)}

    def reward(self, actions):
        return [float(self.t == self.length - 1 and a == c) for a, c in zip(actions, self.cue, strict=True)]


class Luck(Recall):
    """As `Recall`, but the reward at the end is the cue itself, whatever the agents do.

    Half of it is what a value without memory expects after the first step; its squared error is 1/4.
    """

    def reward(self, actions):
        return [float(self.t == self.length - 1 and c) for c in self.cue]
