"""What every environment is made from, checked before anything is built."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from smarts.agents.benchmark import benchmark_interface
from smarts.agents.checks import check_instance, check_truth, check_whole
from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.agents.spec import AgentSpec
from smarts.env.adapters import ADAPTERS, ArrayAdapter
from smarts.errors import ScenarioError, nearest_names
from smarts.observations.context import AdapterContext
from smarts.observations.lists import feature_list
from smarts.sim.assembly import Assembly, Options, assemble
from smarts.sstudio.build import build_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.types.agent_states import agent_names
from smarts.types.streams import check_seed

LONGEST_DECISION = 100
"""The most steps of a decision."""
MOST_AGENTS = 1000
MOST_ENVS = 65_536
ALL = "__all__"
"""The key of the episode in done flags, so not a name of an agent."""

Agents = int | Mapping[str, AgentSpec | AgentInterface]
"""The learning agents: how many of the benchmark's, or a spec or interface for each name."""
Adapter = str | Callable[..., ArrayAdapter]
"""A name of `ADAPTERS`, or a class or function that is called with an `AdapterContext`, the agents'
interface, and the options by name."""


class SimulationOptions(TypedDict, total=False):
    """Keywords of every environment; `EnvSettings` says what they mean."""

    seed: int
    simulation: Options | None
    traffic: Sequence[str] | None


class EnvOptions(SimulationOptions, total=False):
    """Keywords of every environment with an array adapter; `EnvSettings` says what they mean."""

    decision_interval: int
    adapter: Adapter
    adapter_options: Mapping[str, Any] | None


@dataclass(frozen=True)
class EnvSettings:
    """What every environment is made from.

    Raises:
        SmartsError: A value cannot be had; names the value and what to give.
    """

    scenarios: Sequence[str | Path]
    """Folders, or names of the suite, each perhaps with "@variation"; they are played in a seeded order."""
    agents: Agents = 4
    num_envs: int = 1
    """How many simulations are stepped together."""
    seed: int = 42
    """Of the run, until `reset` gives another."""
    decision_interval: int = 5
    """Steps of 0.1 s from one decision to the next."""
    adapter: Adapter = "benchmark"
    """What agents observe, and their reward."""
    adapter_options: Mapping[str, Any] | None = None
    """Keywords of the adapter, such as `{"reward": "paper"}`."""
    simulation: Options | None = None
    traffic: Sequence[str] | None = None
    """Names of the variations of the scenarios' traffic that are played, by default all."""
    action_mask: bool = False
    """Whether observations by name hold the mask of lane actions too; it is in the infos anyway."""

    def __post_init__(self) -> None:
        check_scenarios(self.scenarios)
        check_traffic(self.traffic)
        check_agents(self.agents)
        check_whole("num_envs", self.num_envs, 1, MOST_ENVS)
        check_whole("decision_interval", self.decision_interval, 1, LONGEST_DECISION)
        check_seed(self.seed, "seed")
        check_truth("action_mask", self.action_mask)
        if self.simulation is not None:
            check_instance("simulation", self.simulation, Options, "smarts.sim.assembly.Options(...)")
        check_options(self.adapter_class, {} if self.adapter_options is None else self.adapter_options)

    @property
    def adapter_class(self) -> Callable[..., ArrayAdapter]:
        """The class or function that makes adapters."""
        return adapter_class(self.adapter)

    @property
    def observes_sensors(self) -> bool:
        """Whether the observation has sensors' fields, so that agents are grouped by their sensors."""
        features = feature_list((self.adapter_options or {}).get("observation", {}))
        return features.needs_equal_sensors or getattr(self.adapter_class, "needs_equal_sensors", False)

    def make_adapter(self, context: AdapterContext, interface: AgentInterface) -> ArrayAdapter:
        """Return a new adapter of some agents."""
        return self.adapter_class(context, interface, **(self.adapter_options or {}))

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

    def specs(self) -> dict[str, AgentSpec]:
        """Return the agents' specs by name; of an interface alone, a spec without adapters."""
        given = self.agents if isinstance(self.agents, Mapping) else self.interfaces()
        return {
            name: one if isinstance(one, AgentSpec) else AgentSpec(interface=one)
            for name, one in given.items()
        }

    def assemble(
        self, interfaces: Mapping[str, AgentInterface], sensors: Collection[str] | None = None
    ) -> Assembly:
        """Return the simulations, with the egos in the order of their interfaces.

        Args:
            interfaces: Of the egos.
            sensors: Names of those that are observed (None: all) for agents without adapters of their own.

        Raises:
            SmartsError: A scenario cannot be built or played.
        """
        if not interfaces:
            raise InterfaceError("there are no agents", remedy="name at least one")
        specs = self.specs()
        observed = {
            agent_id: sensors
            for agent_id, name in enumerate(interfaces)
            if sensors is not None and not specs[name].own_adapters
        }
        return assemble(
            [self._build(scenario, len(interfaces)) for scenario in self.scenarios],
            list(interfaces.values()),
            agents=list(interfaces),
            looked_at=observed,
            worlds=self.num_envs,
            seed=self.seed,
            options=self.simulation,
        )

    def _build(self, scenario: str | Path, egos: int) -> BuiltScenario:
        built = build_scenario(scenario, egos=egos)
        return built if self.traffic is None else built.with_traffic(self.traffic)


