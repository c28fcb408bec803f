"""The models of experiment files; what each key means is the docstring below it, and goes into the schema."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    SerializerFunctionWrapHandler,
    Tag,
    model_serializer,
)
from pydantic_core import PydanticSerializationError

from algorithms.registry import ALGORITHMS
from benchmark.experiment.algorithm_settings import settings_of
from benchmark.experiment.checks import MOST_AGENTS, check_experiment
from benchmark.scripted import SCRIPTED_POLICIES
from smarts.config import ConfigError, Fault, Problem, Section, UnfitError, read_config, shown
from smarts.errors import nearest_names
from smarts.registry import is_own_name
from smarts.sstudio.locating import resolved, suite
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import agent_names
from smarts.types.traffic import TRAFFIC_ENGINES

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
ADDRESS = re.compile(r"(?:[A-Za-z0-9._-]+|\[[0-9A-Fa-f:.]+\]):(\d{1,5})")
EMPTY_ROADS = "no_social_vehicles"
"""The traffic variation that every scenario of the suite has, with no vehicles but the agents'."""

ACTION_NAMES = tuple(kind.name for kind in ActionSpaceType if kind != ActionSpaceType.Empty)

Positive = Annotated[int, Field(ge=1)]
# Sequences are written as lists, and kept as tuples, since nothing of a config changes.
SEVERAL = Field(min_length=1, strict=False)


def _name(text: str) -> str:
    if not NAME.fullmatch(text):
        raise UnfitError(f"{text!r} cannot name a folder", "use letters, digits, '.', '_' and '-'")
    return text


def _named(kind: str, known: Iterable[str]) -> Callable[[str], str]:
    """Return a check that a name is a registered one, or a `module:Class`, which later checks resolve."""

    def check(name: str) -> str:
        if name not in [*known] and not is_own_name(name):
            raise UnfitError(f"there is no {kind} {name!r}", nearest_names(name, known))
        return name

    return check


def _action(name: str) -> str:
    if name not in ACTION_NAMES:
        raise UnfitError(f"there is no action {name!r}", nearest_names(name, ACTION_NAMES))
    return name


def _metric(name: str) -> str:
    from benchmark.metrics.registry import METRICS  # here: loads pandas, and most files choose none

    return _named("metric", METRICS)(name)


def _scenario(name: str) -> str:
    folder = name.partition("@")[0]
    if not folder or (folder not in suite() and not Path(folder).exists()):
        raise UnfitError(
            f"there is no scenario {name!r}, neither in the suite nor as a folder here",
            nearest_names(folder, suite()),
        )
    return resolved(name)


def _address(text: str) -> str:
    found = ADDRESS.fullmatch(text)
    if text != "auto" and not (found and 0 < int(found[1]) < 2**16):
        raise UnfitError(
            f"{text!r} is not where a Ray cluster can be", "write auto, or HOST:PORT of its head"
        )
    return text


def _gpus(count: float) -> float:
    if count > 1 and count % 1:
        raise UnfitError(
            f"{count:g} is more than one GPU, but no whole number", "share one, or take whole ones"
        )
    return count


def _distinct(values: Iterable[Any]) -> Any:
    values = tuple(values)
    twice = sorted({str(value) for value in values if values.count(value) > 1})
    if twice:
        raise UnfitError(f"{', '.join(twice)} is there twice", "name each once")
    return values


