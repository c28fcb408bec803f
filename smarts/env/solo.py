"""One simulation with dicts of its agents: what the PettingZoo, RLlib and Gymnasium faces have in common."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box, Dict, Space
from numpy.typing import ArrayLike, NDArray

from smarts.agents.options import InterfaceError
from smarts.controllers.action_numbers import numbers_of, refusal
from smarts.controllers.lane_actions import lane_action_number
from smarts.env.adapters.actions import action_of, action_space, encode_one, remedy_of
from smarts.env.arrays import ArrayWorlds, EnvSettings, Group
from smarts.env.batch import Batch, EpisodeKey, Transition
from smarts.env.observation_collector import ObservationCollector
from smarts.errors import ActionError, nearest_names
from smarts.observations.action_mask import MASK
from smarts.observations.context import AdapterContext
from smarts.sensors.observation import Observation
from smarts.types.actions import ActionSpaceType
from smarts.types.events import Event, Outcome
from smarts.types.streams import check_seed


class Episodes:
    """Which episode comes next: the one after the last, or the first one of another seed."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._episode = -1

    def next(self, seed: int | None = None) -> EpisodeKey:
        """Return the key of the next episode."""
        if seed is not None:
            check_seed(seed, "reset")
            self._seed, self._episode = seed, -1
        self._episode += 1
        return EpisodeKey(0, self._episode, self._seed)


class SoloStep(NamedTuple):
    """What happened to the agents that acted, and what those see who are there now."""

    observations: dict[str, Any]
    """Of those who act next, and the last ones of those who have ended."""
    rewards: dict[str, float]
    terminated: dict[str, bool]
    truncated: dict[str, bool]
    infos: dict[str, dict[str, Any]]
    finished: bool
    """Whether the episode is over."""


