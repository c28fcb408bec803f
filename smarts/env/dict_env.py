"""One simulation whose agents are addressed by name, as HiWayEnv, PettingZoo, RLlib and Gymnasium do.

Axis letters: E egos, B = 1 simulation.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Space
from numpy.typing import ArrayLike, NDArray

from smarts.agents.options import InterfaceError
from smarts.agents.spec import ADAPTERS
from smarts.arrays import Bools
from smarts.controllers.action_formats import rejection
from smarts.env.actions import Own, Parsed, element_of
from smarts.env.grouped_runner import make_runner
from smarts.env.groups import rewards_of
from smarts.env.observation_collector import ObservationCollector
from smarts.env.rendering import Renderer, RenderMode, check_render_mode
from smarts.env.runner import EpisodeKey, NotCopied, Transition
from smarts.env.settings import EnvSettings
from smarts.errors import ActionError, ScenarioError, nearest_names
from smarts.observations.action_mask import MASK
from smarts.types.events import Event, Outcome
from smarts.types.streams import check_seed

MOST_EMPTY = 10
"""Episodes in a row without any agent after which `reset` gives up."""
_EVENTS = [(int(event), str(event.name).lower()) for event in Event if event]
_ALL = frozenset(ADAPTERS)
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
    """Steps one simulation by dicts.

    Agents observe and are rewarded by the settings' array adapter. The adapters of an agent's spec are
    applied on top: its observation adapter gets an `Observation` object instead of the arrays; its reward and
    info adapters get that object and the array adapter's reward; its action adapter returns an action as
    `HiWayEnv` takes it.

    Args:
        settings: Settings with one simulation.
        sees_objects: Whether all agents observe objects, as in `HiWayEnv`.
        world: Index of the world whose episodes are played; after a reset with a seed, world 0.
        render_mode: See `Renderer`.

    Raises:
        InterfaceError: A spec has an observation adapter without the space that it leads to, or agents learn
            in bubbles and do not observe objects.
    """

    def __init__(
        self,
        settings: EnvSettings,
        *,
        sees_objects: bool = False,
        world: int = 0,
        render_mode: RenderMode | None = None,
    ) -> None:
        if not sees_objects:
            settings.refuse_bubbles()
        check_render_mode(render_mode)
        self.runner, self._groups = make_runner(settings, sees_objects=sees_objects)
        self.renderer = Renderer(self.runner, render_mode)
        self.specs = settings.specs()
        # The number of its group, and its place there.
        self._places = {
            name: (number, place)
            for number, group in enumerate(self._groups)
            for place, name in enumerate(group.agents)
        }
        columns = {name: column for column, name in enumerate(self._places)}
        self.columns = {name: columns[name] for name in self.specs}
        """The egos' columns by name, in the order in which results list them."""
        self._sees_objects = sees_objects
        self._own = {name: _ALL if sees_objects else spec.own_adapters for name, spec in self.specs.items()}
        agent_ids = [self.columns[name] for name, own in self._own.items() if own]
        self._collector = ObservationCollector(self.runner.scene, agent_ids)
        if agent_ids:
            self.runner.listen(self._collector)
        self._masks: list[Bools | None] = [None] * len(self._groups)
        self._seed, self._world, self._episode = settings.seed, world, -1

    @property
    def agents(self) -> list[str]:
        """The agents that decide now."""
        alive = self.runner.alive[0]
        return [name for name, column in self.columns.items() if alive[column]]

    def observation_spaces(self) -> dict[str, Space]:
        """Return the space of each agent's observations.

        Raises:
            InterfaceError: A spec has an observation adapter without the space that it leads to.
        """
        spaces = {name: self._groups[number].observation for name, (number, _) in self._places.items()}
        for name, spec in self.specs.items():
            if "observation" not in self._own[name]:
                continue
            if not isinstance(spec.observation_space, Space):
                raise InterfaceError(
                    f"agent {name!r} has an observation adapter, and its observation_space is "
                    f"{spec.observation_space!r}",
                    place="AgentSpec.observation_space",
                    remedy="give the Gymnasium space of what the adapter returns, or use HiWayEnv",
                )
            spaces[name] = spec.observation_space
        return {name: spaces[name] for name in self.columns}

    def action_spaces(self) -> dict[str, Space]:
        """Return the space of each agent's actions."""
        spaces = {name: self._groups[self._places[name][0]].action for name in self.columns}
        for name, spec in self.specs.items():
            if "action" in self._own[name] and spec.action_space is not None:
                spaces[name] = spec.action_space
        return spaces

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
        agents, about_others = self.agents, self._about_others()
        self._masks = [group.action_mask() for group in self._groups]
        infos = {name: self._with_mask(name, self._object_info(name) | about_others) for name in agents}
        if infos:
            self.runner.take_social_failures()
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
        for error in transition.failures.values():
            raise error
        result = self._step_result(transition)
        if self.runner.recorder is not None:
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

    def _encode(self, actions: Mapping[str, Any]) -> None:
        """Check the actions of active agents, then write them."""
        alive, encoder = self.runner.alive[0], self.runner.encoder
        parsed: list[Parsed] = []
        own: dict[int, Own] = {}
        for name, action in actions.items():
            column = self.columns[name]
            if not alive[column]:
                continue
            number, place = self._places[name]
            group = self._groups[number]
            if not group.encodes or "action" in self._own[name]:
                parsed.append(encoder.parse(name, self.specs[name].action_adapter(action), 0, column))
                continue
            if number not in own:
                shape = (1, len(group.agents))
                given = np.zeros((*shape, *(group.action.shape or ())), group.action.dtype)
                own[number] = Own(group, given, np.zeros(shape, np.bool_))
            own[number].given[0, place] = element_of(group, name, action)
            own[number].chosen[0, place] = True
        encoder.write([*own.values(), *parsed])

    def _step_result(self, transition: Transition) -> StepResult:
        acted, alive = transition.acted[0].tolist(), self.runner.alive[0].tolist()
        terminated, truncated = transition.terminated[0].tolist(), transition.truncated[0].tolist()
        rewards = rewards_of(self._groups, transition.acted)[0].tolist()
        events, about_others = transition.events[0].tolist(), self._about_others()
        self._masks = [group.action_mask() for group in self._groups]
        result = StepResult({}, {}, {}, {}, {}, [], bool(transition.finished[0]))
        for name, column in self.columns.items():
            if not (acted[column] or alive[column]):
                continue
            info: dict[str, Any] = {"events": [*event_names(events[column])], **about_others}
            if terminated[column] or truncated[column]:
                info["outcome"] = _OUTCOMES[int(transition.outcome[0, column])]
            result.observations[name] = self._observation(name)
            result.rewards[name], info = self._adapted(name, rewards[column], info, has_acted=acted[column])
            result.infos[name] = self._with_mask(name, info)
            result.terminated[name], result.truncated[name] = terminated[column], truncated[column]
            if not acted[column]:
                result.entered.append(name)
        if result.infos:
            self.runner.take_social_failures()
        return result

    def _observation(self, name: str) -> Any:
        """Return what an agent observes now."""
        if "observation" in self._own[name]:
            return self.specs[name].observation_adapter(self._collector.seen[self.columns[name]])
        number, place = self._places[name]
        return self._groups[number].observe(0, place)

    def _adapted(self, name: str, reward: float, info: Any, *, has_acted: bool) -> tuple[Any, Any]:
        """Return the reward and info that an agent gets, by the adapters of its spec.

        Args:
            name: The agent.
            reward: The array adapter's.
            info: What is known of the decision.
            has_acted: Whether the agent has made the decision; else it has just entered.
        """
        if not self._own[name]:
            return reward, info
        column, spec = self.columns[name], self.specs[name]
        seen = self._collector.seen[column]
        info["score"] = float(self.runner.world.agents.distance_travelled[0, column])
        info = spec.info_adapter(seen, reward, info | self._object_info(name))
        return spec.reward_adapter(seen, reward) if has_acted or self._sees_objects else reward, info

    def _object_info(self, name: str) -> dict[str, Any]:
        """Return an agent's object for its info, with what did not fit into it; {} if arrays are seen."""
        if not self._sees_objects:
            return {}
        seen = self._collector.seen[self.columns[name]]
        return {"env_obs": seen, "left_out": seen.left_out} if seen.left_out else {"env_obs": seen}

    def _with_mask(self, name: str, info: Any) -> Any:
        """Return an info with the mask of the agent's actions, if it has one and the info is a mapping."""
        number, place = self._places[name]
        mask = self._masks[number]
        if mask is None or "action" in self._own[name] or not isinstance(info, Mapping):
            return info
        # As `Discrete.sample(mask)` takes it.
        return {**info, MASK: mask[0, place].astype(np.int8)}

    def _about_others(self) -> dict[str, Any]:
        """Return what infos say of other agents: the failures that none has named yet, and `social_info`."""
        failed = self.runner.social_failures.get(0)
        return ({"social_failures": failed} if failed else {}) | self.runner.social_info(0)

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
