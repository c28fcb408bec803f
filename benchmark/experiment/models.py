"""The models of experiment files; what each key means is the docstring below it, and goes into the schema."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from benchmark.experiment.algorithm_settings import settings_of
from benchmark.experiment.environment import Environment
from benchmark.experiment.values import (
    SEVERAL,
    Algorithms,
    FolderName,
    Gpus,
    Imports,
    Loggers,
    Metric,
    Metrics,
    Modes,
    Names,
    Pair,
    Policies,
    Positive,
    Scenarios,
    SearchSpace,
    Seeds,
    distinct,
    name_of,
)
from benchmark.experiment.version import versions
from smarts.config import Section, UnfitError

EMPTY_ROADS = "no_social_vehicles"
"""The traffic variation that every scenario of the suite has, with no vehicles but the agents'."""


class ScenarioShare(Section):
    """Scenarios in equal shares, with the weight of them all."""

    scenarios: Annotated[Scenarios, Field(min_length=1)]
    """Names, or patterns of names such as "maps/train-*" or "intersection@three_*"."""
    weight: Annotated[float, Field(gt=0)] = 1.0
    """Their share of the episodes, beside the weights of the list's other entries."""


class TestCondition(Section):
    """Scenarios of a test, in equal shares: a row for each policy in the report."""

    name: FolderName
    """Its name in the report."""
    scenarios: Annotated[Scenarios, Field(min_length=1)]
    """As in `train`."""
    traffic: str | None = None
    """Name of their traffic variation; null: that of the training."""
    seen: bool = False
    """Whether they may be of the training or the validation; the report marks the name by "(seen)"."""


def _shares(given: Any) -> Any:
    """Make entries of the names of scenarios."""
    if not isinstance(given, list):
        return given
    return [{"scenarios": [each]} if isinstance(each, str) else each for each in given]


def _named_entries(given: Any) -> Any:
    """Make tasks, or conditions of a test, of the names of scenarios."""
    if not isinstance(given, list):
        return given
    return [
        {"name": name_of([each]), "scenarios": [each]} if isinstance(each, str) else each for each in given
    ]


def _differently_named(entries: tuple[Any, ...]) -> tuple[Any, ...]:
    distinct(each.name for each in entries)
    return entries


Shares = Annotated[tuple[ScenarioShare, ...], Field(strict=False), BeforeValidator(_shares)]
Conditions = Annotated[
    tuple[TestCondition, ...],
    Field(strict=False),
    BeforeValidator(_named_entries),
    AfterValidator(_differently_named),
]


class TrainingTask(Section):
    """What a policy is trained and tested on: a scenario, or several of them."""

    name: FolderName
    """Name of its folder and of its column in the report."""
    scenarios: Scenarios = ()
    """Names of the suite or folders, each perhaps with "@variation", in equal shares."""
    train: Shares = ()
    """In place of `scenarios`: names, or {scenarios: [...], weight: 3}. Every episode draws one by weight."""
    validation: Shares = ()
    """What validations play, as `train`; by default what is trained on."""
    test: Conditions = ()
    """What tests play: names, or {name: ..., scenarios: [...], traffic: ...}, each of them
    `evaluation.episodes` episodes on maps that are in no training, unless it has `seen: true`; by default
    what is trained on."""
    train_traffic: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Traffic variations that each episode of a training draws one of; by default that of the run, on which
    validations and tests are."""
    start_from: Annotated[str, AfterValidator(os.path.abspath)] | None = None
    """Folder of a run whose last weights trainings begin with, as far as they fit."""

    @model_validator(mode="after")
    def _trains(self) -> Self:
        if bool(self.scenarios) == bool(self.train):
            raise UnfitError("a task needs scenarios or train, and not both", "give a list of scenarios")
        return self

    @property
    def trained_on(self) -> dict[str, float]:
        """Scenarios of the training, and the weight of each."""
        return _weights(self.train) or dict.fromkeys(self.scenarios, 1.0)

    @property
    def validated_on(self) -> dict[str, float]:
        """Scenarios of validations, and the weight of each."""
        return _weights(self.validation) or self.trained_on

    @property
    def lists(self) -> dict[str, Any]:
        """What it plays, as a version of the benchmark freezes it."""
        return self.model_dump(mode="json", exclude={"name", "start_from"})

    @property
    def tested_on(self) -> list[str]:
        """Scenarios of tests, each once."""
        return [*dict.fromkeys(name for each in self.test for name in each.scenarios)] or [*self.trained_on]

    @property
    def names(self) -> list[str]:
        """All scenarios of the task, each once."""
        return [*dict.fromkeys([*self.trained_on, *self.validated_on, *self.tested_on])]


def _weights(shares: Sequence[ScenarioShare]) -> dict[str, float]:
    """Return scenarios and the weight of each; one that is in several entries has the sum."""
    found: dict[str, float] = {}
    for each in shares:
        for name in each.scenarios:
            found[name] = found.get(name, 0.0) + each.weight / len(each.scenarios)
    return found


def _known_version(version: int) -> int:
    if version not in versions():
        raise ValueError(f"there is no version {version}; there is {', '.join(map(str, versions()))}")
    return version


Tasks = Annotated[
    tuple[TrainingTask, ...], SEVERAL, BeforeValidator(_named_entries), AfterValidator(_differently_named)
]


class Budget(Section):
    """How long each run trains: until the first is used up; null takes an inherited one out."""

    agent_steps: Annotated[int, Field(ge=1, le=10**12)] | None = 2_000_000
    """Simulation steps of 0.1 s, counted once for each agent that is on the road."""
    minutes: Annotated[float, Field(gt=0, le=10**7)] | None = None
    """Wall-clock time of training, validations not counted. It makes results depend on the machine."""

    @property
    def most_steps(self) -> float:
        """Agent-steps, infinity without a limit."""
        return math.inf if self.agent_steps is None else self.agent_steps


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
    """Runs side by side; by default as many as Ray has CPUs and GPUs for."""
    env_runners: Annotated[int, Field(ge=0)] = 0
    """Processes that simulate for one run; 0: the run's own."""
    num_envs_per_env_runner: Positive = 8
    """Simulations in each of these processes."""
    learners: Annotated[int, Field(ge=0)] = 0
    """Processes that learn for one run, each from its rows of every minibatch; 0: the run's own."""
    learner_gpus: Gpus = 0
    """GPUs for each learner of one run."""
    address: str | None = None
    """HOST:PORT of the Ray cluster to join ("auto" finds it); without it Ray is started on this machine.
    A cluster's machines need third-party packages only: code goes there, results come from there."""

    @property
    def processes(self) -> int:
        """Processes of one run, each with a CPU: its own, env runners and learners."""
        return 1 + self.env_runners + self.learners

    @property
    def bundles(self) -> list[dict[str, float]]:
        """What Ray sets aside for each process of one run: its own, env runners, learners, in this order."""
        learner = {"CPU": 1.0} | ({"GPU": self.learner_gpus} if self.learner_gpus else {})
        own = {"CPU": 1.0} if self.learners else learner
        return [own, *[{"CPU": 1.0}] * self.env_runners, *[learner] * self.learners]


