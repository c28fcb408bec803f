"""The agent `boids-v0`."""

from __future__ import annotations

import numpy as np

from smarts.agents.policy import ActionBatch
from smarts.arrays import Floats, Ints
from smarts.observations.surroundings import Own
from smarts.zoo.driving import Driver, Seen

SAME_WAY = 0.5
"""Cosine of the angle between two headings, from which on vehicles are of one flock."""
ASIDE = 2.0
"""A flock farther aside than this draws a vehicle to the next lane [m]."""


class Boids(Driver):
    """A flock: its vehicles adapt their speeds, close up and gather in one lane, at safe distances.

    Of a simulation's vehicles that it drives, those within `radius` that head the same way are a vehicle's
    flock (Reynolds, "Flocks, herds and schools", SIGGRAPH 1987: separation, alignment, cohesion).

    Args:
        radius: [m]
        alignment: Weight of the flock's mean speed [1/s].
        cohesion: Weight of the distance to the flock's centre [1/s^2].
        speed_factor: Highest speed, in speed limits.
    """

    def __init__(
        self,
        radius: float = 60.0,
        alignment: float = 0.5,
        cohesion: float = 0.03,
        speed_factor: float = 1.0,
    ) -> None:
        super().__init__(tau=0.8, speed_factor=speed_factor)
        self._radius, self._alignment, self._cohesion = map(float, (radius, alignment, cohesion))

    def decide(self, batch: ActionBatch, seen: Seen) -> tuple[Floats, Ints]:
        """Return accelerations and lane changes; see `Driver`."""
        ahead, aside, faster, has_flock = self._flock(batch, seen)
        pull = self._alignment * faster + self._cohesion * ahead
        acceleration = self.follow(seen)
        # The flock may hold a vehicle back, or let it drive on, but not nearer to others than is safe.
        held = np.minimum(acceleration, np.clip(pull, -self.model.decel, self.model.accel))
        is_slow = seen.speed < 0.5 * self.desired(seen)
        acceleration = np.where(has_flock & ~(is_slow & (pull < 0.0)), held, acceleration)
        side = np.where(has_flock & (np.abs(aside) > ASIDE), np.sign(aside), 0).astype(np.int32)
        side = np.where((seen.own[:, Own.DEMANDED] == 0.0) & self.is_safe(batch, seen, side), side, 0)
        demanded = self.demanded_change(batch, seen)
        return acceleration, np.where(demanded != 0, demanded, side).astype(np.int32)

    def _flock(self, batch: ActionBatch, seen: Seen) -> tuple[Floats, Floats, Floats, np.ndarray]:
        """Return where the flock's centre is, how much faster the flock is, and whether there is one."""
        count = len(seen.own)
        ahead, aside, faster = np.zeros(count), np.zeros(count), np.zeros(count)
        has_flock = np.zeros(count, np.bool_)
        for env_id in np.unique(batch.env_id):
            rows = np.flatnonzero(batch.env_id == env_id)
            rows = rows[np.argsort(batch.agent_id[rows], kind="stable")]
            for row in rows:
                near = self._mates(seen.own[rows], seen.own[row]) & (rows != row)
                if near.any():
                    mates, own = seen.own[rows[near]], seen.own[row]
                    dx, dy = (mates[:, [Own.X, Own.Y]] - own[[Own.X, Own.Y]]).mean(axis=0)
                    cos, sin = np.cos(own[Own.HEADING]), np.sin(own[Own.HEADING])
                    ahead[row], aside[row] = dx * cos + dy * sin, dy * cos - dx * sin
                    faster[row] = mates[:, Own.SPEED].mean() - own[Own.SPEED]
                    has_flock[row] = True
        return ahead, aside, faster, has_flock

    def _mates(self, others: Floats, own: Floats) -> np.ndarray:
        """Return which vehicles are near enough and head the same way."""
        distance = np.hypot(others[:, Own.X] - own[Own.X], others[:, Own.Y] - own[Own.Y])
        same_way = np.cos(others[:, Own.HEADING] - own[Own.HEADING]) > SAME_WAY
        return (distance < self._radius) & same_way
