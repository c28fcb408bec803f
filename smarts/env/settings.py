"""What every environment is made from, checked before anything is built."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, TypedDict

from pydantic import Field, InstanceOf

from smarts.agents.benchmark import benchmark_interface
from smarts.agents.checks import Count, Listed, Number, WholeFrom0, checked
from smarts.agents.hosting.options import HostOptions, hosts_of
from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.agents.social import (
    NO_CAST,
    BubbleLearning,
    Cast,
    SocialAgents,
    bubble_learning,
    distinct,
    interface_of,
    social_agents,
)
from smarts.agents.spec import AgentSpec
from smarts.env.adapters import Adapter, ArrayAdapter, adapter_class
from smarts.errors import nearest_names
from smarts.observations.action_mask import MASK
from smarts.observations.context import AdapterContext
from smarts.observations.lists import Observed, feature_list
from smarts.rewards.own import Reward, check_reward
from smarts.sim.assembly import Assembly, Options, assemble
from smarts.sim.options import shown
from smarts.sstudio.build import build_scenario
from smarts.sstudio.built import BuiltScenario
from smarts.types.agent_states import agent_names

ALL = "__all__"
"""The key of the episode in done flags, so not a name of an agent."""

Agents = int | Mapping[str, AgentSpec | AgentInterface]
"""The learning agents: how many of the benchmark's, or a spec or interface for each name."""


class SimulationOptions(TypedDict, total=False):
    """Keywords of every environment; `EnvSettings` says what they mean."""

    seed: int
    simulation: Options | None
    traffic: Sequence[str] | None
    social_agents: Sequence[Any]
    hosts: Mapping[str, Any]
    learn_in_bubbles: bool | Sequence[str]
    episode_time: float | None
    envision: bool | str | None


class EnvOptions(SimulationOptions, total=False):
    """Keywords of every environment whose observations are arrays; `EnvSettings` says what they mean."""

    decision_interval: int
    observation: Observed
    reward: Reward | None
    discount: float | None
    adapter: Adapter | None
    adapter_options: Mapping[str, Any] | None
    action_mask: bool


NO_RENDERING = (
    "record episodes with simulation=Options(record=FOLDER), and draw them with smarts-bench render"
)


def check_keywords(environment: type, options: SimulationOptions, known: type = EnvOptions) -> None:
    """Raise an `InterfaceError` for the first of an environment's keywords that is not among the known."""
    names = {*inspect.signature(environment).parameters, *known.__annotations__} - {"options"}
    for name in options.keys() - names:
        raise InterfaceError(
            f"there is no keyword {name!r}",
            place=environment.__name__,
            remedy=NO_RENDERING if name == "render_mode" else nearest_names(name, names),
        )


