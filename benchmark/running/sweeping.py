"""Searches for settings with Ray Tune: each trial is a training whose validation is reported."""

from __future__ import annotations

import json
import os
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from math import prod
from pathlib import Path
from threading import Event
from types import FrameType
from typing import Any

import pandas as pd
import ray
from ray import tune
from ray.tune.schedulers import ASHAScheduler, PopulationBasedTraining
from ray.tune.search.basic_variant import BasicVariantGenerator

from benchmark.experiment.algorithm_settings import setting_names
from benchmark.experiment.models import Experiment, Tune
from benchmark.experiment.runs import INPUTS, START, Run, runs_of
from benchmark.results.files import ResultsError, locked, read_versioned, write_versioned, write_whole
from benchmark.results.run_folder import SCENARIOS, RunFolder, differing_values
from benchmark.running.choosing import TRIALS, SweepError, text_of, write_chosen
from benchmark.running.cluster import start_ray
from benchmark.running.exit_codes import FAILED
from benchmark.running.experiment import check_task_settings, interrupted, resumable
from benchmark.running.importing import named_own_code
from benchmark.running.messages import Kept, RunProgress
from benchmark.running.played import scenario_digests
from benchmark.running.shipping import shipped_code
from benchmark.running.signals import handled
from benchmark.running.training import Training, algorithm_of, config_of
from smarts.errors import shortened

VALIDATION = "validation"
"""What counts the validations of a trial: the time of schedulers."""
SEARCH = "search.json"
"""Name of the file of a search's folder that says what is searched."""
MEASURES = ("completion", "safety", "return", VALIDATION, "agent_steps", "trial_id")
"""What the table of trials shows beside the settings."""
OF_NETWORKS = ("sharing", "identity", "set_width")
"""Settings that networks are built from, beside those of `checkpoint_signature`."""


def sweep(experiment: Experiment, root: Path) -> int:
    """Search, print and keep a row for each trial in trials.csv, the best first; return the exit code.

    With several algorithms or conditions there is a search for each algorithm in each condition, in a folder
    of its own, with the same draws in all conditions; `write_chosen` then writes what is best on average over
    them. The same call resumes an interrupted search, and repeats none that `is_complete`.

    Raises:
        SweepError: The experiment has no `tune` section, or cannot be searched.
        SmartsError: A scenario is wrong, or the folder cannot be used.
    """
    runs, section = searched_runs(experiment), experiment.tune
    assert section is not None
    check_task_settings(experiment)
    folders = [root if len(runs) == 1 else root / run.folder.parent for run in runs]
    codes: list[int] = []
    with locked(root):
        ended = [
            is_complete(folder, section, run.algorithm) for run, folder in zip(runs, folders, strict=True)
        ]
        for run, folder, has_ended in zip(runs, folders, ended, strict=True):
            _check_same_search(folder / SEARCH, run, section)
            if not has_ended:
                RunFolder(folder / SEARCH).check_start(run.content())
        try:
            if not all(ended):
                with shipped_code(experiment) as code:
                    start_ray(experiment.resources, code)
            with _stoppable() as stopped:
                for run, folder, has_ended in zip(runs, folders, ended, strict=True):
                    if has_ended:
                        _show(pd.read_csv(folder / TRIALS), folder)
                        continue
                    tuner = _tuner(run, section, space_of(section, run.algorithm), folder.absolute())
                    if stopped.is_set():
                        break
                    found = tuner.fit()
                    if stopped.is_set():
                        break
                    codes.append(_summarize(found, section, folder))
        finally:
            ray.shutdown()
        if stopped.is_set():
            return interrupted(resumable(root))
        if len(runs) > 1 and not any(codes):
            tables = [(run.algorithm, each / TRIALS) for run, each in zip(runs, folders, strict=True)]
            write_chosen(experiment, section, tables, root)
        return max(codes, default=0)


def is_complete(folder: Path, section: Tune, algorithm: str) -> bool:
    """Return whether a search has ended: all of its trials are in its table, none failed.

    Only the table and search.json are needed then, so the trials' own folders can be removed.
    """
    if not ((folder / TRIALS).exists() and (folder / SEARCH).exists()):
        return False
    table = pd.read_csv(folder / TRIALS)
    if not {"trial_id", section.metric} <= {*table}:  # averages over conditions
        return False
    grids = (len(given) for given in parameters_of(section, algorithm).values() if isinstance(given, list))
    return len(table.dropna(subset=[section.metric])) == section.samples * prod(grids)


