"""Groups of egos with equal spaces, each with the array adapter that makes their observations and rewards.

Axis letters: B simulations, E egos, G egos of a group.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, cast

import numpy as np
from gymnasium.spaces import Box, Dict, Space
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.arrays import Bools, Ints, Singles
from smarts.controllers import action_space
from smarts.env.adapters import ArrayAdapter
from smarts.env.settings import EnvSettings
from smarts.observations.action_mask import MASK
from smarts.observations.context import AdapterContext
from smarts.observations.lists import feature_list
from smarts.roads.scene import Scene
from smarts.sim.assembly import Assembly
from smarts.types.actions import Actions, ActionSpaceType
from smarts.types.interface import Field

ALONE = "observation"
"""Name of a field that is the whole observation where it is the only one."""


class ActionEncoding(Protocol):
    """How an array adapter's agents act, if not as their action type says; both members are the adapter's."""

    action_space: Space

    def encode(self, given: NDArray, chosen: Bools, out: Actions) -> None:
        """Check the chosen agents' actions, and write them: numbers, `given`, `fresh` and `action_mask`.

        Args:
            given: Elements of the space, shape (B, G, ...); entries where `~chosen` are unspecified.
            chosen: Which agents act, shape (B, G); the others keep the lasting part of their last action.
            out: Written, shape (B, A).

        Raises:
            ActionError: An action is not finite or not in the space; names agent and value.
        """
        ...


@dataclass(frozen=True)
class AgentGroup:
    """Egos with equal spaces, in consecutive columns."""

    context: AdapterContext
    """The egos, as their adapter knows them."""
    adapter: ArrayAdapter
    fields: tuple[Field, ...]
    """What an observation of one of them by name consists of."""
    observation: Space
    """A Box if that is the field "observation" alone, else a Dict."""
    action: Space
    encodes: bool
    """Whether the adapter is an `ActionEncoding` too."""

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of the egos."""
        return self.context.agents

    @property
    def agent_ids(self) -> Ints:
        """Rows of `AgentStates`, shape (G,)."""
        return self.context.agent_ids

    @cached_property
    def columns(self) -> slice:
        """Columns of the egos."""
        first = int(self.context.agent_ids[0])
        return slice(first, first + len(self.context.agents))

    @property
    def arrays(self) -> dict[str, NDArray]:
        """Array of each field, shape (B, G, *shape)."""
        return {field.name: self.adapter.observations[field.name] for field in self.fields}

    def observe(self, row: int, place: int) -> Any:
        """Return a copy of one agent's observation, an element of the space `observation`."""
        # Without the ellipsis a field of a single number would not be an array.
        return assembled({name: array[row, place, ...].copy() for name, array in self.arrays.items()})

    def action_mask(self) -> Bools | None:
        """Return which discrete actions are allowed, shape (B, G, actions), None if the adapter does not say.

        Agents that do not act get a mask with only action 0 allowed: masked logits stay finite.
        """
        mask = self.adapter.observations.get(MASK)
        if mask is None:
            return None
        action_mask = mask.astype(np.bool_)
        action_mask[..., 0] |= ~action_mask.any(axis=-1)
        return action_mask


def make_groups(
    settings: EnvSettings, *, sees_objects: bool = False
) -> tuple[Assembly, tuple[AgentGroup, ...]]:
    """Return the simulations, and their egos by groups, which are in the order of their first members.

    Args:
        settings: What the environment is made from.
        sees_objects: Whether all agents observe objects instead of arrays, so that they are one group.

    Raises:
        SmartsError: A scenario or an agent is not what it has to be.
    """
    interfaces = settings.interfaces()
    # An adapter made by a function may read every sensor.
    sensors = None if sees_objects else getattr(settings.adapter_class, "sensors", None)
    needs_equal = feature_list(settings.observation).needs_equal_sensors
    grouped = [interfaces] if sees_objects else _grouped(interfaces, None if needs_equal else sensors)
    flat = {name: interface for members in grouped for name, interface in members.items()}
    assembly = settings.assemble(flat, sensors)
    groups, first = [], 0
    for members in grouped:
        groups.append(_group(members, first, assembly.scene, settings))
        first += len(members)
    return assembly, tuple(groups)


def rewards_of(groups: Sequence[AgentGroup], acted: Bools) -> Singles:
    """Return the rewards of the last decision, 0 for egos that did not act, shape (B, E)."""
    rewards = np.concatenate([group.adapter.rewards for group in groups], axis=1, dtype=np.float32)
    rewards *= acted
    return rewards


def box_of(field: Field) -> Box:
    """Return the space of a field."""
    # Plain numbers: Box takes neither enumerations nor numpy's.
    dtype: Any = field.dtype
    return Box(float(field.low), float(field.high), field.shape, dtype)


def assembled(parts: Mapping[str, Any]) -> Any:
    """Return the parts of an observation as one: "observation" itself if it is alone, else a tree of dicts.

    A part named "a/b" is "b" in a dict "a".
    """
    if [*parts] == [ALONE]:
        return parts[ALONE]
    tree: dict[str, Any] = {}
    for full_name, part in parts.items():
        *path, name = full_name.split("/")
        inner = tree
        for step in path:
            inner = inner.setdefault(step, {})
        inner[name] = part
    return tree


def space_of(tree: Space | Mapping[str, Any]) -> Space:
    """Return the space of what `assembled` makes, out of what it makes of the parts' spaces."""
    return tree if isinstance(tree, Space) else Dict({name: space_of(part) for name, part in tree.items()})


def _grouped(
    interfaces: Mapping[str, AgentInterface], sensors: Collection[str] | None
) -> list[dict[str, AgentInterface]]:
    """Return the agents that one adapter can serve together."""
    groups: dict[Any, dict[str, AgentInterface]] = {}
    for name, interface in interfaces.items():
        observed = tuple(
            (sensor, option)
            for sensor, option in interface.sensors.items()
            if sensors is None or sensor in sensors
        )
        key = (interface.action, interface.max_episode_steps, observed)
        groups.setdefault(key, {})[name] = interface
    return list(groups.values())


def _group(
    members: Mapping[str, AgentInterface], first: int, scene: Scene, settings: EnvSettings
) -> AgentGroup:
    context = context_of(scene, members, first, settings.decision_interval)
    adapter = settings.make_adapter(context)
    fields = tuple(field for field in adapter.fields if settings.action_mask or field.name != MASK)
    encodes = hasattr(adapter, "encode")
    # One object for all agents of a group: PettingZoo asks for it, and learners compare by identity.
    return AgentGroup(
        context,
        adapter,
        fields,
        observation=space_of(assembled({field.name: box_of(field) for field in fields})),
        action=cast(ActionEncoding, adapter).action_space if encodes else action_space(context.action),
        encodes=encodes,
    )


def context_of(
    scene: Scene, members: Mapping[str, AgentInterface], first: int, period: int
) -> AdapterContext:
    """Return what an adapter has to know of egos that act alike, the first of which is in column `first`."""
    interface = next(iter(members.values()))
    return AdapterContext(
        scene=scene,
        agents=tuple(members),
        agent_ids=np.arange(first, first + len(members), dtype=np.int32),
        action=ActionSpaceType.Empty if interface.action is None else interface.action,
        period=period,
        max_steps=interface.max_episode_steps or 0,
        interfaces=tuple(members.values()),
    )