class Tune(Section):
    """A search for settings: `smarts-bench sweep`."""

    parameters: dict[str, SearchSpace]
    """Setting -> list of values (a grid), or what is drawn from: {uniform: [low, high]}, {loguniform: [...]},
    {randint: [...]}, {choice: [value, ...]}."""
    samples: Positive = 1
    """Draws from the space, or repetitions of a grid."""
    scheduler: Literal["none", "asha", "pbt"] = "none"
    """What stops or changes runs early: nothing, asynchronous halving (ASHA), population-based training."""
    metric: Literal["completion", "return", "safety"] = "completion"
    """What is to be large in validation; "safety" is 1 - collisions."""


class Contrasts(Section):
    """Comparisons that are fixed before training: their p-values are corrected for their number alone."""

    pairs: Annotated[tuple[Pair, ...], Field(strict=False, min_length=1)]
    """[first, second]: two algorithms, of which the second is subtracted."""
    metric: Metric = "completion_rate"
    """What is compared: of each training seed, its mean over the conditions."""
    conditions: Names
    """Names of conditions of tests."""


class TaskOverrides(Section):
    """What differs in the trainings of a task, or of a task with one traffic; the rest is as elsewhere."""

    budget: Budget = Budget()
    training: dict[str, Any] = Field(default_factory=dict)
    settings: dict[str, dict[str, Any] | None] = Field(default_factory=dict)


class Experiment(Section):
    """An experiment: every algorithm x task x traffic x seed is a run of its own."""

    name: FolderName = ""
    """Name of the results folder; by default the file's."""
    description: str = ""
    """A line for the report."""
    benchmark_version: Annotated[int, AfterValidator(_known_version)] | None = None
    """Version of the benchmark that the results are of: runs are refused where scenarios, observation,
    reward, metrics or environment settings differ from what it froze, or with changes that are not
    committed. null: of no version."""
    imports: Imports = ()
    """Python files and folders in which module:Class below is found: x.py is module x, a folder x is package
    x. Relative to this file, or else to the working directory."""
    algorithms: Algorithms = ()
    """Names, as `smarts-bench algorithms` lists them, or module:Class of an own algorithm's config."""
    tasks: Tasks = ()
    """What is driven: a scenario's name, or {name: ..., scenarios: [...]} for one policy on several, or with
    lists of their own for training, validation and test."""
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
    log: Loggers = ("tensorboard",)
    """What shows the lines of progress.csv as they come: tensorboard, wandb, mlflow, or module:Class."""
    resources: Resources = Resources()
    tune: Tune | None = None
    contrasts: Contrasts | None = None
    """What the report compares by training seeds, whatever else it shows."""
    by_task: dict[str, TaskOverrides] = Field(default_factory=dict)
    """TASK or TASK/TRAFFIC -> what differs in the trainings there. TASK/TRAFFIC overrides TASK, and values of
    one algorithm override those of all, wherever they stand."""

    if TYPE_CHECKING:

        def __init__(self, **values: Any) -> None:
            """Take values as a file has them: lists, names and dicts; each is checked when it is given."""

    def settings_of(self, algorithm: str, task: str = "", traffic: str = "") -> dict[str, Any]:
        """Return the settings of an algorithm that the file gives in a task, by default in any.

        Raises:
            OwnCodeError: A `module:Class` cannot be imported.
        """
        settings = settings_of(algorithm)
        training: dict[str, Any] = self.training
        own: dict[str, Any] = self.settings.get(algorithm) or {}
        for given in self._overrides_of(task, traffic):
            training, own = training | given.training, own | (given.settings.get(algorithm) or {})
        common = {name: training[name] for name in training.keys() & settings.model_fields}
        return settings.model_validate(common | own).model_dump(mode="json", exclude_unset=True)

    def budget_of(self, task: str, traffic: str) -> Budget:
        """Return the budget of each training in a task."""
        budget = self.budget
        for given in self._overrides_of(task, traffic):
            set_here = {name: getattr(given.budget, name) for name in given.budget.model_fields_set}
            budget = budget.model_copy(update=set_here)
        return budget

    def _overrides_of(self, task: str, traffic: str) -> list[TaskOverrides]:
        """Return what differs in a task, the more general first."""
        return [self.by_task[name] for name in (task, f"{task}/{traffic}") if name in self.by_task]