@contextmanager
def _stoppable() -> Iterator[Event]:
    """Stop a search at the first Ctrl-C or SIGTERM, keeping its state; exit at the second.

    Yields:
        An event, set once the search was stopped; Tune returns as if the search were finished.
    """
    stopped = Event()

    def stop(number: int, frame: FrameType | None) -> None:
        tune_listens = signal.getsignal(signal.SIGUSR1) is not signal.SIG_DFL
        if stopped.is_set() or not tune_listens:
            raise KeyboardInterrupt
        stopped.set()
        signal.raise_signal(signal.SIGUSR1)

    os.environ["TUNE_DISABLE_SIGINT_HANDLER"] = "1"
    with handled(stop, signal.SIGINT, signal.SIGTERM):
        yield stopped


def _check_same_search(file: Path, run: Run, section: Tune) -> None:
    """Raise if the folder holds another search, which Tune would continue without a message."""
    content = {
        "run": run.content(),
        "tune": section.model_dump(),
        SCENARIOS: scenario_digests(run.task_setting),
    }
    if not file.exists():
        write_versioned(file, content)
    elif differing := differing_values(read_versioned(file), json.loads(json.dumps(content))):
        raise ResultsError(
            f"here is another search: {differing}",
            place=str(file),
            remedy="restore it, give another name or --out, or remove the folder to start again",
        )


def _tuner(run: Run, section: Tune, space: Mapping[str, Any], root: Path) -> tune.Tuner:
    """Return Tune's tuner: of the search that was interrupted in the folder, or of a new one."""
    trainable = tune.with_resources(
        tune.with_parameters(trial, run=run),
        # A bundle for each process: RLlib puts its env runners into those after the first.
        tune.PlacementGroupFactory(run.resources.bundles),
    )
    trials = root / "trials"
    # Tune writes its own file, then its state, then the searcher's: restored without the last, it would try
    # no settings at all.
    if tune.Tuner.can_restore(str(trials)) and any(trials.glob("basic-variant-state-*.json")):
        return tune.Tuner.restore(str(trials), trainable, resume_unfinished=True, restart_errored=True)
    return tune.Tuner(
        trainable,
        param_space=dict(space),
        tune_config=tune.TuneConfig(
            metric=section.metric,
            mode="max",
            num_samples=section.samples,
            search_alg=BasicVariantGenerator(
                max_concurrent=run.resources.parallel or 0, random_state=run.seed
            ),
            scheduler=scheduler_of(section, run.algorithm, run.task_setting.evaluation.validations),
            trial_dirname_creator=lambda trial: trial.trial_id,
        ),
        run_config=tune.RunConfig(name=trials.name, storage_path=str(root), verbose=1),
    )


def _summarize(found: tune.ResultGrid, section: Tune, root: Path) -> int:
    """Write and print the table of trials, and say which failed."""
    # Not `get_dataframe`, which reads the trials' logs: after a kill some are empty.
    results = pd.DataFrame(
        [
            {**each.metrics, **{f"config/{k}": text_of(v) for k, v in (each.config or {}).items()}}
            for each in found
            if each.metrics and each.error is None
        ]
    )
    for error in found.errors:
        print(f"error: {shortened(str(getattr(error, 'cause', None) or error))}", file=sys.stderr)
    if section.metric in results:
        settings_columns = [name for name in results if name.startswith("config/")]
        shown = [*settings_columns, *dict.fromkeys((section.metric, *MEASURES))]
        table = pd.DataFrame(results[shown]).sort_values(section.metric, ascending=False, ignore_index=True)
        table.columns = [name.removeprefix("config/") for name in table.columns]
        write_whole(root / TRIALS, lambda file: table.to_csv(file, index=False))
        _show(table, root)
    if found.num_errors:
        failed = f"{found.num_errors} of {len(found)} trials failed"
        print(f"{failed}; give the same command again to retry", file=sys.stderr)
    return FAILED if found.num_errors else 0


def _show(table: pd.DataFrame, folder: Path) -> None:
    print(table.to_string(index=False))
    print(f"table: {folder / TRIALS}")


def searched_runs(experiment: Experiment) -> list[Run]:
    """Return the runs whose settings are searched: one for each algorithm and condition.

    Raises:
        SweepError: There are no algorithms, several seeds, no validations, or several conditions and a
            scheduler, which would stop the same settings early in one condition and not in another; or
            population-based training would change the networks of a checkpoint.
    """
    runs = [*runs_of(experiment)]
    for fault, place, remedy in _faults(experiment, runs):
        raise SweepError(fault, place=place, remedy=remedy)
    return runs


