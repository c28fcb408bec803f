"""Social policies: the policies of the agents that are no egos, by their number in a run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

import numpy as np

from smarts.agents.checks import (
    Count,
    InterfaceError,
    Listed,
    Positive,
    checked,
)
from smarts.agents.hosting.options import HERE, HostOptions, Starter
from smarts.agents.interface import AgentInterface
from smarts.agents.spec import AgentSpec
from smarts.errors import shown

ALL_MISSIONS = "missions"
"""A count that stands for as many agents as there are missions left."""


@dataclass(frozen=True)
class SocialPolicy:
    """One policy of a run, which acts for any number of agents; its number is its place in the run's list."""

    name: str
    """Name for errors and records: that of its actor in the scenario, or its locator."""
    locator: str
    """Its name in the zoo, as "module:name-v0"."""
    spec: AgentSpec
    """Its interface, and how it is made."""
    interface: int
    """Number of its interface in the pool."""
    period: int = 1
    """Steps from one decision to the next."""
    step_length: float | None = None
    """Length of the steps in which the policy counts time [s]; None: steps of any length."""
    is_boid: bool = False
    """Whether one instance acts for all vehicles of a bubble."""
    keep_alive: bool = False
    """Whether that instance lives as long as the episode, and not only while it has vehicles."""
    observation: Any = None
    """What a `BatchAgent` observes; None for an agent that gets an `Observation` object for each vehicle."""
    start: Starter | None = None
    """Starts the agent elsewhere; None: it acts in this process."""
    host: HostOptions = HERE
    """Options of the time in which it acts."""


class Wanted(NamedTuple):
    """A policy that a scenario or an environment asks for. Equal ones are one policy of the run."""

    locator: str
    """Its name in the zoo."""
    options: str
    """The arguments of its policy, as a text that is equal for equal arguments."""
    boid: str = ""
    """Id of the boid actor, "" for none."""


def wanted(locator: str, options: Mapping[str, Any], boid: str = "") -> Wanted:
    """Return the policy with some arguments."""
    return Wanted(locator, json.dumps(options, sort_keys=True, default=_plain), boid)


def _plain(value: Any) -> Any:
    """Return what stands for a value in a text; all numbers of an array do."""
    return value.tolist() if isinstance(value, np.ndarray) else repr(value)


@checked
class SocialAgents:
    """Social agents that an environment adds: they take the missions that its learning agents leave."""

    PLACE: ClassVar = "social_agents"

    agent: str
    """Name of the agent in the zoo, as "module:name-v0"."""
    count: Count | Literal["missions"] = 1
    """How many; "missions": as many as there are missions left."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Arguments for the agent's policy, in place of the registered ones."""


@checked
class BubbleLearning:
    """Learning agents that drive the vehicles in bubbles: they have no missions, and come and go."""

    PLACE: ClassVar = "learn_in_bubbles"

    episode_time: Positive
    """Length of episodes [s]."""
    bubbles: Annotated[tuple[str, ...], Listed] = ()
    """Ids of the bubbles; empty: all. In the others the scenario's actors drive."""

    def has(self, bubble: str) -> bool:
        """Return whether the learning agents drive in a bubble, given by its id."""
        return not self.bubbles or bubble in self.bubbles


def bubble_learning(bubbles: Any, episode_time: Any) -> BubbleLearning | None:
    """Return how agents learn in bubbles, None if they do not.

    Args:
        bubbles: Ids, True for all, False for none.
        episode_time: Length of episodes [s]; None: not given.

    Raises:
        InterfaceError: One of them is not what it has to be, or is given without the other.
    """
    if not bubbles:
        if episode_time is not None:
            raise InterfaceError(
                f"episode_time is {shown(episode_time)}, and no agent learns in bubbles",
                place="episode_time",
                remedy="leave it out, or give learn_in_bubbles=True; agents with missions have "
                "AgentInterface(max_episode_steps=...)",
            )
        return None
    if episode_time is None:
        raise InterfaceError(
            f"learn_in_bubbles is {shown(bubbles)}, and episode_time is not given",
            place="episode_time",
            remedy="give the length of episodes [s], such as episode_time=60",
        )
    return BubbleLearning(episode_time, () if bubbles is True else bubbles)


def social_agents(given: Iterable[SocialAgents | Mapping[str, Any]]) -> tuple[SocialAgents, ...]:
    """Return the social agents of an environment, each given as itself or as a dict of its fields.

    Raises:
        InterfaceError: A field is not what it can be.
    """
    return tuple(each if isinstance(each, SocialAgents) else SocialAgents(**each) for each in given)


@dataclass(frozen=True)
class Cast:
    """The social policies of a run."""

    policies: tuple[SocialPolicy, ...] = ()
    """Policies by number."""
    numbers: Mapping[Wanted, int] = field(default_factory=dict)
    """Number of each policy that was asked for."""
    extra: tuple[tuple[int, int | str], ...] = ()
    """Number and count of the policies that the environment adds."""
    learning: BubbleLearning | None = None
    """How the learning agents learn in bubbles; None: they have missions."""

    def __bool__(self) -> bool:
        """Return whether bubbles and social agents take part in the run."""
        return bool(self.policies or self.learning)

    @property
    def interfaces(self) -> tuple[AgentInterface, ...]:
        """The policies' interfaces, by their number in the pool."""
        return distinct(interface_of(policy.spec) for policy in self.policies)


def distinct(interfaces: Iterable[AgentInterface]) -> tuple[AgentInterface, ...]:
    """Return each interface once, in order of appearance."""
    # By comparison: an interface with options of the user's own need not be hashable.
    found: list[AgentInterface] = []
    for interface in interfaces:
        if interface not in found:
            found.append(interface)
    return tuple(found)


def interface_of(spec: AgentSpec) -> AgentInterface:
    """Return the interface of a spec that has one."""
    assert spec.interface is not None
    return spec.interface


NO_CAST = Cast()
"""The cast of a run without social agents."""