def _sorted(values: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(sorted(values))


FolderName = Annotated[str, AfterValidator(_name)]
Algorithm = Annotated[str, AfterValidator(_named("algorithm", ALGORITHMS))]
Policy = Annotated[str, AfterValidator(_named("scripted policy", SCRIPTED_POLICIES))]
Metric = Annotated[str, AfterValidator(_metric)]
Scenario = Annotated[str, AfterValidator(_scenario)]
Engine = Annotated[str, AfterValidator(_named("traffic engine", TRAFFIC_ENGINES))]


class TrainingTask(Section):
    """What a policy is trained and tested on: a scenario, or several of them in turns."""

    name: FolderName
    """Of its folder and of its column in the report."""
    scenarios: Annotated[tuple[Scenario, ...], SEVERAL]
    """Names of the suite or folders, each perhaps with "@variation"."""


def name_of(scenarios: Iterable[str]) -> str:
    """Return the name of a task that has none of its own."""
    paths = [Path(each) for each in scenarios]
    return "-".join((path.name or path.resolve().name).replace("@", "-") for path in paths)


def _tasks(given: Any) -> Any:
    """Make tasks of the names of scenarios."""
    if not isinstance(given, list):
        return given
    return [
        {"name": name_of([each]), "scenarios": [each]} if isinstance(each, str) else each for each in given
    ]


def _differently_named(tasks: tuple[TrainingTask, ...]) -> tuple[TrainingTask, ...]:
    _distinct(task.name for task in tasks)
    return tasks


DISTINCT = AfterValidator(_distinct)
Names = Annotated[tuple[str, ...], SEVERAL, DISTINCT]
# In one order, whatever the file's: greedy first.
Modes = Annotated[tuple[Literal["greedy", "sampled"], ...], SEVERAL, DISTINCT, AfterValidator(_sorted)]
Seeds = Annotated[tuple[Annotated[int, Field(ge=0, lt=2**31)], ...], SEVERAL, DISTINCT]
Algorithms = Annotated[tuple[Algorithm, ...], SEVERAL, DISTINCT]
Policies = Annotated[tuple[Policy, ...], Field(strict=False), DISTINCT]
Metrics = Annotated[tuple[Metric, ...], SEVERAL, DISTINCT]
Imports = Annotated[tuple[str, ...], Field(strict=False), DISTINCT]
Wheels = Annotated[tuple[Annotated[int, Field(ge=0, le=3)], ...], Field(strict=False), DISTINCT]
VehicleName = Literal["generic_sedan", "sedan", "passenger", "bus", "coach", "truck", "motorcycle"]
# All but Empty, by which agents do nothing.
ActionName = Annotated[str, AfterValidator(_action)]
Tasks = Annotated[
    tuple[TrainingTask, ...], SEVERAL, BeforeValidator(_tasks), AfterValidator(_differently_named)
]


class Driving(Section):
    """How an agent acts, and what it drives."""

    action: ActionName = "Lane"
    """How agents act: a name of ActionSpaceType. Lane is discrete, all others are continuous."""
    vehicle: VehicleName = "generic_sedan"
    """What agents drive; the first three are the same car."""
    vehicle_model: Literal["bullet", "dynamic", "kinematic"] = "bullet"
    """How it moves: as a rigid body on tyres, or as a cheaper single-track model."""
    tyre_model: Literal["pacejka", "linear"] = "pacejka"
    """What its tyres are like."""
    flat_tyres: Wheels = ()
    """Which are flat: 0 front left, 1 front right, 2 rear left, 3 rear right."""


class AgentChanges(Driving):
    """What differs for an agent from the environment's own keys."""

    @model_serializer(mode="wrap")
    def _given(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        return {name: value for name, value in serialize(self).items() if name in self.model_fields_set}


def _agents(agents: Any) -> Any:
    """Raise if agents by name are none or too many, or a name is not one."""
    if not isinstance(agents, dict):
        return agents
    if not 1 <= len(agents) <= MOST_AGENTS:
        raise UnfitError(f"there are {len(agents)} agents", f"give 1 to {MOST_AGENTS}")
    for name in agents:
        if not NAME.fullmatch(name) or "__" in name:
            raise UnfitError(
                f"{name!r} cannot name an agent", "use letters, digits, '.', '_' and '-', and no '__'"
            )
    return agents


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
    """Later answers are dropped [ms]; null: each is waited for."""
    delay_steps: Annotated[int, Field(ge=0, le=100)] = 0
    """Steps from an answer to when it is carried out."""
    memory: Annotated[float, Field(gt=0)] = 8.0
    """Of a process [GB]."""
    log: str = ""
    """Folder to which decisions are written, late ones too; "": none."""
    replay: str = ""
    """Folder of such a log, in place of the agent; "": none."""


class Environment(Driving):
    """How agents see, act and drive, and what their reward is; the same for all algorithms."""

    agents: Annotated[
        Annotated[Annotated[int, Field(ge=1, le=MOST_AGENTS)], Tag("number")]
        | Annotated[dict[str, AgentChanges], Tag("by name")],
        Discriminator(lambda given: "by name" if isinstance(given, dict) else "number"),
        AfterValidator(_agents),
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
    """Of the road under agents' vehicles, where the scenario sets no friction patch: ice has about 0.1, a
    wet road 0.5; null: dry asphalt, 0.9."""
    traffic_engine: Engine | None = None
    """What drives the traffic: SUMO, ConstantSpeed, or module:Class of one's own; null: what the scenario
    names."""
    traffic_step: Annotated[float, Field(ge=0.1, le=1.0, multiple_of=0.1)] | None = None
    """Length of SUMO's step in training [s], a multiple of 0.1; null: 0.1. 0.5 makes training about twice as
    fast. Validation and tests always run at 0.1 s."""
    social_agents: Annotated[tuple[SocialAgents, ...], Field(strict=False)] = ()
    """Agents of the zoo beside the learning ones, in training and test, such as
    `[{agent: "smarts.zoo:idm-v0", count: 2}]`. They are not measured."""
    hosts: dict[str, Where | Host] = Field(default_factory=dict)
    """Where agents of the zoo act, and in what time, by locator ("*": all others), such as
    `{idm-v0: process, mobil-v0: {delay_steps: 3}}`; docs/hosts.md."""
    learn_in_bubbles: bool | Annotated[tuple[str, ...], SEVERAL] = False
    """true, or a list of ids of the scenarios' bubbles: the learning agents have no missions, but drive
    vehicles of traffic in these bubbles, `agents` of them at a time."""
    episode_time: Annotated[float, Field(gt=0, le=86_400)] | None = None
    """Length of the episodes in which agents learn in bubbles [s]."""

    @model_serializer(mode="wrap")
    def _without_defaults(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any]:
        # A run without these is the same run as before there were any.
        kept = serialize(self)
        for name in ("traffic_step", "social_agents", "learn_in_bubbles", "episode_time"):
            if getattr(self, name) == type(self).model_fields[name].default:
                kept.pop(name, None)
        if not self.hosts:
            kept.pop("hosts", None)
        return kept

    def content(self) -> dict[str, Any]:
        """Return what determines a run: where an agent acts changes nothing, in what time it acts does."""
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


def _timing(host: str | Host) -> dict[str, Any]:
    """Return the settings of a host that change its agents' actions."""
    if isinstance(host, str):
        return {}
    names = ("deadline_ms", "delay_steps", "replay")
    return {name: getattr(host, name) for name in names if getattr(host, name)}


class Budget(Section):
    """How long each run trains: until the first is used up; `minutes: null` takes inherited ones out."""

    agent_steps: Positive = 2_000_000
    """Simulation steps of 0.1 s, counted once for each agent that is on the road."""
    minutes: Annotated[float, Field(gt=0)] | None = None
    """Wall-clock time of training, validations not counted. It makes results depend on the machine."""


class Evaluation(Section):
    """How trained policies are tested."""

    episodes: Positive = 200
    """Test episodes per run and mode."""
    modes: Modes = ("greedy", "sampled")
    """Action selection: greedy or sampled. Tables show greedy if both are given."""
    held_out_episodes: Annotated[int, Field(ge=0)] = 0
    """Episodes, of greedy acting where both modes are given, on each held-out variation of the scenarios
    that differs from the training (many differ in traffic alone); 0: generalization is not measured."""
    validations: Annotated[int, Field(ge=0)] = 10
    """Number of validations during training, for the best checkpoint and the learning curve."""
    validation_episodes: Positive = 20
    """Episodes per validation, disjoint from test episodes."""
    keep_episodes: bool = False
    """Whether the recorded test episodes are kept (about 1 MB per 10 episodes); the measures always are."""


class Resources(Section):
    """What the runs may use."""

    parallel: Positive | None = None
    """Runs side by side; by default one for each CPU that Ray has, divided by what a run needs."""
    env_runners: Annotated[int, Field(ge=0)] = 0
    """Processes that simulate for one run; 0: the run's own."""
    num_envs_per_env_runner: Positive = 8
    """Simulations in each of these processes."""
    learner_gpus: Annotated[float, Field(ge=0, allow_inf_nan=False), AfterValidator(_gpus)] = 0
    """GPUs for the learner of one run."""
    address: Annotated[str, AfterValidator(_address)] | None = None
    """HOST:PORT of the Ray cluster to join ("auto" finds it); without it Ray is started on this machine.
    A cluster's machines must see the results' folder at the same path."""


class Tune(Section):
    """A search for settings: `smarts-bench sweep`."""

    parameters: Annotated[dict[str, Any], Field(min_length=1)]
    """Setting -> list of values, or {uniform: [low, high]}, {loguniform: [...]}, {randint: [...]}."""
    samples: Positive = 1
    """Draws from the space, or repetitions of a grid."""
    scheduler: Literal["none", "asha", "pbt"] = "none"
    """What stops or changes runs early: nothing, asynchronous halving (ASHA), population-based training."""
    metric: Literal["completion", "return", "safety"] = "completion"
    """What is to be large in validation; "safety" is 1 - collisions."""


class Experiment(Section):
    """An experiment: every algorithm x task x traffic x seed is a run of its own."""

    name: FolderName = ""
    """Name of the results folder; by default the file's."""
    description: str = ""
    """A line for the report."""
    imports: Imports = ()
    """Python files and folders in which module:Class below is found: x.py is module x, a folder x is package
    x. Relative to this file, or else to the working directory."""
    algorithms: Algorithms
    """Names, as `smarts-bench algorithms` lists them, or module:Class of an own algorithm's config."""
    tasks: Tasks
    """What is driven: a scenario's name, or {name: ..., scenarios: [...]} for one policy on several."""
    traffic: Names = (EMPTY_ROADS, "random_social_vehicles")
    """Names of the scenarios' traffic variations: each is trained and tested on by itself."""
    seeds: Seeds = (1, 2, 3)
    """Training seeds; all are tested on the same episodes."""
    training: dict[str, Any] = Field(default_factory=dict)
    """Settings of all algorithms that have them, such as `sharing` and `gamma`."""
    settings: dict[str, dict[str, Any] | None] = Field(default_factory=dict)
    """Settings of single algorithms; they override those of all."""
    environment: Environment = Environment()
    budget: Budget = Budget()
    evaluation: Evaluation = Evaluation()
    metrics: Metrics | None = None
    """What is measured and reported: names, or module:NAME of a Measure of one's own; null: all that are
    registered. Collision and completion rate always are."""
    scripted: Policies = ()
    """Scripted policies that are tested in the same way and shown below the table: names, or module:Class."""
    resources: Resources = Resources()
    tune: Tune | None = None

    if TYPE_CHECKING:

        def __init__(self, **values: Any) -> None:
            """Take values as a file has them: lists, names and dicts; each is checked when it is given."""

    def settings_of(self, algorithm: str) -> dict[str, Any]:
        """Return the settings of an algorithm that the file gives.

        Raises:
            OwnCodeError: A `module:Class` cannot be imported.
        """
        settings = settings_of(algorithm)
        common = {name: self.training[name] for name in self.training.keys() & settings.model_fields}
        chosen = settings.model_validate(common | (self.settings.get(algorithm) or {}))
        return chosen.model_dump(mode="json", exclude_unset=True)


def read_experiment(
    file: Path, overrides: Iterable[str] = (), imports: Iterable[str | Path] = ()
) -> Experiment:
    """Return an experiment file's content.

    Args:
        file: The file.
        overrides: Values that go before the file's, as in "budget.minutes=5".
        imports: Own Python files and folders, in addition to the file's.

    Raises:
        ConfigError: With all of its mistakes.
    """
    given = [str(Path(path).absolute()) for path in imports]

    def check(values: Mapping[str, Any]) -> Iterator[Fault]:
        if not values.get("name") and not NAME.fullmatch(file.stem):
            remedy = "give the experiment another one: name: ..."
            yield Fault((), f"the file's name {file.stem!r} cannot name a folder", remedy)
        yield from check_experiment(
            {**values, "imports": [*_found_beside(values.get("imports"), file), *given]}
        )

    experiment = read_config(file, Experiment, tuple(overrides), check)
    found = (*_found_beside(list(experiment.imports), file), *given)
    changes: dict[str, Any] = {} if experiment.name else {"name": file.stem}
    if found:
        changes["imports"] = tuple(dict.fromkeys(found))
    return experiment.model_copy(update=changes)


def check_whole(experiment: Experiment) -> Experiment:
    """Return an experiment made in Python, checked as a file would be, with absolute imports.

    Raises:
        ConfigError: With all of its mistakes.
    """
    imports = tuple(str(Path(path).absolute()) for path in experiment.imports)
    try:  # as a file has it, so that it is checked alike
        values = {**json.loads(experiment.model_dump_json(exclude_unset=True)), "imports": [*imports]}
    except PydanticSerializationError as error:
        remedy = "name own code as 'module:Class', and give plain numbers, texts, lists and dicts"
        raise ConfigError([Problem("", f"a value that no file can hold: {error}", remedy)]) from error
    faults = [*check_experiment(values)]
    if not experiment.name:
        faults.insert(0, Fault(("name",), "is missing", "give the experiment one: name=..."))
    if faults:
        problems = [Problem("", f"{shown(fault.key)}: {fault.text}", fault.remedy) for fault in faults]
        raise ConfigError(problems)
    return experiment.model_copy(update={"imports": imports} if imports else {})


def _found_beside(imports: Any, file: Path) -> list[str]:
    """Return the absolute paths of a file's imports, relative to its folder, or else to the working one."""
    paths = [Path(path) for path in imports if isinstance(path, str)] if isinstance(imports, list) else []
    beside = [file.absolute().parent / path for path in paths]
    return [
        os.path.normpath(there if there.exists() else path.absolute())
        for path, there in zip(paths, beside, strict=True)
    ]
