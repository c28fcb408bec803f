"""Agents as arrays: those with equal spaces form a group, which one adapter serves."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Space
from numpy.typing import ArrayLike, NDArray

from smarts.agents.benchmark import benchmark_interface
from smarts.agents.checks import check_truth
from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.agents.spec import AgentSpec
from smarts.controllers.action_numbers import numbers_of, refusal
from smarts.env.adapters import ADAPTERS
from smarts.env.adapters.actions import action_of, remedy_of
from smarts.env.adapters.protocol import ArrayAdapter
from smarts.env.batch import Batch, EpisodeKey, Transition
from smarts.env.setting_checks import (
    LONGEST_DECISION,
    MOST_WORLDS,
    check_agents,
    check_instance,
    check_options,
    check_scenarios,
    check_traffic,
    check_whole,
)
from smarts.errors import ActionError
from smarts.observations.action_mask import MASK
from smarts.observations.context import AdapterContext
from smarts.sim.assembly import Assembly, Options, assemble
from smarts.sstudio.build import build_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import agent_names
from smarts.types.interface import Field
from smarts.types.streams import check_seed

ALONE = "observation"
"""Name of a field that is the whole observation where it is the only one."""

Agents = int | Mapping[str, AgentSpec | AgentInterface]
"""The learning agents: how many of the benchmark's, or what each is like by its name."""
Adapter = str | Callable[..., ArrayAdapter]
"""A name of `ADAPTERS`, or what makes one: a class, called with `Served`, the agents' interface, and the
options by their names."""


@dataclass(frozen=True)
class EnvSettings:
    """What all environments are made from."""

    scenarios: Sequence[str | Path]
    """Folders, or names of the suite, each perhaps with "@variation"."""
    agents: Agents = 4
    worlds: int = 1
    seed: int = 42
    decision_interval: int = 5
    """Steps of 0.1 s from one decision to the next."""
    adapter: Adapter = "benchmark"
    adapter_options: Mapping[str, Any] = field(default_factory=dict)
    simulation: Options = field(default_factory=Options)
    traffic: Sequence[str] | None = None
    """The variations of the scenarios' traffic that are played, by default all."""
    action_mask: bool = False
    """Whether observations by name hold the mask too; it is in the infos anyway."""

    def __post_init__(self) -> None:
        check_scenarios(self.scenarios)
        check_traffic(self.traffic)
        check_agents(self.agents)
        check_whole("num_envs", self.worlds, 1, MOST_WORLDS)
        check_whole("decision_interval", self.decision_interval, 1, LONGEST_DECISION)
        check_seed(self.seed, "seed")
        check_instance("simulation", self.simulation, Options, "smarts.sim.assembly.Options(...)")
        check_truth("action_mask", self.action_mask)
        check_options(maker_of(self.adapter), self.adapter_options)

    def interfaces(self) -> dict[str, AgentInterface]:
        """Return the agents' interfaces by name.

        Raises:
            InterfaceError: There are no agents, or one has no interface.
        """
        if not isinstance(self.agents, Mapping):
            return {name: benchmark_interface() for name in agent_names(self.agents)}
        interfaces = {}
        for name, given in self.agents.items():
            interface = given.interface if isinstance(given, AgentSpec) else given
            if not isinstance(interface, AgentInterface):
                raise InterfaceError(
                    f"the interface of agent {name!r} is {interface!r}",
                    place="agent_specs",
                    remedy="give an AgentInterface(...), or an AgentSpec(interface=AgentInterface(...))",
                )
            interfaces[name] = interface
        return interfaces

    def adapted(self) -> dict[str, AgentSpec]:
        """Return the specs of the agents that have adapters of their own, by name."""
        if not isinstance(self.agents, Mapping):
            return {}
        specs = {name: given for name, given in self.agents.items() if isinstance(given, AgentSpec)}
        return {name: spec for name, spec in specs.items() if spec.own_adapters}

    def assemble(
        self, interfaces: Mapping[str, AgentInterface], sensors: Collection[str] | None = None
    ) -> Assembly:
        """Return the simulations, with the egos in the order of their interfaces.

        Args:
            interfaces: Of the egos.
            sensors: Names of those that are looked at (None: all) for agents without adapters of their own.

        Raises:
            SmartsError: A scenario cannot be built or played.
        """
        if not interfaces:
            raise InterfaceError("there are no agents", remedy="name at least one")
        return assemble(
            [self._build(scenario, len(interfaces)) for scenario in self.scenarios],
            list(interfaces.values()),
            agents=list(interfaces),
            looked_at=self._looked_at(interfaces, sensors),
            worlds=self.worlds,
            seed=self.seed,
            options=self.simulation,
        )

    def _looked_at(
        self, interfaces: Mapping[str, AgentInterface], sensors: Collection[str] | None
    ) -> dict[int, Collection[str]]:
        adapted = self.adapted()
        return {
            agent_id: sensors
            for agent_id, name in enumerate(interfaces)
            if sensors is not None and name not in adapted
        }

    def _build(self, scenario: str | Path, egos: int) -> BuiltScenario:
        built = build_scenario(scenario, egos=egos)
        return built if self.traffic is None else built.with_traffic(self.traffic)


