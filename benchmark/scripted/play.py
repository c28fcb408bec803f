"""Plays scripted policies in scenarios and counts the outcomes."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Discrete, Space
from numpy.typing import NDArray

from algorithms.joint.episode_indices import FIRST_TEST_EPISODE
from benchmark.scripted import SCRIPTED_POLICIES, ScriptedPolicy
from benchmark.statistics import wilson_interval
from smarts.env.vector import VectorHiWayEnv, VectorStep
from smarts.errors import OwnCodeError, TrafficError, shown
from smarts.registry import definition_of, guarded, is_own_name
from smarts.sim.assembly import Options
from smarts.sstudio.build import build_scenario
from smarts.types.actions import LaneAction
from smarts.types.episode import EpisodeStart

AGENTS = 4


@dataclass
class Tally:
    """Outcomes of a policy's agents in one scenario with one traffic."""

    policy: str
    scenario: str
    traffic: str
    agents: int
    """Number of agents in each episode."""
    episodes: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    """Outcome -> number of agents."""
    steps: float = 0.0
    """Number of steps of all episodes."""

    def add(self, outcomes: Counter[str], steps: float) -> None:
        """Count an episode."""
        self.episodes += 1
        self.outcomes += outcomes
        self.steps += steps

    @property
    def seconds(self) -> float:
        """Mean length of an episode [s], NaN without episodes."""
        return 0.1 * self.steps / self.episodes if self.episodes else math.nan

    def share(self, outcome: str) -> float:
        """Return the share of agent-episodes with an outcome, NaN without episodes."""
        total = self.outcomes.total()
        return self.outcomes[outcome] / total if total else math.nan

    def interval(self, outcome: str) -> tuple[float, float]:
        """Return the 95% interval of a share.

        Wilson's interval with the episode as unit: agents of one episode may end alike, so n agent-episodes
        count as n / agents independent ones (the largest possible design effect).
        """
        low, high = wilson_interval(self.share(outcome), self.outcomes.total() / self.agents)
        return float(low), float(high)


class Ended(NamedTuple):
    """A finished episode."""

    outcomes: Counter[str]
    """Outcome -> number of agents."""
    steps: float


def play(
    policy: str,
    scenario: str,
    *,
    episodes: int,
    agents: int = AGENTS,
    seed: int = 42,
    first_episode: int = FIRST_TEST_EPISODE,
    record: Path | None = None,
) -> Iterator[Tally]:
    """Play a scenario with every agent driven by a policy; yield a tally for each of its traffics.

    Episode k is that of world `first_episode` + k, as in the evaluation of learned policies.

    Args:
        policy: A name of `SCRIPTED_POLICIES`.
        scenario: Folder, or name of the suite.
        episodes: How many are counted for each traffic: the first valid ones.
        agents: How many drive in each episode.
        seed: Seed of the run.
        first_episode: See above.
        record: Folder for recorded episodes; the last episode of each traffic is cut short.

    Raises:
        SmartsError: There are fewer missions than agents.
        TrafficError: Traffic failed.
    """
    names = build_scenario(scenario).traffic
    for traffic in names or ("none",):
        chosen = [traffic] if names else None
        tally = Tally(policy, scenario, traffic, agents)
        env = VectorHiWayEnv(
            1,
            [scenario],
            agents,
            seed=seed,
            observation=getattr(SCRIPTED_POLICIES[policy], "observation", None) or "benchmark",
            reward="benchmark",
            simulation=Options(record=record, policy=policy),
            traffic=chosen,
        )
        with closing(env):
            for outcomes, steps in episodes_of(env, policy, seed, first_episode):
                if not outcomes["invalid"]:
                    tally.add(outcomes, steps)
                if tally.episodes >= episodes:
                    break
        yield tally


