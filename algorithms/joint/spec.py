"""Agents ordered into blocks (equal spaces) and groups (one network)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete

from algorithms.errors import SpaceError, nearest_names
from algorithms.joint.env import Action, AgentBlock, Ints, JointSpaces
from algorithms.joint.spaces import learned_space
from algorithms.settings import Sharing

SPEC = "__joint__"
"""Key of RLlib's `spaces` under which runners hand the `JointSpec` to the algorithm."""

Index = slice | Ints
"""Columns of an axis: a slice, hence a view, where they are contiguous."""


@dataclass(frozen=True, eq=False)
class Group:
    """Agents of one block that share a policy network.

    Attributes:
        id: Name of the group and of its RLlib module.
        agents: Names in column order.
        block: Number of their block.
        within: Indices within the block.
        columns: Indices among all N agents.
        observation: Space of each observation leaf.
        action: Action space.
        set_width: Units of the networks for leaves (K, F) that are sets of rows; 0: they are no sets.
        identity: Whether a network that several agents share tells them apart.
    """

    id: str
    agents: tuple[str, ...]
    block: int
    within: Index
    columns: Index
    observation: Mapping[str, Box]
    action: Action
    set_width: int = 0
    identity: bool = True

    @property
    def size(self) -> int:
        """Number of agents n."""
        return len(self.agents)

    @property
    def places(self) -> int:
        """Number of agents that an `Encoder` tells apart."""
        return self.size if self.identity else 1


@dataclass(frozen=True, eq=False)
class JointSpec:
    """Everything an algorithm may know about an environment before it runs.

    Attributes:
        agents: All N agents in column order (block after block).
        spaces: The blocks, the state's size, whether it has a graph.
        groups: Parameter-sharing groups; together they cover all agents.
    """

    agents: tuple[str, ...]
    spaces: JointSpaces
    groups: tuple[Group, ...]

    @classmethod
    def build(
        cls,
        spaces: JointSpaces,
        sharing: Sharing = "none",
        carried: Callable[[AgentBlock], Mapping[str, Box]] | None = None,
        set_width: int = 0,
        identity: bool = True,
    ) -> JointSpec:
        """Order the agents of `spaces` into groups; observations of other floats become float32.

        With `"all"`, agents with different spaces still get one network per block. `carried`
        returns the leaves that the sampler adds to the observations of a block.

        Raises:
            SpaceError: A group names an unknown agent, leaves one out, or mixes agents with different spaces;
                there are no sets for `set_width`.
        """
        spaces = spaces._replace(
            blocks=tuple(
                b._replace(observation={name: learned_space(leaf) for name, leaf in b.observation.items()})
                for b in spaces.blocks
            )
        )
        if carried is not None:
            blocks = (b._replace(observation={**b.observation, **carried(b)}) for b in spaces.blocks)
            spaces = spaces._replace(blocks=tuple(blocks))
        leaves = [leaf for block in spaces.blocks for leaf in block.observation.values()]
        if set_width and not any(len(leaf.shape) == 2 for leaf in leaves):
            raise SpaceError(
                f"set_width={set_width}, but no agent observes a set: an array of shape (rows, numbers)",
                place="observation space",
                remedy="add the feature 'neighbor_rows' to the observation, or leave out set_width",
            )
        agents = tuple(agent for block in spaces.blocks for agent in block.agents)
        name_of = _group_names(spaces, agents, sharing)
        groups: list[Group] = []
        for name in dict.fromkeys(name_of[agent] for agent in agents):
            group = _group(name, [a for a in agents if name_of[a] == name], spaces, agents)
            groups.append(replace(group, set_width=set_width, identity=identity))
        return cls(agents, spaces, tuple(groups))

    def describe(self) -> dict[str, Any]:
        """Return what a checkpoint depends on, in plain comparable values."""
        described: dict[str, Any] = {
            "state size": self.spaces.state,
            "communication graph": self.spaces.has_graph,
        }
        for group in self.groups:
            described[f"agents of group {group.id!r}"] = group.agents
            described[f"action space of group {group.id!r}"] = str(group.action)
            # Bounds do not enter a network's shape and may differ between a training and an evaluation scene.
            leaves = {name: (space.shape, str(space.dtype)) for name, space in group.observation.items()}
            described[f"observation space of group {group.id!r}"] = leaves
            if group.set_width:
                described[f"set_width of group {group.id!r}"] = group.set_width
            if group.places < group.size:
                described[f"identity of group {group.id!r}"] = group.identity
        return described


def check_spaces(found: JointSpec, wanted: JointSpec, *, place: str) -> None:
    """Raise if an environment to evaluate in has other agents or spaces than the training.

    Args:
        found: Spec of the environment.
        wanted: Spec of the training.
        place: The environment.

    Raises:
        SpaceError: It has.
    """
    if found.spaces != wanted.spaces:
        raise SpaceError(
            f"the environment has {found.spaces}, the policies were made for {wanted.spaces}",
            place=place,
            remedy="evaluate with the agents and the observation of the training",
        )


def agent_spaces(group: Group) -> tuple[gym.Space, gym.Space]:
    """Return (observation space, action space) of one agent of the group, as RLlib wants them."""
    leaves = group.observation
    return leaves[""] if list(leaves) == [""] else Dict(dict(leaves)), group.action


def action_size(action: Action) -> int:
    """Return the width of an action as critics see it: one-hot, or raw."""
    return int(action.n) if isinstance(action, Discrete) else int(np.prod(action.shape))


def _group_names(spaces: JointSpaces, agents: tuple[str, ...], sharing: Sharing) -> dict[str, str]:
    """Return each agent's group."""
    if sharing == "none":
        return {agent: agent for agent in agents}
    if sharing == "all":
        single = len(spaces.blocks) == 1
        named = {"shared" if single else f"shared_{k}": b.agents for k, b in enumerate(spaces.blocks)}
        return _named_groups(named, agents)
    if callable(sharing):
        return {agent: sharing(agent) for agent in agents}
    return _named_groups(sharing, agents)


def _named_groups(sharing: Mapping[str, Sequence[str]], agents: tuple[str, ...]) -> dict[str, str]:
    named = {agent: group for group, members in sharing.items() for agent in members}
    for agent in named.keys() - agents:
        raise SpaceError(
            f"group {named[agent]!r} names the agent {agent!r}, which the environment does not have",
            place="training(sharing=...)",
            remedy=nearest_names(agent, agents),
        )
    missing = [agent for agent in agents if agent not in named]
    if missing:
        raise SpaceError(
            f"no group holds {missing}", place="training(sharing=...)", remedy="put every agent in one"
        )
    return named


def _group(name: str, members: list[str], spaces: JointSpaces, agents: tuple[str, ...]) -> Group:
    blocks = {k for k, block in enumerate(spaces.blocks) for agent in block.agents if agent in members}
    if len(blocks) > 1:
        raise SpaceError(
            f"the agents {members} of group {name!r} have different spaces",
            place="training(sharing=...)",
            remedy="share parameters only among agents with equal observation and action spaces",
        )
    number = blocks.pop()
    block = spaces.blocks[number]
    within = _index([block.agents.index(agent) for agent in members])
    columns = _index([agents.index(agent) for agent in members])
    return Group(name, tuple(members), number, within, columns, block.observation, block.action)


def _index(places: list[int]) -> Index:
    if places == list(range(places[0], places[-1] + 1)):
        return slice(places[0], places[-1] + 1)
    return np.array(places)