def _faults(experiment: Experiment, runs: Sequence[Run]) -> Iterator[tuple[str, str, str]]:
    """Yield why an experiment cannot be searched, where, and what to do about it."""
    section = experiment.tune
    if section is None:
        yield "there is no section `tune`", experiment.name, "add tune: {parameters: ...}"
        return
    if not runs:
        yield (
            "there is no algorithm whose settings are searched",
            experiment.name,
            "name one: algorithms: [ppo]",
        )
    if len(experiment.seeds) > 1:
        count = len(experiment.seeds)
        yield (
            f"the experiment stands for {count} runs in each condition, a search has one",
            experiment.name,
            "leave one seed: --set seeds=[1]",
        )
    if not experiment.evaluation.validations:
        yield "there is nothing to compare", "evaluation.validations", "give 1 or more"
    if section.scheduler != "none" and len(runs) > len(experiment.algorithms):
        yield (
            f"{section.scheduler} cannot compare settings over several conditions",
            "tune.scheduler",
            "remove it, or leave one task and traffic",
        )
    for run in runs if section.scheduler == "pbt" else ():
        for name in {*parameters_of(section, run.algorithm)} & {
            *config_of(run).checkpoint_signature(),
            *OF_NETWORKS,
        }:
            yield (
                f"pbt changes settings of trained networks; {run.algorithm!r} builds them from {name}",
                f"tune.parameters.{name}",
                "leave it out, or search it without a scheduler",
            )


def space_of(section: Tune, algorithm: str) -> dict[str, Any]:
    """Return Tune's search space of an algorithm: of a checked section, the settings that it has."""
    return {name: _values(given) for name, given in parameters_of(section, algorithm).items()}


def parameters_of(section: Tune, algorithm: str) -> dict[str, Any]:
    """Return the parameters of a checked section that an algorithm has."""
    names = setting_names(algorithm)
    return {name: given for name, given in section.parameters.items() if name in names}


def _values(given: Any) -> Any:
    if isinstance(given, list):
        return tune.grid_search(given)
    ((kind, values),) = given.items()
    return tune.choice(values) if kind == "choice" else getattr(tune, kind)(*values)


def _listed(given: Any) -> list[Any]:
    """Return the values that a search chooses from; none of a draw within bounds."""
    return given if isinstance(given, list) else given.get("choice", [])


def scheduler_of(section: Tune, algorithm: str, validations: int) -> Any:
    """Return Tune's scheduler for the settings that an algorithm has, None for none."""
    if section.scheduler == "asha":
        return ASHAScheduler(time_attr=VALIDATION, max_t=validations, grace_period=1)
    if section.scheduler == "pbt":
        parameters = parameters_of(section, algorithm)
        mutations = {name: _listed(given) or _values(given) for name, given in parameters.items()}
        return Population(
            validations,
            time_attr=VALIDATION,
            perturbation_interval=1,
            hyperparam_mutations=mutations,
            custom_explore_fn=partial(within_bounds, section),
        )
    return None


class Population(PopulationBasedTraining):
    """Lets trials end as they are after their last validation: a copy of a better one would not train.

    Args:
        validations: Number of validations of each trial.
        options: Options of `PopulationBasedTraining`.
    """

    def __init__(self, validations: int, **options: Any) -> None:
        super().__init__(**options)
        self._validations = validations

    def on_trial_result(self, tune_controller: Any, trial: Any, result: dict) -> str:
        """Return what the scheduler decides about a trial after a validation."""
        if result[VALIDATION] >= self._validations:
            return self.CONTINUE
        return super().on_trial_result(tune_controller, trial, result)


def within_bounds(section: Tune, config: dict[str, Any]) -> dict[str, Any]:
    """Return settings with draws kept in their bounds, out of which population-based training scales them."""
    kept = dict(config)
    for name, given in section.parameters.items():
        if name in kept and not _listed(given):
            (kind, (low, high)), *_ = given.items()
            # An upper bound of whole numbers is never drawn itself.
            kept[name] = min(max(kept[name], low), high - 1 if kind == "randint" else high)
    return kept


def trial(config: Mapping[str, Any], *, run: Run) -> None:
    """Train with changed settings and report each validation (called by Tune, in a process of its own)."""
    changed = replace(run, settings={**run.settings, **config})
    given = tune.get_checkpoint()
    # Not in the trial's own folder, which Tune copies at any time, whatever is being written there.
    with tempfile.TemporaryDirectory(prefix="smarts-bench-") as temporary:
        folder = RunFolder(Path(temporary))
        folder.open(changed.content())
        if given is not None:  # only now: with other settings, if the population has changed them
            given.to_directory(str(folder.checkpoint))
        elif origin := changed.task_setting.task.start_from:
            folder.keep(f"{INPUTS}/{START}", RunFolder(Path(origin)).networks())
        with named_own_code("the trial's own code"), algorithm_of(changed) as algo:
            training = Training(changed, folder, algo)
            for message in training.go():
                if isinstance(message, Kept):
                    folder.keep(message.place, message.content)
                elif isinstance(message, RunProgress) and message.validation is not None:
                    tune.report(
                        {
                            **message.validation,
                            "safety": 1 - message.validation["collision"],
                            VALIDATION: training.validations,
                            "agent_steps": message.line["agent_steps"],
                        },
                        checkpoint=tune.Checkpoint.from_directory(str(folder.checkpoint)),
                    )
