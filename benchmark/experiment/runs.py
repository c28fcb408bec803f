"""Expands an experiment into runs, and says where each keeps its results."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

from benchmark.experiment.algorithm_settings import own_defaults, settings_of
from benchmark.experiment.environment import Environment
from benchmark.experiment.models import Budget, Evaluation, Experiment, Resources, TrainingTask
from benchmark.experiment.own_code import own_digests
from benchmark.experiment.values import name_of
from smarts.config import ConfigError, fitted
from smarts.errors import SmartsError
from smarts.registry import file_name
from smarts.sstudio.locating import resolved

SCRIPTED = "scripted"
"""Folder of scripted policies among results, and their mode in tables, shown beside each learned mode."""
SCRIPTED_SEED = -1
"""Training seed in the tables of policies that were not trained."""
VERSION = "benchmark_version"
"""Key of a run's content: version of the benchmark; absent for none."""
WEIGHTS, TRAIN_TRAFFIC, VALIDATION = "weights", "train_traffic", "validation"
"""Keys of a run's content: weight of each of its scenarios; traffic of the training; scenarios of validations
-> weight. Absent where the task gives no such list."""
TESTED, TEST = "tested", "test"
"""Key of run.json: content of its test; and in that, the conditions that the task gives its tests."""
START = "start_from"
"""Key of a run's content: folder of the run with whose weights it begins; absent for none."""
STARTED_FROM = "started_from"
"""Key of run.json: digest of the networks that the training began with."""
DATA, KL_TO = "data", "kl_to"
"""Settings that name a file of demonstrations, and a run. A training reads both again when it is resumed."""
INPUTS = "inputs"
"""Key of run.json: their digests by name; and a training's scratch folder with their files."""
DEMONSTRATIONS = "demonstrations"
"""Key of run.json: what the file of demonstrations says of itself, for a run that has learned from one."""
NOT_TAKEN = "weights_not_taken"
"""Key of run.json: the run's weights that those which it began with do not fit."""
OWN_CODE = "own_code"
"""Key of a run's content and of a test's: name -> digest of own code; see `own_digests`."""


def inputs_of(content: Mapping[str, Any]) -> dict[str, str]:
    """Return the places of what a training takes from elsewhere, by `START`, `DATA` and `KL_TO`."""
    settings = content.get("settings") or {}
    found = {START: content.get(START), DATA: settings.get(DATA), KL_TO: settings.get(KL_TO)}
    return {name: place for name, place in found.items() if place}


def with_inputs(content: Mapping[str, Any], found: Mapping[str, str]) -> dict[str, Any]:
    """Return a run's content with other values of what it takes from elsewhere, as `inputs_of` names it."""
    start = {START: found[START]} if START in found else {}
    settings = {name: value for name, value in found.items() if name != START}
    return {**content, **start, **({"settings": {**content["settings"], **settings}} if settings else {})}


