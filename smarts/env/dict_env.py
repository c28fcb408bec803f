"""One simulation whose agents are addressed by name, as HiWayEnv, PettingZoo, RLlib and Gymnasium do.

Axis letters: E egos, B = 1 simulation.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.agents.spec import AgentSpec
from smarts.arrays import Bools
from smarts.controllers.action_formats import rejection
from smarts.env.actions import Own, Parsed
from smarts.env.rendering import Renderer, RenderMode
from smarts.env.runner import EpisodeKey, NotCopied, SimulationRunner, Transition
from smarts.errors import ActionError, ScenarioError, nearest_names
from smarts.types.events import Event, Outcome
from smarts.types.streams import check_seed

MOST_EMPTY = 10
"""Episodes in a row without any agent after which `reset` gives up."""
_EVENTS = [(int(event), str(event.name).lower()) for event in Event if event]
_OUTCOMES = [outcome.name.lower() for outcome in Outcome]


class StepResult(NamedTuple):
    """Result of one decision, for the agents that acted and the agents that have entered since."""

    observations: dict[str, Any]
    """Observations of the agents that act next, and the last ones of agents that have ended."""
    rewards: dict[str, float]
    terminated: dict[str, bool]
    truncated: dict[str, bool]
    infos: dict[str, Any]
    entered: list[str]
    """The agents that have entered since: their reward is 0."""
    finished: bool
    """Whether the episode is over."""


class DictEnv:
    """Steps one simulation by dicts; subclasses define an agent's observation, reward and info.

    Args:
        runner: The simulation.
        names: Names of the egos, in the order of their columns.
        order: The names in the order in which results list them.
        specs: The agents' specs.
        seed: Seed of the run.
        world: Index of the world whose episodes are played; after a reset with a seed, world 0.
        render_mode: See `Renderer`.
    """

    def __init__(
        self,
        runner: SimulationRunner,
        names: Collection[str],
        order: Collection[str],
        specs: Mapping[str, AgentSpec],
        seed: int,
        world: int = 0,
        render_mode: RenderMode | None = None,
    ) -> None:
        self.runner = runner
        self.renderer = Renderer(runner, render_mode)
        columns = {name: column for column, name in enumerate(names)}
        self.columns = {name: columns[name] for name in order}
        """The egos' columns by name, in the order in which results list them."""
        self.specs = specs
        self._seed, self._world, self._episode = seed, world, -1
        # By name, those that no info has named yet: infos belong to agents, and there may be none.
        self._social_failures: dict[str, str] = {}

    @property
    def agents(self) -> list[str]:
        """The agents that decide now."""
        alive = self.runner.alive[0]
        return [name for name, column in self.columns.items() if alive[column]]

    def reset(self, seed: int | None = None) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin the next episode, or with a seed the first one of that seed; return observations and infos.

        Raises:
            TrafficError: The traffic engine failed; another reset tries the episode after this one.
        """
        if seed is not None:
            check_seed(seed, "reset")
            self._seed, self._world, self._episode = seed, 0, -1
        self._begin()
        self.runner.dispatch()
        agents = self.agents
        infos = self._first_infos(agents)
        self._social_failures |= self.runner.take_social_failures().get(0, {})
        for info in infos.values():
            info |= self._social_info()
        if infos:
            self._social_failures = {}
        self.renderer.after_step()
        return {name: self._observation(name) for name in agents}, infos

    def _begin(self) -> None:
        """Begin the next episode; where agents learn in bubbles, the next one in which there is an agent."""
        for _ in range(MOST_EMPTY):
            self._episode += 1
            self.runner.reset({0: EpisodeKey(self._world, self._episode, self._seed)})
            if self.runner.running[0] or not self.runner.learns_in_bubbles:
                return
        raise ScenarioError(
            f"no agent has entered in {MOST_EMPTY} episodes",
            place=f"episode {self._episode}",
            remedy="give traffic that comes through the bubbles, or a longer episode_time",
        )

    def step(self, actions: Mapping[str, Any]) -> StepResult:
        """Step until the next decision.

        Actions of agents that are not active are ignored, so a loop over the last observations may act for
        agents that have just ended. An agent without an action keeps the lasting part of its last one. After
        the episode ends, `step` is a no-op.

        Raises:
            ActionError: An agent is unknown, or an action is not in its space. No action is taken then.
            TrafficError: The traffic engine failed; the next reset works.
            SmartsError: The environment was closed, or never reset.
        """
        self.runner.check_begun()
        self._check_names(actions)
        if not self.runner.running[0]:
            return StepResult({}, {}, {}, {}, {}, [], True)
        self._encode(actions)
        transition = self.runner.step()
        self._social_failures |= transition.social_failures.get(0, {})
        for error in transition.failures.values():
            raise error
        result = self._step_result(transition)
        self.runner.conclude(*self._as_row(result.rewards))
        self.runner.dispatch()
        self.renderer.after_step()
        return result

    def annotate(self, name: str, values: Mapping[str, ArrayLike]) -> None:
        """Add values to the record of the agents' next decision; without a record, a no-op.

        Args:
            name: What the values are, such as "probabilities".
            values: A number or numbers of each agent; inactive agents are ignored.

        Raises:
            ActionError: An agent is unknown.
        """
        self._check_names(values)
        for agent, given in values.items():
            numbers = np.asarray(given, np.float64)
            egos = np.zeros(self.runner.alive.shape, np.bool_)
            egos[0, self.columns[agent]] = True
            self.runner.annotate(name, np.broadcast_to(numbers, (*egos.shape, *numbers.shape)), egos)

    def close(self) -> None:
        """Free the simulation; may be called again."""
        self.renderer.close()
        self.runner.close()

    def _observation(self, name: str) -> Any:
        """Return what an agent observes now."""
        raise NotImplementedError

    def _first_infos(self, agents: Collection[str]) -> dict[str, dict[str, Any]]:
        """Return the infos of a reset."""
        raise NotImplementedError

    def _reward_and_info(self, name: str, acted: bool, info: dict[str, Any]) -> tuple[Any, Any]:
        """Return the reward and info that an agent gets, by the adapters of its spec.

        Args:
            name: The agent.
            acted: Whether it has made the decision; else it has just entered.
            info: Its events and outcome.
        """
        raise NotImplementedError

    def _encode(self, actions: Mapping[str, Any]) -> None:
        """Check all actions, then write them."""
        parsed, own = self._parse(actions)
        self.runner.encoder.write(parsed, own)

    def _parse(self, actions: Mapping[str, Any]) -> tuple[list[Parsed], list[Own]]:
        """Check the actions of active agents, as the adapters of their specs return them."""
        alive, parse = self.runner.alive[0], self.runner.encoder.parse
        parsed = []
        for name, action in actions.items():
            column = self.columns[name]
            if alive[column]:
                parsed.append(parse(name, self.specs[name].action_adapter(action), 0, column))
        return parsed, []

    def _step_result(self, transition: Transition) -> StepResult:
        acted, alive = transition.acted[0].tolist(), self.runner.alive[0].tolist()
        terminated, truncated = transition.terminated[0].tolist(), transition.truncated[0].tolist()
        result = StepResult({}, {}, {}, {}, {}, [], bool(transition.finished[0]))
        for name, column in self.columns.items():
            if not (acted[column] or alive[column]):
                continue
            info: dict[str, Any] = {"events": [*event_names(int(transition.events[0, column]))]}
            info |= self._social_info()
            if terminated[column] or truncated[column]:
                info["outcome"] = _OUTCOMES[int(transition.outcome[0, column])]
            result.observations[name] = self._observation(name)
            result.rewards[name], result.infos[name] = self._reward_and_info(name, acted[column], info)
            result.terminated[name], result.truncated[name] = terminated[column], truncated[column]
            if not acted[column]:
                result.entered.append(name)
        if result.infos:
            self._social_failures = {}
        return result

    def _social_info(self) -> dict[str, Any]:
        """Return what an info says of other agents: their failures and `SimulationRunner.social_info`."""
        failures = {"social_failures": dict(self._social_failures)} if self._social_failures else {}
        return failures | self.runner.social_info(0)

    def _as_row(self, rewards: Mapping[str, Any]) -> tuple[NDArray, Bools]:
        """Return rewards as an array, shape (1, E), and which are numbers: adapters may return anything."""
        row = np.zeros((1, len(self.columns)))
        is_number = np.zeros(row.shape, np.bool_)
        for name, reward in rewards.items():
            if isinstance(reward, int | float | np.number):
                row[0, self.columns[name]] = reward
                is_number[0, self.columns[name]] = True
        return row, is_number

    def _check_names(self, given: Any) -> None:
        """Raise unless something is given by the agents' names.

        Raises:
            ActionError: It is not a mapping, or an agent is unknown; the remedy names the nearest.
        """
        if not isinstance(given, Mapping):
            remedy = f"give a dict by the agents' names, such as {{{next(iter(self.columns))!r}: ...}}"
            raise rejection(given, "is not a dict", "actions", remedy)
        for name in given:
            if name not in self.columns:
                remedy = nearest_names(str(name), [*self.columns])
                raise ActionError(f"there is no agent {name!r}", place="actions", remedy=remedy)


class DictEnvApi(NotCopied):
    """The methods that the APIs of one simulation share."""

    _env: DictEnv

    def annotate(self, name: str, values: Mapping[str, ArrayLike]) -> None:
        """Add values to the record of the agents' next decision; see `DictEnv.annotate`."""
        self._env.annotate(name, values)

    def render(self) -> Any:
        """Return a picture, shape (600, 800, 3), or show it; see `Renderer.render`."""
        return self._env.renderer.render()

    def close(self) -> None:
        """Free the simulation; may be called again."""
        self._env.close()


@cache
def event_names(bits: int) -> tuple[str, ...]:
    """Return the names of `Event` bits, in the order of the bits."""
    return tuple(name for bit, name in _EVENTS if bits & bit)
