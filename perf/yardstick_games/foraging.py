"""Level-based foraging, Foraging-8x8-2p-2f-coop-v3 of the package lbforaging: two agents load two foods.

Christianos, Schäfer & Albrecht 2020; Papoudakis et al. 2021. Every food needs both agents: side by side with
it, in the same step. An episode's rewards sum to 1 if both foods are loaded. Only the end by the time limit
differs: the package flags it as a termination, here it is a truncation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from algorithms.joint.env import Bools, Floats, Ints
from perf.yardstick_games.vector import VectorGame
from smarts.geometry.compiling import kernel

SIZE, AGENTS, FOODS = 8, 2, 2
LOAD = 5
"""Action; the others are 0 none, 1 north, 2 south, 3 west, 4 east."""


class Grids(NamedTuple):
    """State of all copies.

    Attributes:
        food: Levels of foods in the cells, (B, 8, 8).
        place: Row and column of the agents, (B, 2, 2).
        level: Levels of the agents, (B, 2).
        spawned: Sum of the levels of all foods of the episode, (B,).
    """

    food: Ints
    place: Ints
    level: Ints
    spawned: Ints


class Foraging(VectorGame):
    """B copies of Foraging-8x8-2p-2f-coop-v3."""

    num_agents, num_actions, width, length = AGENTS, 6, 3 * (FOODS + AGENTS), 50

    def __init__(self, num_envs: int) -> None:
        super().__init__(num_envs)
        self.grids = Grids(
            np.zeros((num_envs, SIZE, SIZE), np.int64),
            np.zeros((num_envs, AGENTS, 2), np.int64),
            np.ones((num_envs, AGENTS), np.int64),
            np.ones(num_envs, np.int64),
        )

    def begin(self, row: int, rng: np.random.Generator) -> None:
        """Place agents, then foods, by the package's draws."""
        food, place, level = self.grids.food[row], self.grids.place[row], self.grids.level[row]
        food[:] = 0
        place[:] = -1
        rng.permutation(AGENTS)  # the package permutes levels' bounds, which are equal
        for agent in range(AGENTS):
            cell = drawn(rng, 0)
            while (place == cell).all(1).any():
                cell = drawn(rng, 0)
            place[agent] = cell
            level[agent] = rng.integers(1, 3)
        rng.permutation(FOODS)
        for _ in range(FOODS):
            cell = drawn(rng, 1)
            while near_food(food, *cell) or (place == cell).all(1).any():
                cell = drawn(rng, 1)
            food[cell] = level.sum()
        self.grids.spawned[row] = food.sum()

    def move(self, actions: Ints) -> tuple[Floats, Bools]:
        """Move, then load."""
        rewards, ended = np.zeros((self.num_envs, AGENTS)), np.zeros(self.num_envs, bool)
        forage(self.grids, np.ascontiguousarray(actions, np.int64), rewards, ended)
        return rewards, ended

    def observe(self) -> Floats:
        """Return row, column and level of each food, of the agent itself, and of the other."""
        seen = np.empty((self.num_envs, AGENTS, self.width), np.float32)
        look(self.grids, seen)
        return seen


def drawn(rng: np.random.Generator, border: int) -> tuple[int, int]:
    """Return a random cell at least so many cells from the border."""
    return int(rng.integers(border, SIZE - border)), int(rng.integers(border, SIZE - border))


def near_food(food: Ints, row: int, column: int) -> bool:
    """Return whether food is in one of the eight cells around a cell, or two cells straight away."""
    around = food[row - 1 : row + 2, column - 1 : column + 2].any()
    rows = food[max(row - 2, 0) : row + 3, column].any()
    return bool(around or rows or food[row, max(column - 2, 0) : column + 3].any())


@kernel
def forage(grids: Grids, actions: Ints, rewards: Floats, ended: Bools) -> None:
    """Step all copies: move, except to a common cell, then load; actions that are impossible are none."""
    for b in range(len(actions)):
        food, place = grids.food[b], grids.place[b]
        goal = place.copy()
        for i in range(2):
            step(food, goal[i], actions[b, i])
        if goal[0, 0] != goal[1, 0] or goal[0, 1] != goal[1, 1]:
            place[:] = goal
        if actions[b, 0] == LOAD and actions[b, 1] == LOAD:
            load(food, place, grids.level[b], grids.spawned[b], rewards[b])
        ended[b] = not food.any()


@kernel
def step(food: Ints, cell: Ints, action: int) -> None:
    """Move a cell to where an action leads, unless the field ends or food is there."""
    row = cell[0] + (action == 2) - (action == 1)
    column = cell[1] + (action == 4) - (action == 3)
    if 0 <= row < 8 and 0 <= column < 8 and food[row, column] == 0:
        cell[0], cell[1] = row, column


@kernel
def load(food: Ints, place: Ints, level: Ints, spawned: int, rewards: Floats) -> None:
    """Remove the food that both agents stand beside, and share its level by theirs."""
    for row in range(1, 7):
        for column in range(1, 7):
            near = True
            for i in range(2):
                near &= abs(place[i, 0] - row) + abs(place[i, 1] - column) == 1
            if near and food[row, column] > 0:
                for i in range(2):
                    rewards[i] = level[i] * food[row, column] / (level.sum() * spawned)
                food[row, column] = 0


@kernel
def look(grids: Grids, seen: Floats) -> None:
    """Write what the agents see: foods (-1, -1, 0 where loaded), themselves, the other."""
    for b in range(len(seen)):
        for i in range(2):
            own = seen[b, i]
            place = 0
            for r in range(8):
                for c in range(8):
                    if grids.food[b, r, c] > 0:
                        own[place], own[place + 1], own[place + 2] = r, c, grids.food[b, r, c]
                        place += 3
            while place < 6:
                own[place], own[place + 1], own[place + 2] = -1, -1, 0
                place += 3
            for k in range(2):
                j = i if k == 0 else 1 - i
                own[6 + 3 * k], own[7 + 3 * k] = grids.place[b, j, 0], grids.place[b, j, 1]
                own[8 + 3 * k] = grids.level[b, j]
