"""A game that needs actions that are random and equal."""

from __future__ import annotations

from tests.games.games import Game


class Doors(Game):
    """Both get 1 where two thieves choose the same of 4 doors, but for the door of the step before.

    They see nothing. Choices that are independent of each other are equal and new with probability 1/4 at
    most: sum_k p_k q_k (1 - p_k) for the first's p and the second's q. Where the second knows the first's
    choice, a uniform choice is equal and new with probability 3/4.
    """

    length = 32

    def __init__(self, config=None):
        super().__init__(agents=2, actions=4)
        self.guarded = -1

    def reward(self, actions):
        first, second = actions
        taken = first == second and first != self.guarded
        self.guarded = first
        return [float(taken)] * 2
