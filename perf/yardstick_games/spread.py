"""simple_spread_v3 of the package mpe2 with its default settings: three agents cover three landmarks.

Lowe et al. 2017. All get half of minus the sum of the landmarks' distances to the nearest agent; each gets
-1/2 for every agent that it touches.
"""

from __future__ import annotations

import math

import numpy as np

from algorithms.joint.env import Bools, Floats, Ints
from perf.yardstick_games.vector import VectorGame
from smarts.geometry.compiling import kernel

AGENTS = 3
DIAMETER, MARGIN = 0.3, 1e-3
"""Diameter of agents [m], and depth over which the force between two sets in [m]."""


class Spread(VectorGame):
    """B copies of simple_spread_v3."""

    num_agents, num_actions, width, length = AGENTS, 5, 18, 25

    def __init__(self, num_envs: int) -> None:
        super().__init__(num_envs)
        self.position = np.zeros((num_envs, AGENTS, 2))
        self.velocity = np.zeros((num_envs, AGENTS, 2))
        self.landmark = np.zeros((num_envs, AGENTS, 2))

    def begin(self, row: int, rng: np.random.Generator) -> None:
        """Draw agents and landmarks uniformly in [-1, 1]^2, at rest."""
        self.position[row] = rng.uniform(-1, 1, (AGENTS, 2))
        self.landmark[row] = rng.uniform(-1, 1, (AGENTS, 2))
        self.velocity[row] = 0

    def move(self, actions: Ints) -> tuple[Floats, Bools]:
        """Accelerate, and push agents that touch apart; the game has no end of its own."""
        rewards = np.zeros((self.num_envs, AGENTS))
        push(self.position, self.velocity, self.landmark, np.ascontiguousarray(actions, np.int64), rewards)
        return rewards, np.zeros(self.num_envs, bool)

    def observe(self) -> Floats:
        """Return velocity, position, offsets of landmarks and of the others, and four zeros (no speech)."""
        seen = np.zeros((self.num_envs, AGENTS, self.width), np.float32)
        at = self.position
        seen[..., 0:2], seen[..., 2:4] = self.velocity, at
        seen[..., 4:10] = (self.landmark[:, None] - at[:, :, None]).reshape(*seen.shape[:2], 6)
        for i in range(AGENTS):
            others = [j for j in range(AGENTS) if j != i]
            seen[:, i, 10:14] = (at[:, others] - at[:, i, None]).reshape(-1, 4)
        return seen


@kernel
def push(position: Floats, velocity: Floats, landmark: Floats, actions: Ints, rewards: Floats) -> None:
    """Step all copies by 0.1 s and write rewards."""
    pushes = ((0.0, 0.0), (-5.0, 0.0), (5.0, 0.0), (0.0, -5.0), (0.0, 5.0))
    for b in range(len(actions)):
        force = np.empty((3, 2))
        for i in range(3):
            force[i, 0], force[i, 1] = pushes[actions[b, i]]
        part(position[b], force)
        position[b] += velocity[b] * 0.1
        velocity[b] = velocity[b] * 0.75 + force * 0.1
        reward(position[b], landmark[b], rewards[b])


@kernel
def part(position: Floats, force: Floats) -> None:
    """Add to the forces on three agents what pushes those apart that touch."""
    for i in range(3):
        for j in range(i + 1, 3):
            offset = position[i] - position[j]
            distance = math.hypot(offset[0], offset[1])
            depth = (DIAMETER - distance) / MARGIN
            soft = (max(depth, 0.0) + math.log1p(math.exp(-abs(depth)))) * MARGIN
            force[i] += 100.0 * soft / distance * offset
            force[j] -= 100.0 * soft / distance * offset


@kernel
def reward(position: Floats, landmark: Floats, rewards: Floats) -> None:
    """Write the rewards of three agents."""
    rewards[:] = 0.0
    for m in range(3):
        nearest = np.inf
        for i in range(3):
            nearest = min(
                nearest, math.hypot(position[i, 0] - landmark[m, 0], position[i, 1] - landmark[m, 1])
            )
        rewards -= 0.5 * nearest
    for i in range(3):
        for j in range(i + 1, 3):
            if math.hypot(position[i, 0] - position[j, 0], position[i, 1] - position[j, 1]) < DIAMETER:
                rewards[i] -= 0.5
                rewards[j] -= 0.5