@dataclass(frozen=True)
class Group:
    """Agents with equal spaces, in consecutive agents."""

    agents: tuple[str, ...]
    columns: slice
    """Of the egos."""
    adapter: ArrayAdapter
    fields: tuple[Field, ...]
    """What an observation of one of them by name consists of."""
    observation: Space
    """A Box if that is the field "observation" alone, else a Dict."""
    action: Space
    kind: ActionSpaceType
    """How their interfaces say that they act."""

    def observe(self, row: int, place: int) -> Any:
        """Return a copy of one agent's observation, an element of the space `observation`."""
        arrays = {field.name: self.adapter.observations[field.name] for field in self.fields}
        # Without the ellipsis a field of a single number would not be an array.
        return assembled({name: array[row, place, ...].copy() for name, array in arrays.items()})

    def action_mask(self) -> NDArray[np.bool_] | None:
        """Return which discrete actions are legal, shape (B, G, actions), None if the adapter does not say.

        Where none is, as for agents that do not act, it is the first one: masked logits stay finite.
        """
        mask = self.adapter.observations.get(MASK)
        if mask is None:
            return None
        action_mask = mask.astype(np.bool_)
        action_mask[..., 0] |= ~action_mask.any(axis=-1)
        return action_mask


class ArrayWorlds:
    """B simulations whose egos are seen and driven by arrays, those of a group side by side.

    Egos are in the order of their groups, and those in the order of their first members.
    """

    def __init__(self, setting: EnvSettings) -> None:
        make = maker_of(setting.adapter)
        # Callables that say nothing may look at everything.
        sensors = getattr(make, "sensors", None)
        grouped = _grouped(setting.interfaces(), sensors)
        flat = {name: interface for members in grouped for name, interface in members.items()}
        self.parts = parts = setting.assemble(flat, sensors)
        """What the simulations consist of."""
        self.agents = tuple(flat)
        """Names in the order of the columns."""
        self.seed = setting.seed
        self.groups = tuple(_groups(grouped, parts, setting, make))
        """In the order of the columns."""
        self.batch = Batch(parts, [group.adapter for group in self.groups], period=setting.decision_interval)
        self.rewards = np.zeros((setting.worlds, len(flat)), np.float32)
        """Of the last decision, 0 for who did not act, shape (B, N)."""

    def reset(self, episodes: Mapping[int, EpisodeKey]) -> None:
        """Begin episodes; see `Batch.reset`."""
        self.batch.reset(episodes)

    def step(self, actions: Sequence[ArrayLike] | NDArray, chosen: NDArray[np.bool_]) -> Transition:
        """Carry out a decision.

        Args:
            actions: Of each group, shape (B, G, ...).
            chosen: Whose actions are to be taken, shape (B, N); only of those who are alive they are.

        Raises:
            ActionError: An action is not one.
        """
        with self.batch.all_or_none():
            self.encode(actions, chosen)
        return self.advance()

    def encode(self, actions: Sequence[ArrayLike] | NDArray, chosen: NDArray[np.bool_]) -> None:
        """Take actions in, as `step` does."""
        chosen = chosen & self.batch.alive
        wanted = f"give an array for each of {len(self.groups)} blocks of agents"
        blocks = _blocks(actions)
        if blocks is None:
            raise refusal(actions, "is not a list of arrays", "actions", wanted)
        if len(blocks) != len(self.groups):
            raise ActionError(f"actions of {len(blocks)} blocks of agents", place="actions", remedy=wanted)
        for group, given in zip(self.groups, blocks, strict=True):
            taken = _taken(group, given, chosen[:, group.columns])
            group.adapter.encode(taken, chosen[:, group.columns], self.batch.actions)

    def advance(self) -> Transition:
        """Carry out the decision that was taken in."""
        transition = self.batch.step()
        for group in self.groups:
            self.rewards[:, group.columns] = group.adapter.rewards
        self.rewards *= transition.acted
        return transition


