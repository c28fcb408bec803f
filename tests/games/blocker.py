"""The game in which two blockers must be deceived."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from ray.rllib.env.multi_agent_env import MultiAgentEnv

ROWS, COLUMNS, AGENTS, LONGEST = 4, 7, 3, 40
MOVES = ((1, 0), (0, -1), (-1, 0), (0, 1), (0, 0))
"""Down, left, up, right, stay."""
LEFT, MIDDLE, RIGHT = 0, 3, 6
"""Columns at which the blockers leave a gap."""
ABOVE = ROWS - 2
"""The row that the blockers watch."""


def moved(places, gap, actions):
    """Return the agents' places after they have moved one after another; none enters another's cell."""
    places = list(places)
    for i, action in enumerate(actions):
        row, column = (x + d for x, d in zip(places[i], MOVES[action], strict=True))
        inside = 0 <= row < ROWS and 0 <= column < COLUMNS
        if inside and (row < ROWS - 1 or column == gap) and (row, column) not in places:
            places[i] = row, column
    return tuple(places)


def shifted(gap, places):
    """Return the gap after the blockers have answered to where the agents are now."""
    watched = {column for row, column in places if row == ABOVE}
    if gap == MIDDLE:
        if MIDDLE not in watched:
            return MIDDLE
        return RIGHT if LEFT in watched else LEFT
    return MIDDLE if watched & {LEFT, RIGHT} else gap


class Blocker(MultiAgentEnv):
    """Three agents in a grid of 4 x 7 win together once one of them is in the bottom row.

    Two blockers, each three cells wide, fill that row but for one cell. They close it as soon as an agent is
    above it, and leave another one, so that agents have to deceive them together. All get -1 in each step, 1
    in the last; after 40 steps the episode ends. The rules are those of the authors' code, with two changes:
    agents begin each episode in other columns of the top row, and no two are ever in one cell. An agent sees
    the places of all, its own first, and the gap.
    """

    def __init__(self, config=None):
        super().__init__()
        self.possible_agents = self.agents = [f"agent_{i}" for i in range(AGENTS)]
        width = AGENTS * (ROWS + COLUMNS) + 3
        self.observation_spaces = {a: Box(0.0, 1.0, (width,), np.float32) for a in self.agents}
        self.action_spaces = {a: Discrete(len(MOVES)) for a in self.agents}
        self.rng = np.random.default_rng(0)

    def reset(self, *, seed=None, options=None) -> Any:
        if seed is not None:
            self.rng = np.random.default_rng(seed)
        self.t, self.gap = 0, MIDDLE
        self.places = tuple((0, int(c)) for c in self.rng.choice(COLUMNS, AGENTS, replace=False))
        return self._see(), {}

    def step(self, action_dict) -> Any:
        self.t += 1
        self.places = moved(self.places, self.gap, [int(action_dict[a]) for a in self.agents])
        won = any(row == ROWS - 1 for row, _ in self.places)
        if not won:
            self.gap = shifted(self.gap, self.places)
        over = not won and self.t == LONGEST
        rewards = dict.fromkeys(self.agents, 1.0 if won else -1.0)
        return self._see(), rewards, {"__all__": won}, {"__all__": over}, {}

    def _see(self):
        cells = [np.concatenate([np.eye(ROWS)[row], np.eye(COLUMNS)[column]]) for row, column in self.places]
        gap = np.eye(3)[self.gap // 3]
        return {
            a: np.concatenate([*cells[i:], *cells[:i], gap]).astype(np.float32)
            for i, a in enumerate(self.agents)
        }