def known_inputs(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the digests in run.json of what a training has taken from elsewhere."""
    start = {START: facts[STARTED_FROM]} if STARTED_FROM in facts else {}
    return {**start, **facts.get(INPUTS, {})}


@dataclass(frozen=True)
class TaskSetting:
    """A task with one traffic, and how it is simulated and tested: a column of the report."""

    task: TrainingTask
    traffic: str
    environment: Environment
    evaluation: Evaluation
    num_envs: int
    """Simulations side by side."""
    metrics: tuple[str, ...] | None = None
    """What tests measure; None: all that are registered."""
    imports: tuple[str, ...] = ()
    """Files and folders of own code, absolute; every process that simulates imports them."""
    benchmark_version: int | None = None
    """Version of the benchmark that its results are of; None: of none."""

    def __str__(self) -> str:
        return f"{self.task.name}, {self.traffic}"

    @property
    def folder(self) -> Path:
        """Folder of its results, within an algorithm's folder."""
        return Path(self.task.name, self.traffic)

    def test_content(self) -> dict[str, Any]:
        """Return what a test of the task setting consists of, as it is kept with its results."""
        evaluation = self.evaluation
        # `seen` only where it is set: results from before it stay comparable.
        test = [
            each.model_dump(mode="json", exclude=None if each.seen else {"seen"}) for each in self.task.test
        ]
        content: dict[str, Any] = {
            "episodes": evaluation.episodes,
            "modes": list(evaluation.modes),
            "held_out_episodes": evaluation.held_out_episodes,
            **({TEST: test} if test else {}),
        }
        if self.metrics is None:
            return content
        return {**content, "metrics": list(self.metrics), **_own_code(self.imports, self.metrics)}

    def content(self, *names: Any) -> dict[str, Any]:
        """Return the scenarios, the environment and the own code of a run, as they are kept with its results.

        Args:
            names: What else may name own code.
        """
        environment = self.environment.content()
        return {
            "scenarios": list(self.task.trained_on),
            **({WEIGHTS: list(self.task.trained_on.values())} if self.task.train else {}),
            **({TRAIN_TRAFFIC: list(self.task.train_traffic)} if self.task.train_traffic else {}),
            **({VALIDATION: self.task.validated_on} if self.task.validation else {}),
            "traffic": self.traffic,
            "environment": environment,
            **({"imports": list(self.imports)} if self.imports else {}),
            **({VERSION: self.benchmark_version} if self.benchmark_version else {}),
            **_own_code(self.imports, environment, *names),
        }


def _own_code(imports: tuple[str, ...], *names: Any) -> dict[str, Any]:
    found = own_digests(imports, *names)
    return {OWN_CODE: found} if found else {}


@dataclass(frozen=True)
class Run:
    """One training and its test. Plain data, since it travels to other processes."""

    algorithm: str
    task_setting: TaskSetting
    seed: int
    settings: Mapping[str, Any]
    """Settings of the algorithm, where they differ from its defaults."""
    budget: Budget
    resources: Resources

    def __str__(self) -> str:
        return f"{self.algorithm}, {self.task_setting}, seed {self.seed}"

    @property
    def folder(self) -> Path:
        """Folder of its results, within the experiment's folder."""
        return training_folder(self.algorithm, self.task_setting, self.seed)

    @property
    def label(self) -> str:
        """The algorithm's name in folders and tables; see `file_name`."""
        return file_name(self.algorithm)

    def content(self) -> dict[str, Any]:
        """Return all that its training depends on, as it is kept beside its results."""
        evaluation, start = self.task_setting.evaluation, self.task_setting.task.start_from
        return {
            "algorithm": self.algorithm,
            "seed": self.seed,
            "settings": dict(self.settings),
            "budget": self.budget.model_dump(mode="json"),
            "validations": evaluation.validations,
            "validation_episodes": evaluation.validation_episodes,
            "env_runners": self.resources.env_runners,
            "num_envs_per_env_runner": self.resources.num_envs_per_env_runner,
            **({START: start} if start else {}),
            **self.task_setting.content(self.algorithm, self.settings),
        }


def run_from(content: Mapping[str, Any], test: Sequence[Mapping[str, Any]] = ()) -> Run:
    """Return the run of a `Run.content()`, to be tested again, with default evaluation settings.

    Args:
        content: All that its training depends on.
        test: Conditions of its test, as `TaskSetting.test_content` has them.

    Raises:
        ValueError: It is not such a content.
    """
    try:
        evaluation = fitted({key: content[key] for key in ("validations", "validation_episodes")}, Evaluation)
        return Run(
            content["algorithm"],
            TaskSetting(
                _task_of(content, test),
                content["traffic"],
                fitted(content["environment"], Environment),
                evaluation,
                content["num_envs_per_env_runner"],
                imports=tuple(content.get("imports", ())),
                benchmark_version=content.get(VERSION),
            ),
            content["seed"],
            content["settings"],
            fitted(content["budget"], Budget),
            fitted({key: content[key] for key in ("env_runners", "num_envs_per_env_runner")}, Resources),
        )
    except (KeyError, TypeError, ValueError, ConfigError) as error:
        raise ValueError(f"not the content of a run: {error}") from error


def _task_of(content: Mapping[str, Any], test: Sequence[Mapping[str, Any]]) -> TrainingTask:
    """Return the task of a `Run.content()` with the conditions of its test."""
    scenarios = content["scenarios"]
    names = scenarios if len(scenarios) <= 4 else [*dict.fromkeys(x.partition("@")[0] for x in scenarios)]
    task: dict[str, Any] = {"name": name_of(names[:4]), START: content.get(START)}
    task |= {"train": _entries(zip(scenarios, content[WEIGHTS], strict=True))} if WEIGHTS in content else {}
    task |= {} if WEIGHTS in content else {"scenarios": [*scenarios]}
    task |= {TRAIN_TRAFFIC: content.get(TRAIN_TRAFFIC, []), TEST: [*test]}
    return fitted(task | {VALIDATION: _entries(content.get(VALIDATION, {}).items())}, TrainingTask)


def _entries(weights: Iterable[tuple[str, float]]) -> list[dict[str, Any]]:
    return [{"scenarios": [name], "weight": weight} for name, weight in weights]


@dataclass(frozen=True)
class ScriptedRun:
    """A scripted policy's test."""

    policy: str
    task_setting: TaskSetting

    def __str__(self) -> str:
        return f"{self.policy}, {self.task_setting}"

    @property
    def folder(self) -> Path:
        """Folder of its results, within the experiment's folder."""
        return Path(SCRIPTED, self.label, self.task_setting.folder)

    @property
    def label(self) -> str:
        """The policy's name in folders and tables; see `file_name`."""
        return file_name(self.policy)

    def content(self) -> dict[str, Any]:
        """Return everything that determines the test's results, except the number of episodes."""
        return {"policy": self.policy, **self.task_setting.content(self.policy)}


def with_defaults(content: Mapping[str, Any]) -> dict[str, Any]:
    """Fill keys that are missing in a `content()` of an older version with their defaults.

    Sections that do not fit their model stay as they are.
    """
    found = json.loads(json.dumps(content))  # tuples as the lists that files have
    with suppress(ConfigError, TypeError, KeyError):
        found["environment"] = fitted(found["environment"], Environment).content()
    with suppress(ConfigError, TypeError, KeyError):
        found["budget"] = fitted(found["budget"], Budget).model_dump(mode="json")
    if isinstance(names := found.get("scenarios"), list):
        # Earlier versions wrote paths as the user gave them.
        found["scenarios"] = [resolved(name) if os.sep in str(name) else name for name in names]
    return found


def changed_settings(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings in a `content()` of a run that are not the defaults of its algorithm."""
    given, default = content.get("settings") or {}, default_settings(content)
    return {name: value for name, value in given.items() if name not in default or default[name] != value}


def default_settings(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return an algorithm's defaults in experiments, by the `content()` of a run; empty if it is unknown."""
    try:
        found = settings_of(content["algorithm"])().model_dump(mode="json")
        return {**found, **own_defaults(found)}
    except (KeyError, SmartsError, ValueError):  # scripted, or own code that is not there
        return {}


def is_larger(budget: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether a budget is larger than another one, and in nothing smaller."""
    limits = [[each.get(name) or inf for name in Budget.model_fields] for each in (budget, other)]
    return limits[0] != limits[1] and all(one >= two for one, two in zip(*limits, strict=True))


def task_settings_of(experiment: Experiment) -> list[TaskSetting]:
    """Return the columns of an experiment's table."""
    return [
        TaskSetting(
            task,
            traffic,
            experiment.environment,
            experiment.evaluation,
            experiment.resources.num_envs_per_env_runner,
            experiment.metrics,
            experiment.imports,
            experiment.benchmark_version,
        )
        for traffic in experiment.traffic
        for task in experiment.tasks
    ]


def runs_of(experiment: Experiment) -> Iterator[Run]:
    """Yield the trainings of an experiment, the first seed of everything first: so a table fills early."""
    for algorithm, task_setting, seed in trainings_of(experiment):
        place = task_setting.task.name, task_setting.traffic
        settings, budget = experiment.settings_of(algorithm, *place), experiment.budget_of(*place)
        yield Run(algorithm, task_setting, seed, settings, budget, experiment.resources)


def trainings_of(experiment: Experiment) -> Iterator[tuple[str, TaskSetting, int]]:
    """Yield algorithm, task setting and seed of each run; own code is not imported."""
    for seed in experiment.seeds:
        for task_setting in task_settings_of(experiment):
            for algorithm in experiment.algorithms:
                yield algorithm, task_setting, seed


def training_folder(algorithm: str, task_setting: TaskSetting, seed: int) -> Path:
    """Return where the results of a run are, in the experiment's folder."""
    return Path(file_name(algorithm), task_setting.folder, f"seed_{seed}")


def scripted_runs_of(experiment: Experiment) -> list[ScriptedRun]:
    """Return the tests of an experiment's scripted policies."""
    return [
        ScriptedRun(policy, task_setting)
        for policy in experiment.scripted
        for task_setting in task_settings_of(experiment)
    ]