class SoloWorld:
    """A simulation whose agents are named.

    Agents are served by the setting's array adapter. Where an agent's spec has adapters of its own, these
    come on top: its observation adapter gets an `Observation` object instead of the arrays; its reward and
    info adapters get that object and the array adapter's reward; what its action adapter returns may be
    whatever `HiWayEnv` takes.

    Args:
        setting: With one world.

    Raises:
        InterfaceError: A spec has an observation adapter, and does not say what space it leads to.
    """

    def __init__(self, setting: EnvSettings) -> None:
        self._worlds = ArrayWorlds(setting)
        self._episodes = Episodes(setting.seed)
        self._groups: dict[str, tuple[Group, int]] = {
            name: (group, place) for group in self._worlds.groups for place, name in enumerate(group.agents)
        }
        self.possible_agents = list(setting.interfaces())
        """All that there may be, in the order in which they were given."""
        self._columns = {name: column for column, name in enumerate(self._worlds.agents)}
        self._given = [
            np.zeros((1, len(group.agents), *(group.action.shape or ())), group.action.dtype)
            for group in self._worlds.groups
        ]
        self._adapted = setting.adapted()
        self._checked: set[str] = set()
        self._collector = self._look_on(setting.decision_interval)
        self.observation_spaces: dict[str, Space] = {
            name: self._observation_space(name) for name in self.possible_agents
        }
        self.action_spaces: dict[str, Space] = {
            name: self._action_space(name) for name in self.possible_agents
        }

    @property
    def agents(self) -> list[str]:
        """Who decides now."""
        alive = self._worlds.batch.alive[0]
        return [name for name in self.possible_agents if alive[self._columns[name]]]

    def reset(self, seed: int | None = None) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin the next episode, or with a seed the first one of that seed; return observations and infos.

        Raises:
            TrafficError: The traffic engine refused; another reset tries the episode after this one.
        """
        self._worlds.reset({0: self._episodes.next(seed)})
        self._worlds.batch.dispatch()
        agents = self.agents
        infos = self._with_masks({name: {} for name in agents})
        return {name: self._observation(name) for name in agents}, infos

    def annotate(self, name: str, values: Mapping[str, ArrayLike]) -> None:
        """Add to the record what agents have to say about their next actions; nothing if nothing is recorded.

        Args:
            name: What it is, such as "probabilities".
            values: A number or numbers of each agent; those of agents that are not alive do not matter.

        Raises:
            ActionError: An agent is unknown.
        """
        check_names(values, self.possible_agents)
        annotate_each(self._worlds.batch, name, {self._columns[who]: given for who, given in values.items()})

    def step(self, actions: Mapping[str, Any]) -> SoloStep:
        """Carry out a decision.

        Actions of agents that are not there (any more, or yet) are ignored, so that a loop over the last
        observations may act for those that have just ended. An agent without an action goes on as before.
        When the episode is over, nothing happens to nobody.

        Raises:
            ActionError: An agent is unknown, or an action is not in its space.
            TrafficError: The traffic engine failed; the next reset works.
            SmartsError: It was closed, or never reset.
        """
        self._worlds.batch.check_begun()
        check_names(actions, self.possible_agents)
        if not self._worlds.batch.running[0]:
            return SoloStep({}, {}, {}, {}, {}, True)
        chosen = np.zeros((1, len(self._columns)), np.bool_)
        present = {n: a for n, a in actions.items() if self._worlds.batch.alive[0, self._columns[n]]}
        with self._worlds.batch.all_or_none():
            for name, action in present.items():
                if not self._has(name, "action"):
                    self._put(name, action)
                    chosen[0, self._columns[name]] = True
            self._worlds.encode(self._given, chosen)
            for name, action in present.items():
                if self._has(name, "action"):
                    self._put_adapted(name, action)
        transition = self._worlds.advance()
        for error in transition.failures.values():
            raise error
        told = self._told(transition)
        rewards, paid = as_row(told.rewards, self._columns)
        self._worlds.batch.conclude(rewards, paid)
        self._worlds.batch.dispatch()
        return told

    def close(self) -> None:
        """Give back what the simulation holds; may be called again."""
        self._worlds.batch.close()

    def _has(self, name: str, adapter: str) -> bool:
        return name in self._adapted and adapter in self._adapted[name].own_adapters

    def _look_on(self, period: int) -> ObservationCollector | None:
        if not self._adapted:
            return None
        agents = np.array([self._columns[name] for name in self._adapted], np.int32)
        parts = self._worlds.parts
        served = AdapterContext(
            parts.scene, tuple(self._adapted), agents, ActionSpaceType.Empty, period, max_steps=0
        )
        onlooker = ObservationCollector(served)
        self._worlds.batch.watch(onlooker)
        return onlooker

    def _observation_space(self, name: str) -> Space:
        if not self._has(name, "observation"):
            return self._groups[name][0].observation
        space = self._adapted[name].observation_space
        if not isinstance(space, Space):
            raise InterfaceError(
                f"agent {name!r} has an observation adapter, and its observation_space is {space!r}",
                place="AgentSpec.observation_space",
                remedy="give the Gymnasium space of what the adapter returns, or use HiWayEnv",
            )
        return space

    def _action_space(self, name: str) -> Space:
        space = self._adapted[name].action_space if self._has(name, "action") else None
        return self._groups[name][0].action if space is None else space

    def _put_adapted(self, name: str, action: Any) -> None:
        column, batch = self._columns[name], self._worlds.batch
        adapted = self._adapted[name].action_adapter(action)
        kind = ActionSpaceType(int(self._worlds.parts.rules.action[column]))
        encode_one(name, kind, adapted, 0, column, batch.world.agents.action_mask[0, column], batch.actions)

    def _put(self, name: str, action: Any) -> None:
        group, place = self._groups[name]
        given = self._given[self._worlds.groups.index(group)]
        if not given.size:
            return
        if group.kind == ActionSpaceType.Lane and group.action == action_space(group.kind):
            given[0, place] = lane_action_number(action, agent=action_of(name))
            return
        whose, remedy = action_of(name), remedy_of(group.kind, group.action)
        # First as they are: a number that is not whole must not become a whole one.
        values = numbers_of(action, given.shape[2:], place=whose, remedy=remedy)
        is_whole = given.dtype.kind in "iu"
        kind: Any = np.iinfo(given.dtype) if is_whole else np.finfo(given.dtype)
        # Larger whole numbers are not exact any more.
        within = np.clip(values, kind.min, min(kind.max, 2**53) if is_whole else kind.max)
        if is_whole and (within != np.round(values)).any():
            raise refusal(action, "is not made of whole numbers", whose, remedy)
        given[0, place] = within

    def _told(self, transition: Transition) -> SoloStep:
        alive = self._worlds.batch.alive[0]
        acted = [name for name in self.possible_agents if transition.acted[0, self._columns[name]]]
        seen = [name for name in self.possible_agents if name in acted or alive[self._columns[name]]]

        def of_acted(array: NDArray) -> dict[str, Any]:
            return {name: array[0, self._columns[name]].item() for name in acted}

        rewards = of_acted(self._worlds.rewards)
        infos = {name: info_of(transition, self._columns[name]) for name in seen}
        for name in (name for name in self._adapted if name in infos):
            spec, reward, there = self._adapted[name], rewards.get(name, 0.0), self._object(name)
            infos[name]["score"] = float(
                self._worlds.batch.world.agents.distance_travelled[0, self._columns[name]]
            )
            infos[name] = spec.info_adapter(there, reward, infos[name])
            if name in rewards:
                rewards[name] = spec.reward_adapter(there, reward)
        return SoloStep(
            {name: self._observation(name) for name in seen},
            rewards,
            of_acted(transition.terminated),
            of_acted(transition.truncated),
            self._with_masks(infos),
            bool(transition.finished[0]),
        )

    def _with_masks(self, infos: dict[str, Any]) -> dict[str, Any]:
        """Return infos with the masks of the agents whose action spaces these are about."""
        masks = [group.action_mask() for group in self._worlds.groups]
        for name, info in infos.items():
            group, place = self._groups[name]
            mask = masks[self._worlds.groups.index(group)]
            # An info adapter may return anything.
            if mask is not None and not self._has(name, "action") and isinstance(info, Mapping):
                # As `Discrete.sample(mask)` takes it.
                infos[name] = {**info, MASK: mask[0, place].astype(np.int8)}
        return infos

    def _observation(self, name: str) -> Any:
        if self._has(name, "observation"):
            seen = self._adapted[name].observation_adapter(self._object(name))
            self._check_seen(name, seen)
            return seen
        group, place = self._groups[name]
        return group.observe(0, place)

    def _check_seen(self, name: str, seen: Any) -> None:
        """Refuse what an adapter makes of the first observation, if the agent's space does not have it."""
        if name in self._checked:
            return
        space = self.observation_spaces[name]
        if not _is_in(space, seen):
            raise InterfaceError(
                f"the observation adapter of agent {name!r} returns what is not in its space: {seen!r}",
                place="AgentSpec.observation_space",
                remedy=f"let it return an element of {space}, or give the space of what it returns",
            )
        self._checked.add(name)

    def _object(self, name: str) -> Observation:
        # There is an onlooker where anybody has adapters.
        return self._collector.seen[self._columns[name]]  # type: ignore[union-attr]


