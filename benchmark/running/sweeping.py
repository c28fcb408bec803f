"""Searches for settings with Ray Tune: each trial is a training whose validation is reported."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
from ray import tune
from ray.tune.schedulers import ASHAScheduler, PopulationBasedTraining

from algorithms.settings import settings
from benchmark.experiment.config import Experiment, Tune
from benchmark.experiment.runs import Run, runs_of
from benchmark.running.driver import start_ray
from benchmark.running.files import locked, write_whole
from benchmark.running.folder import RunFolder
from benchmark.running.training import Training, algorithm_of
from smarts.errors import SmartsError, nearest_names

DRAWS = {"uniform": tune.uniform, "loguniform": tune.loguniform, "randint": tune.randint}
VALIDATION = "validation"
"""What counts the validations of a trial: the time of schedulers."""


class SweepError(SmartsError):
    """A search cannot be made."""


def sweep(experiment: Experiment, root: Path) -> pd.DataFrame:
    """Search, and return a row for each trial, the best first; the table is kept as trials.csv.

    The same call goes on with a search that was interrupted.

    Raises:
        SweepError: The experiment has no `tune` section, stands for several runs, or names no known draw.
    """
    run = the_run(experiment)
    section = _section(experiment)
    with locked(root):
        start_ray(experiment.resources)
        trainable = tune.with_resources(
            tune.with_parameters(trial, run=run),
            {"cpu": 1 + run.resources.env_runners, "gpu": run.resources.learner_gpus},
        )
        space = space_of(section)
        trials = root / "trials"
        if tune.Tuner.can_restore(str(trials.absolute())):
            tuner = tune.Tuner.restore(
                str(trials.absolute()), trainable, resume_unfinished=True, restart_errored=True
            )
        else:
            tuner = tune.Tuner(
                trainable,
                param_space=space,
                tune_config=tune.TuneConfig(
                    metric=section.metric,
                    mode="max",
                    num_samples=section.samples,
                    scheduler=scheduler_of(section, run.cell.evaluation.validations),
                    trial_dirname_creator=lambda trial: trial.trial_id,
                ),
                run_config=tune.RunConfig(name=trials.name, storage_path=str(root.absolute()), verbose=1),
            )
        found = tuner.fit().get_dataframe()
        columns = [name for name in found if name.startswith("config/")]
        shown = [
            *columns,
            section.metric,
            "completion",
            "safety",
            "return",
            VALIDATION,
            "agent_steps",
            "trial_id",
        ]
        table = pd.DataFrame(found[list(dict.fromkeys(shown))])
        table.columns = [name.removeprefix("config/") for name in table.columns]
        table = table.sort_values(section.metric, ascending=False, ignore_index=True)
        write_whole(root / "trials.csv", lambda file: table.to_csv(file, index=False))
    return table


def the_run(experiment: Experiment) -> Run:
    """Return the one run of an experiment.

    Raises:
        SweepError: It has several.
    """
    runs = [*runs_of(experiment)]
    if len(runs) > 1:
        raise SweepError(
            f"the experiment stands for {len(runs)} runs, a sweep searches with one",
            place=experiment.name,
            remedy="leave one algorithm, task, traffic and seed: --set seeds=[1] ...",
        )
    if not runs[0].cell.evaluation.validations:
        raise SweepError(
            "there is nothing to compare", place="evaluation.validations", remedy="give 1 or more"
        )
    return runs[0]


def space_of(section: Tune) -> dict[str, Any]:
    """Return Tune's search space.

    Raises:
        SweepError: Neither a list nor a known draw.
    """
    return {name: _values(name, given) for name, given in section.parameters.items()}


def _values(name: str, given: Any) -> Any:
    if isinstance(given, list) and given:
        return tune.grid_search(given)
    if isinstance(given, dict) and len(given) == 1:
        kind, bounds = next(iter(given.items()))
        if kind in DRAWS and isinstance(bounds, list) and len(bounds) == 2:
            return DRAWS[kind](*bounds)
    raise SweepError(
        f"{given!r} is nothing to search in",
        place=f"tune.parameters.{name}",
        remedy=f"give a list of values, or one of {', '.join(f'{{{kind}: [low, high]}}' for kind in DRAWS)}",
    )


def scheduler_of(section: Tune, validations: int) -> Any:
    """Return Tune's scheduler, None for none."""
    if section.scheduler == "asha":
        return ASHAScheduler(time_attr=VALIDATION, max_t=validations, grace_period=1)
    if section.scheduler == "pbt":
        mutations = {
            name: given if isinstance(given, list) else _values(name, given)
            for name, given in section.parameters.items()
        }
        return PopulationBasedTraining(
            time_attr=VALIDATION, perturbation_interval=1, hyperparam_mutations=mutations
        )
    return None


def trial(config: Mapping[str, Any], *, run: Run) -> None:
    """Train with changed settings and report each validation (called by Tune, in a process of its own)."""
    changed = replace(run, settings={**run.settings, **config})
    folder = RunFolder(Path(tune.get_context().get_trial_dir()) / "run")
    given = tune.get_checkpoint()
    if given is not None:
        with given.as_directory() as source:
            shutil.rmtree(folder.checkpoint, ignore_errors=True)
            shutil.copytree(source, folder.checkpoint)
    # Population-based training changes settings between checkpoints: the folder is not bound to one config.
    folder.open(changed.content(), "trial")
    validations = 0
    with algorithm_of(changed) as algo:
        for progress in Training(changed, folder, algo).go():
            if progress.validation is None:
                continue
            validations += 1
            tune.report(
                {
                    **progress.validation,
                    "safety": 1 - progress.validation["collision"],
                    VALIDATION: validations,
                    "agent_steps": progress.agent_steps,
                },
                checkpoint=tune.Checkpoint.from_directory(str(folder.checkpoint)),
            )


def _section(experiment: Experiment) -> Tune:
    if experiment.tune is None:
        raise SweepError(
            "there is no section `tune`", place=experiment.name, remedy="add tune: {parameters: ...}"
        )
    algorithm = experiment.algorithms[0]
    for name in experiment.tune.parameters:
        if name not in settings()[algorithm]:
            raise SweepError(
                f"{algorithm!r} has no setting {name!r}",
                place="tune.parameters",
                remedy=nearest_names(name, settings()[algorithm]),
            )
    return experiment.tune
