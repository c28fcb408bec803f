"""A game in which agents that improve at the same time collide."""

from __future__ import annotations

from tests.games.games import Game


class Yielding(Game):
    """Two drivers at a crossing: 1 for both if exactly one goes, 0 if both wait, -1 if both go.

    Against a driver that does either by chance it is better to wait, against one that waits to go, against
    one that goes to wait. So drivers that answer at once to what the other did are never apart.
    """

    length = 4
    ends = True

    def __init__(self, config=None):
        super().__init__(agents=2, actions=2)

    def reward(self, actions):
        return [(0.0, 1.0, -1.0)[sum(actions)]] * 2