def adapter_class(adapter: Adapter) -> Callable[..., ArrayAdapter]:
    """Return the class or function that an adapter's name stands for.

    Raises:
        UnknownNameError: The name is not registered.
        InterfaceError: The adapter is neither a name nor callable.
    """
    if isinstance(adapter, str):
        return ADAPTERS[adapter]
    if not callable(adapter):
        raise InterfaceError(
            f"{adapter!r} is not an adapter",
            place="adapter",
            remedy=f"give one of {', '.join(ADAPTERS)}, or a class as in smarts/env/adapters.py",
        )
    return adapter


def check_scenarios(scenarios: Any) -> None:
    """Raise unless `scenarios` is a list of names and folders.

    Raises:
        ScenarioError: It is a single name, no list, or holds something else.
    """
    if isinstance(scenarios, str | Path):
        remedy = f"give a list: scenarios=[{str(scenarios)!r}]"
        raise ScenarioError(f"scenarios is {scenarios!r}, not a list", place="scenarios", remedy=remedy)
    remedy = "give a list of folders and names, such as ['loop']"
    if not isinstance(scenarios, Sequence):
        raise ScenarioError(f"scenarios is {scenarios!r}, not a list", place="scenarios", remedy=remedy)
    for scenario in scenarios:
        if not isinstance(scenario, str | Path):
            raise ScenarioError(f"{scenario!r} is not a scenario", place="scenarios", remedy=remedy)


def check_traffic(traffic: Any) -> None:
    """Raise unless `traffic` is None or a list of names.

    Raises:
        ScenarioError: It is a single name, an empty list, or holds something else.
    """
    if traffic is None:
        return
    if isinstance(traffic, str):
        remedy = f"give a list: traffic=[{traffic!r}]"
    elif isinstance(traffic, Sequence) and traffic and all(isinstance(name, str) for name in traffic):
        return
    else:
        remedy = "give a list of the names of variations, or None for all"
    raise ScenarioError(f"traffic is {traffic!r}", place="traffic", remedy=remedy)


def check_agents(agents: Any) -> None:
    """Raise unless `agents` is a number of agents, or a mapping from allowed names; values are not checked.

    Raises:
        InterfaceError: It is neither.
    """
    if not isinstance(agents, Mapping):
        if isinstance(agents, bool) or not isinstance(agents, int | np.integer):
            remedy = "give how many, or a dict with the spec or interface of each by its name"
            raise InterfaceError(f"the agents are {agents!r}", place="agents", remedy=remedy)
        check_whole("agents", agents, 1, MOST_AGENTS)
        return
    for name in agents:
        if not isinstance(name, str) or not name or name == ALL:
            raise InterfaceError(
                f"an agent is called {name!r}",
                place="agents",
                remedy=f"give texts as names, not empty ones and not {ALL!r}, which stands for the episode",
            )


def check_options(make: Callable[..., Any], options: Any, place: str = "adapter_options") -> None:
    """Raise if `make` does not take the options by name.

    Raises:
        InterfaceError: There is no such option; the remedy names the nearest.
    """
    check_instance(place, options, Mapping, "a dict of options by their names, such as {'reward': 'paper'}")
    try:
        parameters = inspect.signature(make).parameters.values()
    except (TypeError, ValueError):
        raise InterfaceError(
            f"the adapter is {make!r}",
            place="adapter",
            remedy="give a name, or a class that is called with the agents, their interface and the options",
        ) from None
    if any(each.kind == each.VAR_KEYWORD for each in parameters):
        return
    by_name = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    # The first two are the agents and their interface.
    known = [each.name for each in [*parameters][2:] if each.kind in by_name]
    for name in options:
        if name not in known:
            raise InterfaceError(
                f"the adapter has no option {name!r}", place=place, remedy=nearest_names(str(name), known)
            )