def episodes_of(env: VectorHiWayEnv, policy: str, seed: int, first_episode: int) -> Generator[Ended]:
    """Yield one episode of each world in turn, with every agent driven by a policy.

    Args:
        env: One simulation whose observations and actions fit the policy.
        policy: A name of `SCRIPTED_POLICIES`, or `module:Class` of a user's own.
        seed: Seed of the run.
        first_episode: The world of the first episode.

    Raises:
        TrafficError: Traffic failed.
    """
    drivers = ScriptedDrivers(policy, env)
    now = env.reset(seed, np.array([first_episode]), stride=1)
    (start,) = drivers.begin(np.ones(1, np.bool_))
    while True:
        now = env.step(drivers.act(now, now.alive))
        for error in now.failed.values():
            place = f"{start.scenario}, world {start.world}"
            raise TrafficError("the traffic failed", place=place) from error
        for shares in now.metrics.values():
            yield Ended(_outcomes(shares, len(env.agents)), shares["steps"])
            (start,) = drivers.begin(np.ones(1, np.bool_))


class ScriptedDrivers:
    """A scripted policy for each agent of each simulation of an environment.

    Args:
        policy: A name of `SCRIPTED_POLICIES`, or `module:Class` of a user's own.
        env: Its observations and actions fit the policy.

    Raises:
        OwnCodeError: The policy is a user's own and raises, or an action that it returns is not in the space;
            names its file and line.
    """

    def __init__(self, policy: str, env: VectorHiWayEnv) -> None:
        self._env = env
        self._doing = f"the scripted policy {policy!r}"
        self._guard = guarded if is_own_name(policy) else _unguarded
        self._drivers: list[list[ScriptedPolicy]] = [
            [SCRIPTED_POLICIES[policy]() for _ in env.agents] for _ in range(env.num_envs)
        ]

    def begin(self, begun: NDArray[np.bool_]) -> tuple[EpisodeStart, ...]:
        """Begin the episodes of some simulations, shape (B,); return what all play."""
        starts = self._env.episodes
        for row in np.flatnonzero(begun).tolist():
            for agent, driver in enumerate(self._drivers[row]):
                self._guard(driver.begin, self._doing)(starts[row], agent)
        return starts

    def act(self, now: VectorStep, acts: NDArray[np.bool_]) -> list[NDArray]:
        """Return the actions of some active agents, (B, N), for each block of agents, shape (B, n, ...)."""
        actions, first = [], 0
        for block, leaves, mask in zip(self._env.spaces.blocks, now.observations, now.masks, strict=True):
            shape = (len(acts), len(block.agents), *(block.action.shape or ()))
            chosen = np.zeros(shape, block.action.dtype)
            for row, place in np.argwhere(acts[:, first : first + len(block.agents)]).tolist():
                seen = {name: leaf[row, place] for name, leaf in leaves.items()}
                action_mask = np.ones(len(LaneAction), np.bool_) if mask is None else mask[row, place]
                driver: Any = self._drivers[row][first + place]
                given = self._guard(driver.act, self._doing)(_observation(driver, seen), action_mask)
                chosen[row, place] = _checked(given, block.action, driver, self._doing)
            actions.append(chosen)
            first += len(block.agents)
        return actions


def _unguarded(function: Callable[..., Any], doing: str) -> Callable[..., Any]:
    """Return the function of a policy of this package."""
    return function


def _checked(given: Any, space: Space, driver: ScriptedPolicy, doing: str) -> Any:
    """Return what a policy has returned if it is an action of a space, else raise `OwnCodeError`."""
    action, is_whole = np.asarray(given), np.dtype(space.dtype).kind in "iu"
    fits = action.dtype.kind in ("iu" if is_whole else "iuf") and action.shape == space.shape
    fits = fits and bool(np.isfinite(action).all())
    if not fits or (isinstance(space, Discrete) and not space.contains(int(action))):
        kind = "whole" if is_whole else "finite"
        remedy = f"return {kind} numbers of the action space {space}"
        raise OwnCodeError(f"{doing} returns {shown(given)}", place=definition_of(driver.act), remedy=remedy)
    return given


def _observation(driver: ScriptedPolicy, seen: Mapping[str, NDArray]) -> Any:
    """Return a policy's observation: the only array, or a dict of arrays.

    The policies of this package read the vector of observation "benchmark" and ignore other arrays.
    """
    if [*seen] == [""]:
        return seen[""]
    is_ours = type(driver).__module__.startswith("benchmark.scripted.")
    return seen["observation"] if is_ours and "observation" in seen else dict(seen)


def _outcomes(shares: Mapping[str, float], agents: int) -> Counter[str]:
    return Counter(
        {name: round(share * agents) for name, share in shares.items() if name != "steps" and share}
    )