@checked
class EnvSettings:
    """What every environment is made from.

    Raises:
        SmartsError: A field is unknown or missing, or is not what it can be.
    """

    scenarios: Annotated[Sequence[str | Path], Listed]
    """Folders, or names of the suite, each perhaps with "@variation"; they are played in a seeded order."""
    agents: Count | Annotated[Mapping[str, Any], Field(min_length=1)] = 4
    """How many of the benchmark's, or a spec or interface for each name."""
    num_envs: Count = 1
    """How many simulations are stepped together."""
    seed: WholeFrom0 = 42
    """Seed of the run, until `reset` gives another."""
    decision_interval: Count = 5
    """Steps of 0.1 s from one decision to the next."""
    observation: Any = "benchmark"
    """What agents observe: a name of `observations.yaml`, a list or dict of features, a `FeatureList`."""
    reward: Any = None
    """A name of `rewards.yaml`, a dict of weights, an own class or its "module:Class"; None: the reward that
    `observations.yaml` names beside the observation."""
    discount: Number | None = None
    """The learner's, which a reward shaped by a potential needs; None: that of the reward's weights."""
    adapter: Any = None
    """The caller's own class that makes observations, rewards and perhaps the encoding of actions."""
    adapter_options: Mapping[str, Any] | None = None
    """Keywords of the own adapter."""
    simulation: InstanceOf[Options] | None = None
    traffic: Annotated[Sequence[str], Listed, Field(min_length=1)] | None = None
    """Names of the variations of the scenarios' traffic that are played, by default all."""
    social_agents: Sequence[SocialAgents | Mapping[str, Any]] = ()
    """Agents of the zoo that take the missions that the learning agents leave: `SocialAgents`, or dicts of
    their fields, such as {"agent": "smarts.zoo:idm-v0", "count": 2, "options": {}}."""
    hosts: Mapping[str, HostOptions | str | Mapping[str, Any]] = field(default_factory=dict)
    """Options of where and in what time social agents act, by locator ("*": all others): "process", "ray",
    `HostOptions`, or a dict of its fields. By default in this process; docs/guide/hosts.md."""
    learn_in_bubbles: bool | Sequence[str] = False
    """True, or ids of bubbles of the scenarios: the agents have no missions, but drive vehicles of traffic
    in these bubbles. `agents` says how many at a time."""
    episode_time: Number | None = None
    """Length of episodes in which agents learn in bubbles [s]."""
    envision: bool | str | None = None
    """True shows the simulations in the browser of `smarts-bench view --live`, on this machine unless
    `simulation` or SMARTS_ENVISION names another; "host:port" in that one; False in none. None: as
    `simulation` says."""
    action_mask: bool = False
    """Whether observations hold the mask of lane actions too, whatever features they have:
    {"observation": ..., "action_mask": ...}. It is in the infos anyway if the feature `action_mask` is among
    these."""

    def __post_init__(self) -> None:
        if self.reward is not None:
            check_reward(self.reward)
        for name, spec in self.specs().items():
            if not isinstance(spec.interface, AgentInterface):
                raise InterfaceError(
                    f"the interface of agent {name!r} is {spec.interface!r}",
                    place="agents",
                    remedy="give an AgentInterface(...), or an AgentSpec(interface=AgentInterface(...))",
                )

    def refuse_bubbles(self) -> None:
        """Raise if agents are to learn in bubbles: they end and begin again within an episode.

        Raises:
            InterfaceError: They are.
        """
        if self.learn_in_bubbles:
            raise InterfaceError(
                f"learn_in_bubbles is {self.learn_in_bubbles!r}, and in this environment no agent begins "
                "again before the episode ends",
                place="learn_in_bubbles",
                remedy="use VectorHiWayEnv or HiWayEnv",
            )

    @property
    def adapter_class(self) -> Callable[..., ArrayAdapter]:
        """The class or function that makes adapters."""
        return adapter_class(self.adapter, self.adapter_options)

    def make_adapter(self, context: AdapterContext) -> ArrayAdapter:
        """Return a new adapter of some agents."""
        observation = self.observation
        if self.action_mask:
            features = feature_list(observation)
            names = [each.name for each in (*features.stacked, *features.features)]
            observation = features if MASK in names else features.plus(features=[MASK])
        given = observation, self.reward, self.discount
        return self.adapter_class(context, *given, **(self.adapter_options or {}))

    def interfaces(self) -> dict[str, AgentInterface]:
        """Return the agents' interfaces by name."""
        return {name: interface_of(spec) for name, spec in self.specs().items()}

    def specs(self) -> dict[str, AgentSpec]:
        """Return the agents' specs by name; of an interface alone, a spec without adapters."""
        agents = self.agents
        if not isinstance(agents, Mapping):
            agents = {name: benchmark_interface() for name in agent_names(agents)}
        return {
            name: given if isinstance(given, AgentSpec) else AgentSpec(interface=given)
            for name, given in agents.items()
        }

    def assemble(
        self, interfaces: Mapping[str, AgentInterface], sensors: Collection[str] | None = None
    ) -> Assembly:
        """Return the simulations, with the egos in the order of their interfaces.

        Args:
            interfaces: Interfaces of the egos.
            sensors: Names of the observed sensors (None: all) of agents without adapters in their spec.

        Raises:
            SmartsError: A scenario cannot be built or played.
        """
        specs = self.specs()
        observed = {
            agent_id: sensors
            for agent_id, name in enumerate(interfaces)
            if sensors is not None and not specs[name].own_adapters
        }
        learning = bubble_learning(self.learn_in_bubbles, self.episode_time)
        if learning and len(distinct(interfaces.values())) > 1:
            raise InterfaceError(
                "the agents that learn in bubbles have different interfaces",
                place="learn_in_bubbles",
                remedy="give all of them one interface: any of them drives any vehicle",
            )
        missions = 0 if learning else len(interfaces)
        scenarios = [self._build(scenario, missions) for scenario in self.scenarios]
        return assemble(
            scenarios,
            list(interfaces.values()),
            agents=list(interfaces),
            cast=self._cast(scenarios, learning),
            looked_at=observed,
            worlds=self.num_envs,
            seed=self.seed,
            options=shown(self.simulation, self.envision),
        )

    def _cast(self, scenarios: Sequence[BuiltScenario], learning: BubbleLearning | None) -> Cast:
        """Return the social policies of the run."""
        added, hosts = social_agents(self.social_agents), hosts_of(self.hosts)
        described = any(built.scenario.bubbles or built.scenario.social_agent_missions for built in scenarios)
        if not (described or added or learning or hosts):
            return NO_CAST
        # Only runs with social agents wait for the zoo.
        from smarts.env.casting import cast_of

        return cast_of(scenarios, added, learning, hosts)

    def _build(self, scenario: str | Path, egos: int) -> BuiltScenario:
        built = build_scenario(scenario, egos=egos)
        return built if self.traffic is None else built.with_traffic(self.traffic)