def info_of(transition: Transition, column: int) -> dict[str, Any]:
    """Return an agent's events of a decision by name, and the outcome if its episode has ended with it."""
    bits = int(transition.events[0, column])
    events = [event.name.lower() for event in Event if event and bits & event and event.name]
    info: dict[str, Any] = {"events": events}
    if transition.terminated[0, column] or transition.truncated[0, column]:
        info["outcome"] = Outcome(int(transition.outcome[0, column])).name.lower()
    return info


def annotate_each(batch: Batch, name: str, values: Mapping[int, ArrayLike]) -> None:
    """Add to the record of the only simulation what egos say, by column; see `Batch.annotate`."""
    for column, given in values.items():
        try:
            numbers = np.asarray(given, np.float64)
        except (TypeError, ValueError) as error:
            raise ActionError(
                f"{given!r} is not a number or an array of them", place=f"annotate({name!r})"
            ) from error
        who = np.zeros(batch.alive.shape, np.bool_)
        who[0, column] = True
        batch.annotate(name, np.broadcast_to(numbers, (*who.shape, *numbers.shape)), who)


def as_row(rewards: Mapping[str, Any], columns: Mapping[str, int]) -> tuple[NDArray, NDArray[np.bool_]]:
    """Return rewards as an array, shape (1, N), and which of them there are and are numbers."""
    row = np.zeros((1, len(columns)))
    is_number = np.zeros(row.shape, np.bool_)
    for name, reward in rewards.items():
        # Adapters may return anything.
        if isinstance(reward, int | float | np.number):
            row[0, columns[name]] = reward
            is_number[0, columns[name]] = True
    return row, is_number


def _is_in(space: Space, seen: Any) -> bool:
    """Return whether a space has an observation, whose numbers may be more precise than the space's."""
    if isinstance(space, Dict) and isinstance(seen, dict):
        spaces = space.spaces
        return seen.keys() == spaces.keys() and all(_is_in(spaces[name], seen[name]) for name in spaces)
    if isinstance(space, Box) and isinstance(seen, np.ndarray):
        are_floats = seen.dtype.kind == space.dtype.kind == "f"
        seen = seen.astype(space.dtype) if are_floats else seen
    return space.contains(seen)


def check_names(actions: Mapping[str, Any], known: Iterable[str]) -> None:
    """Refuse what is not a dict by name, and actions of agents that there never are.

    Raises:
        ActionError: Names the agent, and who there is.
    """
    known = list(known)
    if not isinstance(actions, Mapping):
        remedy = f"give a dict by the agents' names, such as {{{known[0]!r}: ...}}"
        raise refusal(actions, "is not a dict", "actions", remedy)
    for name in actions:
        if name not in known:
            raise ActionError(
                f"there is no agent {name!r}", place="actions", remedy=nearest_names(str(name), known)
            )
