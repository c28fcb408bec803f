"""Plays several policies in one environment, each for agents of its own.

Axis letters: B simulations, N agents.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchmark.running.policy import Policy
from benchmark.running.testing import EVALUATION_SEED
from benchmark.scripted.play import ScriptedDrivers
from smarts.env.adapters import ObservationAndReward
from smarts.env.groups import ALONE, MASK
from smarts.env.vector import VectorHiWayEnv, VectorStep
from smarts.observations.arrays import ArrayObservation
from smarts.observations.context import AdapterContext
from smarts.observations.lists import Observed
from smarts.rewards.own import Reward

Agents = NDArray[np.bool_]
SCRIPTED = "scripted:"
"""Prefix of the names of arrays that scripted policies see."""


class ObservationsOfBoth(ObservationAndReward):
    """What trained policies observe, and beside it what a scripted one does.

    Args:
        context: The agents.
        observation: Observation of the trained policies.
        reward: As in `ObservationAndReward`.
        discount: As in `ObservationAndReward`.
        scripted: What a scripted policy observes.
    """

    def __init__(
        self,
        context: AdapterContext,
        observation: Observed,
        reward: Reward | None,
        discount: float | None,
        *,
        scripted: Observed,
    ) -> None:
        super().__init__(context, observation, reward, discount)
        seen = ArrayObservation(context, scripted)
        self._observed.append(seen)
        fields = [field for field in seen.fields if field.name != MASK]
        self.fields += tuple(replace(field, name=SCRIPTED + field.name) for field in fields)
        added = {SCRIPTED + field.name: seen.arrays[field.name] for field in fields}
        self.observations = {**self.observations, **added}


class Driver(Protocol):
    """Chooses the actions of some agents of an environment."""

    def act(self, now: VectorStep, begun: NDArray[np.bool_]) -> Sequence[NDArray]:
        """Return actions, per block, shape (B, n, ...); the others are unspecified.

        Args:
            now: Where the simulations stand.
            begun: Simulations that begin an episode, shape (B,).
        """
        ...


class TrainedDriver:
    """A trained policy, acting as in its test.

    Args:
        policy: The policy, reset.
        agents: Agents that it drives, shape (N,); it hears and sees the like of these alone.
        env: The environment.
    """

    def __init__(self, policy: Policy, agents: Agents, env: VectorHiWayEnv) -> None:
        self._policy, self._agents, self._env = policy, agents, env
        policy.reset()

    def act(self, now: VectorStep, begun: NDArray[np.bool_]) -> Sequence[NDArray]:
        """Return the actions of its agents; see `Driver`."""
        return self._policy.act_for(self._agents, _seen(now, is_scripted=False), self._env.worlds)


class ScriptedDriver:
    """A scripted policy.

    Args:
        policy: Its name.
        agents: Agents that it drives, shape (N,).
        env: The environment.
    """

    def __init__(self, policy: str, agents: Agents, env: VectorHiWayEnv) -> None:
        self._drivers, self._agents = ScriptedDrivers(policy, env), agents

    def act(self, now: VectorStep, begun: NDArray[np.bool_]) -> Sequence[NDArray]:
        """Return the actions of its agents; see `Driver`."""
        self._drivers.begin(begun)
        return self._drivers.act(_seen(now, is_scripted=True), now.alive & self._agents)


def _seen(now: VectorStep, *, is_scripted: bool) -> VectorStep:
    """Return what one kind of policies sees: the same where both observe alike."""
    if not any(name.startswith(SCRIPTED) for leaves in now.observations for name in leaves):
        return now

    def own(leaves: Mapping[str, NDArray]) -> dict[str, NDArray]:
        found = {
            name.removeprefix(SCRIPTED): leaf
            for name, leaf in leaves.items()
            if name.startswith(SCRIPTED) == is_scripted
        }
        return {"": found[ALONE]} if [*found] == [ALONE] else found

    return now._replace(observations=tuple(map(own, now.observations)))


def play_together(
    env: VectorHiWayEnv,
    drivers: Sequence[tuple[Driver, Agents]],
    indices: range,
    seed: int = EVALUATION_SEED,
) -> None:
    """Play test episodes as tests do, in an environment that records them.

    Args:
        env: The environment, as the test's.
        drivers: Drivers with the agents that each drives, shape (N,); together they drive all.
        indices: Indices of the episodes.
        seed: Seed of the run.
    """
    now = env.reset(seed, indices.start + np.arange(env.num_envs), stride=env.num_envs)
    begun = np.ones(env.num_envs, np.bool_)
    while (env.worlds < indices.stop).any():
        now = env.step(_joined(env, [(driver.act(now, begun), agents) for driver, agents in drivers]))
        begun = now.reset.copy()
        begun[list(now.failed)] = True


def _joined(env: VectorHiWayEnv, parts: Sequence[tuple[Sequence[NDArray], Agents]]) -> list[NDArray]:
    """Return the actions of all agents, each from the driver of its own."""
    joined, first = [], 0
    for number, block in enumerate(env.spaces.blocks):
        chosen = np.array(parts[0][0][number])
        for actions, agents in parts[1:]:
            own = agents[first : first + len(block.agents)]
            chosen[:, own] = actions[number][:, own]
        joined.append(chosen)
        first += len(block.agents)
    return joined
