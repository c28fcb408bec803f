"""How agents see, act and drive: `environment` of experiment files."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

from pydantic import (
    Discriminator,
    Field,
    SerializerFunctionWrapHandler,
    Tag,
    model_serializer,
    model_validator,
)

from benchmark.experiment.values import SEVERAL, ActionName, Engine, FolderName, VehicleName, Wheels
from smarts.config import Section, UnfitError
from smarts.errors import SmartsError
from smarts.types.agent_states import agent_names
from smarts.types.traffic import DEFAULT_ENGINE


class Driving(Section):
    """How an agent acts, and what it drives."""

    action: ActionName = "Lane"
    """How agents act: a name of ActionSpaceType. Lane is discrete, all others are continuous."""
    vehicle: VehicleName = "generic_sedan"
    """What agents drive; the first three are the same car."""
    vehicle_model: Literal["bullet", "dynamic", "kinematic"] = "bullet"
    """How it moves: as a rigid body on tyres, or as a cheaper single-track model."""
    tyre_model: Literal["pacejka", "linear"] = "pacejka"
    """Model of its tyres."""
    flat_tyres: Wheels = ()
    """Tyres that are flat: 0 front left, 1 front right, 2 rear left, 3 rear right."""


class AgentChanges(Driving):
    """What differs for an agent from the environment's own keys."""

    @model_serializer(mode="wrap")
    def _given(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {name: value for name, value in serialize(self).items() if name in self.model_fields_set}


MOST_AGENTS = 64


NamedAgents = Annotated[dict[FolderName, AgentChanges], Field(min_length=1, max_length=MOST_AGENTS)]


class SocialAgents(Section):
    """Agents of the zoo beside the learning ones: they take the missions that these leave."""

    agent: str
    """A locator, as `smarts-bench zoo list` shows them: module:name-v0."""
    count: Annotated[int, Field(ge=1, le=MOST_AGENTS)] | Literal["missions"] = 1
    """How many; missions: as many as there are missions left."""
    options: dict[str, Any] = Field(default_factory=dict)
    """Arguments of the agent's policy, as `smarts-bench zoo describe` shows them."""


Where = Literal["in_process", "process", "ray"]


class Host(Section):
    """Where an agent of the zoo acts, and in what time."""

    where: Where = "in_process"
    """in_process, process (on the same machine) or ray (an actor)."""
    patience: Annotated[float, Field(gt=0, le=3600)] = 10.0
    """How long an answer is waited for before the agent's process is started again [s]."""
    deadline_ms: Annotated[float, Field(gt=0)] | None = None
    """Time after which answers are dropped [ms]; null: each is waited for."""
    delay_steps: Annotated[int, Field(ge=0, le=100)] = 0
    """Steps from an answer to when it is carried out."""
    memory: Annotated[float, Field(gt=0)] = 8.0
    """Memory limit of a process [GB]."""

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        from smarts.agents.hosting.options import HostOptions  # here: reports need no agents

        try:
            HostOptions(**dict(self))
        except SmartsError as error:
            raise UnfitError(error.problem, error.remedy) from error
        return self


class Environment(Driving):
    """How agents see, act and drive, and what their reward is; the same for all algorithms."""

    agents: Annotated[
        Annotated[Annotated[int, Field(ge=1, le=MOST_AGENTS)], Tag("number")]
        | Annotated[NamedAgents, Tag("by name")],
        Discriminator(lambda given: "by name" if isinstance(given, dict) else "number"),
    ] = 4
    """Learning agents in each simulation: how many, or what differs for each by its name, such as
    `{car: {}, truck: {vehicle: truck}}`."""
    decision_interval: Annotated[int, Field(ge=1, le=50)] = 5
    """Simulation steps of 0.1 s from one decision to the next."""
    observation: str | list[Any] | dict[str, Any] = "benchmark"
    """What agents observe: a name of smarts/observations/observations.yaml, or a list or dict of features."""
    reward: str | dict[str, Any] | None = None
    """A name of smarts/rewards/rewards.yaml, weights such as `{goal: 1, collision: -1}`, or module:Class, a
    class or function of one's own; null: the reward that goes with the observation."""
    adapter: str | None = None
    """module:Class of one's own that makes observations, rewards and perhaps the encoding of actions."""
    adapter_options: dict[str, Any] = Field(default_factory=dict)
    """Keywords of the own adapter."""
    friction: Annotated[float, Field(ge=0.05, le=2.0)] | None = None
    """Friction of the road under agents' vehicles where the scenario sets no friction patch: ice has about
    0.1, a wet road 0.5; null: dry asphalt, 0.9."""
    action_latency: Annotated[float, Field(ge=0.0, le=10.0, multiple_of=0.1)] = 0.0
    """Time from an action of a learning agent to when its vehicle carries it out [s], a multiple of 0.1."""
    traffic_engine: Engine | None = None
    """What drives the traffic: SUMO, Native, or module:Class of one's own; null: what the scenario
    names."""
    traffic_step: Annotated[float, Field(ge=0.1, le=1.0, multiple_of=0.1)] | None = None
    """Length of SUMO's step in training [s], a multiple of 0.1; null: 0.1. 0.5 makes training about twice as
    fast. Validation and tests always run at 0.1 s."""
    training_traffic: Literal["native"] | None = None
    """native: agents learn in traffic of the engine Native, several times as fast as SUMO, in kinematic
    vehicles where `vehicle_model` is bullet. Validation and tests run on what the other keys say."""
    social_agents: Annotated[tuple[SocialAgents, ...], Field(strict=False)] = ()
    """Agents of the zoo beside the learning ones, in training and test, such as
    `[{agent: "smarts.zoo:idm-v0", count: 2}]`. They are not measured."""
    hosts: dict[
        str,
        Annotated[
            Annotated[Where, Tag("where")] | Annotated[Host, Tag("fields")],
            Discriminator(lambda given: "fields" if isinstance(given, dict | Host) else "where"),
        ],
    ] = Field(default_factory=dict)
    """Where agents of the zoo act, and in what time, by locator ("*": all others), such as
    `{idm-v0: process, mobil-v0: {delay_steps: 3}}`; docs/guide/hosts.md."""
    learn_in_bubbles: bool | Annotated[tuple[str, ...], SEVERAL] = False
    """true, or a list of ids of the scenarios' bubbles: the learning agents have no missions, but drive
    vehicles of traffic in these bubbles, `agents` of them at a time."""
    episode_time: Annotated[float, Field(ge=0.1, le=86_400)] | None = None
    """Length of the episodes in which agents learn in bubbles [s]."""
    time_limit: Annotated[float, Field(ge=0.1, le=86_400)] | None = None
    """Time after which an agent's episode ends [s]; null: 100 s."""

    @model_serializer(mode="wrap")
    def _without_defaults(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        # A run without these is the same run as before there were any.
        kept = serialize(self)
        for name in (
            "action_latency",
            "traffic_step",
            "training_traffic",
            "social_agents",
            "learn_in_bubbles",
            "episode_time",
            "time_limit",
        ):
            if getattr(self, name) == type(self).model_fields[name].default:
                kept.pop(name, None)
        if not self.hosts:
            kept.pop("hosts", None)
        return kept

    def content(self) -> dict[str, Any]:
        """Return what determines a run: where an agent acts changes nothing, in what time it acts does.

        Patience is of the time: an agent that is silent for longer fails, and the run is another one.
        """
        kept = self.model_dump(mode="json")
        timing = {locator: given for locator, host in self.hosts.items() if (given := _timing(host))}
        kept.pop("hosts", None)
        return {**kept, "hosts": timing} if timing else kept

    @property
    def agent_count(self) -> int:
        """How many learning agents a simulation has."""
        return self.agents if isinstance(self.agents, int) else len(self.agents)

    @property
    def mission_count(self) -> int:
        """How many missions the learning agents have."""
        return 0 if self.learn_in_bubbles else self.agent_count

    def driving(self) -> dict[str, Driving]:
        """Return how each agent acts and drives, by its name."""
        if isinstance(self.agents, int):
            return dict.fromkeys(agent_names(self.agents), self)
        return {name: self.model_copy(update=agent.model_dump()) for name, agent in self.agents.items()}


def engine_mark(traffic_engine: str | None) -> str:
    """Return what is said beside figures of tests on another engine than SUMO; "" where there is none.

    Args:
        traffic_engine: The environment's.
    """
    is_default = traffic_engine in (None, DEFAULT_ENGINE)
    return "" if is_default else f"tested on the traffic engine {traffic_engine}"


def _timing(host: str | Host) -> dict[str, Any]:
    """Return the settings of a host that change its agents' actions."""
    if isinstance(host, str):
        return {}
    names = ("deadline_ms", "delay_steps")
    found = {name: getattr(host, name) for name in names if getattr(host, name)}
    if host.patience != Host.model_fields["patience"].default:
        found["patience"] = host.patience
    # No deadline holds in the simulator's process; which process it is changes nothing.
    needs_process = host.deadline_ms is not None and host.where != "in_process"
    return {"where": "process", **found} if needs_process else found