def box_of(field: Field) -> Box:
    """Return the space of a field."""
    # Plain numbers: Box takes neither enumerations nor numpy's.
    dtype: Any = field.dtype
    return Box(float(field.low), float(field.high), field.shape, dtype)


def assembled(parts: Mapping[str, Any]) -> Any:
    """Return the parts of an observation as one: "observation" itself if it is alone, else a tree of dicts.

    A part named "a/b" is "b" in a dict of its own, "a".
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


def _blocks(actions: Any) -> Sequence[ArrayLike] | NDArray | None:
    """Return what is given for each block of agents, None if that is no list; arrays are any library's."""
    if isinstance(actions, Sequence):
        return actions
    if not hasattr(actions, "__array__"):
        return None
    try:
        values = np.asarray(actions)
    except (TypeError, ValueError, RuntimeError):
        return None
    return values if values.ndim else None


def _taken(group: Group, given: ArrayLike, chosen: NDArray[np.bool_]) -> NDArray:
    """Return a group's actions as numbers, shape (B, G, ...); those of who is not chosen may be anything."""
    wanted = (len(chosen), len(group.agents), *(group.action.shape or ()))
    place, remedy = f"actions of {', '.join(group.agents)}", f"give an array of shape {wanted}"
    try:
        values = np.asarray(given)
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        raise refusal(given, "is not an array", place, remedy) from error
    if values.shape != wanted:
        raise refusal(given, f"is of shape {values.shape}", place, remedy)
    if values.dtype.kind in "iuf":
        return values
    # Something is no number, or is too large for an array: say whose.
    each, values = np.asarray(given, object), np.zeros(wanted)
    for row, column in np.argwhere(chosen).tolist():
        whose = action_of(group.agents[column], row if len(chosen) > 1 else None)
        remedy = remedy_of(group.kind, group.action)
        values[row, column] = numbers_of(each[row, column], wanted[2:], place=whose, remedy=remedy)
    return values


def maker_of(adapter: Adapter) -> Callable[..., ArrayAdapter]:
    """Return what makes an adapter.

    Raises:
        UnknownNameError: There is none of this name.
        InterfaceError: It is neither a name nor anything that can be called.
    """
    if isinstance(adapter, str):
        return ADAPTERS[adapter]
    if not callable(adapter):
        raise InterfaceError(
            f"{adapter!r} is not an adapter",
            place="adapter",
            remedy=f"give one of {', '.join(ADAPTERS)}, or a class as in smarts/env/adapters/protocol.py",
        )
    return adapter


def _grouped(
    interfaces: Mapping[str, AgentInterface], looked_at: Collection[str] | None
) -> list[dict[str, AgentInterface]]:
    """Return the agents that one adapter can serve together."""
    groups: dict[Any, dict[str, AgentInterface]] = {}
    for name, interface in interfaces.items():
        sensors = tuple(
            (name, option)
            for name, option in interface.sensors.items()
            if looked_at is None or name in looked_at
        )
        key = (interface.action, interface.max_episode_steps, sensors)
        groups.setdefault(key, {})[name] = interface
    return list(groups.values())


def _groups(
    grouped: Sequence[Mapping[str, AgentInterface]],
    parts: Assembly,
    setting: EnvSettings,
    make: Callable[..., ArrayAdapter],
) -> list[Group]:
    groups, first = [], 0
    for members in grouped:
        interface = next(iter(members.values()))
        columns = slice(first, first + len(members))
        served = AdapterContext(
            scene=parts.scene,
            agents=tuple(members),
            agent_ids=np.arange(columns.start, columns.stop, dtype=np.int32),
            action=ActionSpaceType.Empty if interface.action is None else interface.action,
            period=setting.decision_interval,
            max_steps=interface.max_episode_steps or 0,
            interfaces=tuple(members.values()),
        )
        adapter = make(served, interface, **setting.adapter_options)
        fields = tuple(field for field in adapter.fields if setting.action_mask or field.name != MASK)
        # One object for all agents of a group: PettingZoo asks for it, and learners compare by identity.
        spaces = space_of(assembled({field.name: box_of(field) for field in fields})), adapter.action_space
        groups.append(Group(tuple(members), columns, adapter, fields, *spaces, served.action))
        first = columns.stop
    return groups
