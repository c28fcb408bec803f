"""Simulations that play on and on, with all that happens in each of them hashed."""

import hashlib

import numpy as np


class HashedRun:
    """Episodes of some worlds, one after the other in each row; subclasses choose the agents' actions.

    Args:
        parts: The assembly, closed by `digests`.
        worlds: The number of the world in each row.
    """

    def __init__(self, parts, worlds):
        self.parts, self.world, self.worlds = parts, parts.simulation.world, worlds
        self.hashes = [hashlib.blake2b() for _ in worlds]
        self.episodes = [0] * len(worlds)
        """Episodes begun."""
        self._reset(range(len(worlds)))

    def act(self, actions, row):
        """Write the actions of one simulation's agents."""

    def step(self, rows=None):
        """Let some simulations make a step; those that finish begin their next episode."""
        rows = np.ones(len(self.worlds), np.bool_) if rows is None else rows
        for row in np.flatnonzero(rows).tolist():
            self.act(self.parts.actions, row)
        frame = self.parts.simulation.step(
            self.parts.actions, rows, np.ones(self.world.agents.slot.shape, np.bool_)
        )
        assert not frame.failures
        self._hash(frame)
        if finished := np.flatnonzero(frame.events.finished & rows).tolist():
            self._reset(finished)

    def digests(self):
        """Return the hash of each row, and end."""
        self.parts.simulation.close()
        return [each.hexdigest() for each in self.hashes]

    def _reset(self, rows):
        starts = {row: self.parts.schedule.start(self.worlds[row], self.episodes[row]) for row in rows}
        self._hash(self.parts.simulation.reset(starts))
        for row in rows:
            self.episodes[row] += 1

    def _hash(self, frame):
        world, readings = self.world, frame.readings
        for row in np.flatnonzero(frame.env_mask).tolist():
            told, there = self.hashes[row].update, np.flatnonzero(world.vehicles.alive[row])
            for column in (*world.vehicles, *world.before):
                told(column[row, there].tobytes())
            for column in (*world.agents, *world.missions, *world.guidance, *frame.events[:4]):
                told(column[row].tobytes())
            told(world.signals[row].tobytes())
            for sensor, block in readings.blocks.items():
                for place, agent_id in enumerate(readings.agent_ids[sensor].tolist()):
                    if frame.observe_mask[row, agent_id]:
                        told(b"".join(array[row, place].tobytes() for array in block.values()))
