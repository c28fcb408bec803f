"""Plays floor policies in scenarios, and counts how the agents end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmark.floors import FLOORS
from benchmark.floors.protocol import Floor
from smarts.env.vector import VectorHiWayEnv, VectorStep
from smarts.errors import TrafficError
from smarts.types.actions import LaneAction
from smarts.types.episode import EpisodeStart


@dataclass
class Tally:
    """How the agents of a policy's episodes ended."""

    policy: str
    scenario: str
    traffic: str
    episodes: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    """Agents by outcome."""
    steps: float = 0.0
    """Of all episodes."""

    def share(self, outcome: str) -> float:
        """Return the share of agent-episodes with an outcome, NaN without any."""
        total = self.outcomes.total()
        return self.outcomes[outcome] / total if total else float("nan")


def play(policy: str, scenario: str, *, episodes: int, seed: int = 42, copies: int = 1) -> list[Tally]:
    """Play a scenario with every agent driven by a policy; return a tally for each of its traffics.

    Args:
        policy: A name of `FLOORS`.
        scenario: Folder, or name of the suite.
        episodes: How many in each of the simulations; whole rounds of the scenario's traffics and missions
            give all of them the same number.
        seed: Of the run.
        copies: Simulations side by side, each a world of its own.
    """
    env = VectorHiWayEnv(copies, [scenario], seed=seed)
    tallies: dict[str, Tally] = {}
    played = np.zeros(copies, int)
    try:
        drivers = [[FLOORS[policy]() for _ in env.agents] for _ in range(copies)]
        now = env.reset(seed)
        _begin(drivers, env.episodes, range(copies))
        while played.min() < episodes:
            starts = env.episodes
            now = env.step([_actions(drivers, now)])
            for row, error in now.failed.items():
                raise TrafficError(f"simulation {row} failed", place=scenario) from error
            for row, shares in now.metrics.items():
                if played[row] < episodes:
                    name = str(starts[row].traffic_name)
                    _count(tallies.setdefault(name, Tally(policy, scenario, name)), shares, len(env.agents))
                played[row] += 1
            _begin(drivers, env.episodes, np.flatnonzero(now.reset).tolist())
    finally:
        env.close()
    return [tallies[name] for name in sorted(tallies)]


def _begin(drivers: Sequence[Sequence[Floor]], starts: Sequence[EpisodeStart], rows: Iterable[int]) -> None:
    for row in rows:
        for agent, driver in enumerate(drivers[row]):
            driver.begin(starts[row], agent)


def _actions(drivers: Sequence[Sequence[Floor]], now: VectorStep) -> NDArray[np.int64]:
    """Return the actions of all who are alive, shape (B, N)."""
    (leaves,), (mask,) = now.observations, now.masks
    masks = np.ones((*now.alive.shape, len(LaneAction)), np.bool_) if mask is None else mask
    actions = np.zeros(now.alive.shape, np.int64)
    for row, agent in np.argwhere(now.alive).tolist():
        actions[row, agent] = drivers[row][agent].act(leaves[""][row, agent], masks[row, agent])
    return actions


def _count(tally: Tally, shares: Mapping[str, float], agents: int) -> None:
    tally.episodes += 1
    tally.steps += shares["steps"]
    for name, share in shares.items():
        if name != "steps" and share:
            tally.outcomes[name] += round(share * agents)
