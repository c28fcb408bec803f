"""The runs that an experiment stands for, and where each keeps its results."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

from benchmark.experiment.config import Budget, Environment, Evaluation, Experiment, Resources, Task, name_of
from smarts.config import ConfigError, fitted
from smarts.registry import file_name
from smarts.sstudio.locating import resolved

REFERENCE = "reference"
"""Folder of the scripted policies' results, among those of the algorithms."""
SCRIPTED = "scripted"
"""Mode of policies that act in one way only; they stand beside every mode of the others."""
SCRIPTED_SEED = -1
"""Training seed in the tables of policies that were not trained."""


@dataclass(frozen=True)
class Cell:
    """A column of the table: a task with one traffic, and how it is played and tested."""

    task: Task
    traffic: str
    environment: Environment
    evaluation: Evaluation
    num_envs: int
    """Simulations side by side."""
    metrics: tuple[str, ...] | None = None
    """What tests measure; None: all that are registered."""
    imports: tuple[str, ...] = ()
    """Files and folders of own code, absolute, which every process that plays the cell has to import."""

    def __str__(self) -> str:
        return f"{self.task.name}, {self.traffic}"

    @property
    def folder(self) -> Path:
        """Where its results are, in an algorithm's folder."""
        return Path(self.task.name, self.traffic)

    def test_content(self) -> dict[str, Any]:
        """Return what a test of the cell consists of, as it is kept with its results."""
        evaluation = self.evaluation
        content: dict[str, Any] = {
            "episodes": evaluation.episodes,
            "modes": list(evaluation.modes),
            "held_out_episodes": evaluation.held_out_episodes,
        }
        return content if self.metrics is None else {**content, "metrics": list(self.metrics)}

    def own_content(self) -> dict[str, Any]:
        """Return where the own code of a run is, as it is kept with its results; nothing without any."""
        return {"imports": list(self.imports)} if self.imports else {}


@dataclass(frozen=True)
class Run:
    """One training and its test. Plain data, since it travels to other processes."""

    algorithm: str
    cell: Cell
    seed: int
    settings: Mapping[str, Any]
    """Of the algorithm, where they differ from its defaults."""
    budget: Budget
    resources: Resources

    def __str__(self) -> str:
        return f"{self.algorithm}, {self.cell}, seed {self.seed}"

    @property
    def folder(self) -> Path:
        """Where its results are, in the experiment's folder."""
        return training_folder(self.algorithm, self.cell, self.seed)

    @property
    def label(self) -> str:
        """The algorithm's name in folders and tables; see `file_name`."""
        return file_name(self.algorithm)

    def content(self) -> dict[str, Any]:
        """Return all that its training depends on, as it is kept beside its results."""
        evaluation = self.cell.evaluation
        return {
            "algorithm": self.algorithm,
            "scenarios": list(self.cell.task.scenarios),
            "traffic": self.cell.traffic,
            "seed": self.seed,
            "settings": dict(self.settings),
            "environment": self.cell.environment.model_dump(mode="json"),
            "budget": self.budget.model_dump(mode="json"),
            "validations": evaluation.validations,
            "validation_episodes": evaluation.validation_episodes,
            "env_runners": self.resources.env_runners,
            "num_envs_per_env_runner": self.resources.num_envs_per_env_runner,
            **self.cell.own_content(),
        }


def run_from(content: Mapping[str, Any]) -> Run:
    """Return the run of a `Run.content()`, to be tested again; its test is the default one.

    Raises:
        ValueError: It is not such a content.
    """
    try:
        scenarios = tuple(content["scenarios"])
        evaluation = fitted({key: content[key] for key in ("validations", "validation_episodes")}, Evaluation)
        return Run(
            content["algorithm"],
            Cell(
                fitted({"name": name_of(scenarios), "scenarios": [*scenarios]}, Task),
                content["traffic"],
                fitted(content["environment"], Environment),
                evaluation,
                content["num_envs_per_env_runner"],
                imports=tuple(content.get("imports", ())),
            ),
            content["seed"],
            content["settings"],
            fitted(content["budget"], Budget),
            fitted({key: content[key] for key in ("env_runners", "num_envs_per_env_runner")}, Resources),
        )
    except (KeyError, TypeError, ValueError, ConfigError) as error:
        raise ValueError(f"not the content of a run: {error}") from error


@dataclass(frozen=True)
class ReferenceRun:
    """A scripted policy's test."""

    policy: str
    cell: Cell

    def __str__(self) -> str:
        return f"{self.policy}, {self.cell}"

    @property
    def folder(self) -> Path:
        """Where its results are, in the experiment's folder."""
        return Path(REFERENCE, self.label, self.cell.folder)

    @property
    def label(self) -> str:
        """The policy's name in folders and tables; see `file_name`."""
        return file_name(self.policy)

    def content(self) -> dict[str, Any]:
        """Return all that its test depends on, but for its extent."""
        return {
            "policy": self.policy,
            "scenarios": list(self.cell.task.scenarios),
            "traffic": self.cell.traffic,
            "environment": self.cell.environment.model_dump(mode="json"),
            **self.cell.own_content(),
        }


def completed(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return a `content()` with the defaults of keys that the version which wrote it did not have.

    Sections that do not fit their model stay as they are.
    """
    found = json.loads(json.dumps(content))  # tuples as the lists that files have
    for name, model in (("environment", Environment), ("budget", Budget)):
        with suppress(ConfigError, TypeError):
            found |= {name: fitted(found[name], model).model_dump(mode="json")} if name in found else {}
    if isinstance(names := found.get("scenarios"), list):
        # Earlier versions wrote paths as the user gave them.
        found["scenarios"] = [resolved(name) if os.sep in str(name) else name for name in names]
    return found


def is_larger(budget: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether a budget of a `completed` content is larger than another one, and in nothing smaller."""
    limits = [[each.get(name) or inf for name in Budget.model_fields] for each in (budget, other)]
    return limits[0] != limits[1] and all(one >= two for one, two in zip(*limits, strict=True))


def cells_of(experiment: Experiment) -> list[Cell]:
    """Return the columns of an experiment's table."""
    return [
        Cell(
            task,
            traffic,
            experiment.environment,
            experiment.evaluation,
            experiment.resources.num_envs_per_env_runner,
            experiment.metrics,
            experiment.imports,
        )
        for traffic in experiment.traffic
        for task in experiment.tasks
    ]


def runs_of(experiment: Experiment) -> Iterator[Run]:
    """Yield the trainings of an experiment, the first seed of everything first: so a table fills early."""
    for algorithm, cell, seed in trainings_of(experiment):
        settings = experiment.settings_of(algorithm)
        yield Run(algorithm, cell, seed, settings, experiment.budget, experiment.resources)


def trainings_of(experiment: Experiment) -> Iterator[tuple[str, Cell, int]]:
    """Yield algorithm, cell and seed of each run, without a look at settings: own code is not imported."""
    for seed in experiment.seeds:
        for cell in cells_of(experiment):
            for algorithm in experiment.algorithms:
                yield algorithm, cell, seed


def training_folder(algorithm: str, cell: Cell, seed: int) -> Path:
    """Return where the results of a run are, in the experiment's folder."""
    return Path(file_name(algorithm), cell.folder, f"seed_{seed}")


def references_of(experiment: Experiment) -> list[ReferenceRun]:
    """Return the tests of an experiment's scripted policies."""
    return [ReferenceRun(policy, cell) for policy in experiment.reference for cell in cells_of(experiment)]
