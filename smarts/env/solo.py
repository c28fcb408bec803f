"""One simulation with dicts of its agents: what the PettingZoo, RLlib and Gymnasium faces have in common."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Space
from numpy.typing import NDArray

from smarts.env.arrays import ArrayWorlds, Group, Setting, nested
from smarts.env.batch import EpisodeKey, Transition
from smarts.errors import ActionError, nearest_names
from smarts.types.events import Event, Outcome


class Episodes:
    """Which episode comes next: the one after the last, or the first one of another seed."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self._episode = -1

    def next(self, seed: int | None = None) -> EpisodeKey:
        """Return the key of the next episode."""
        if seed is not None:
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

    Args:
        setting: With one world.
    """

    def __init__(self, setting: Setting) -> None:
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
        self.observation_spaces: dict[str, Space] = {
            name: self._groups[name][0].observation for name in self.possible_agents
        }
        self.action_spaces: dict[str, Space] = {
            name: self._groups[name][0].action for name in self.possible_agents
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
        return {name: self._observation(name) for name in agents}, {name: {} for name in agents}

    def step(self, actions: Mapping[str, Any]) -> SoloStep:
        """Carry out a decision.

        Actions of agents that are not there (any more, or yet) are ignored, so that a loop over the last
        observations may act for those that have just ended. An agent without an action goes on as before.
        When the episode is over, nothing happens to nobody.

        Raises:
            ActionError: An agent is unknown, or an action is not in its space.
            TrafficError: The traffic engine failed; the next reset works.
        """
        check_names(actions, self.possible_agents)
        if not self._worlds.batch.running[0]:
            return SoloStep({}, {}, {}, {}, {}, True)
        chosen = np.zeros((1, len(self._columns)), np.bool_)
        for name, action in actions.items():
            column = self._columns[name]
            if self._worlds.batch.alive[0, column]:
                self._put(name, action)
                chosen[0, column] = True
        transition = self._worlds.step(self._given, chosen)
        for error in transition.failures.values():
            raise error
        self._worlds.batch.dispatch()
        return self._told(transition)

    def close(self) -> None:
        """Give back what the simulation holds; may be called again."""
        self._worlds.batch.close()

    def _put(self, name: str, action: Any) -> None:
        group, place = self._groups[name]
        number = self._worlds.groups.index(group)
        shape = self._given[number].shape[2:]
        try:
            # First as they are: a number that is not whole must not become a whole one.
            values = np.asarray(action, np.float64).reshape(shape)
        except (TypeError, ValueError) as error:
            raise ActionError(
                f"{action!r} is not an action",
                place=f"action of {name!r}",
                remedy=f"give an element of {group.action}",
            ) from error
        if np.issubdtype(self._given[number].dtype, np.integer) and values != np.round(values):
            raise ActionError(
                f"{action!r} is not a whole number",
                place=f"action of {name!r}",
                remedy=f"give an element of {group.action}",
            )
        self._given[number][0, place] = values

    def _told(self, transition: Transition) -> SoloStep:
        alive = self._worlds.batch.alive[0]
        acted = [name for name in self.possible_agents if transition.acted[0, self._columns[name]]]
        seen = [name for name in self.possible_agents if name in acted or alive[self._columns[name]]]

        def of_acted(array: NDArray) -> dict[str, Any]:
            return {name: array[0, self._columns[name]].item() for name in acted}

        return SoloStep(
            {name: self._observation(name) for name in seen},
            of_acted(self._worlds.rewards),
            of_acted(transition.terminated),
            of_acted(transition.truncated),
            {name: self._info(name, transition) for name in seen},
            bool(transition.finished[0]),
        )

    def _observation(self, name: str) -> dict[str, Any]:
        group, place = self._groups[name]
        return nested(group.adapter.observations, 0, place)

    def _info(self, name: str, transition: Transition) -> dict[str, Any]:
        column = self._columns[name]
        return info_of(transition, column)


def info_of(transition: Transition, column: int) -> dict[str, Any]:
    """Return an agent's events of a decision by name, and the outcome if its episode has ended with it."""
    bits = int(transition.events[0, column])
    events = [event.name.lower() for event in Event if event and bits & event and event.name]
    info: dict[str, Any] = {"events": events}
    if transition.terminated[0, column] or transition.truncated[0, column]:
        info["outcome"] = Outcome(int(transition.outcome[0, column])).name.lower()
    return info


def check_names(actions: Iterable[str], known: Iterable[str]) -> None:
    """Refuse actions of agents that there never are.

    Raises:
        ActionError: Names the agent, and who there is.
    """
    known = list(known)
    for name in actions:
        if name not in known:
            raise ActionError(
                f"there is no agent {name!r}", place="actions", remedy=nearest_names(str(name), known)
            )
