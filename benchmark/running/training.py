"""One run: training within a budget with validations and checkpoints, and a test at the end."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from ray import cloudpickle
from ray.tune.registry import register_env

from algorithms.errors import AlgorithmError
from algorithms.joint.episode_indices import FIRST_VALIDATION_EPISODE
from algorithms.joint.evaluation import evaluate
from benchmark.experiment.algorithm_settings import CONFIGS
from benchmark.experiment.own_code import PROGRAM
from benchmark.experiment.runs import Run
from benchmark.results.files import ResultsError
from benchmark.results.progress import add_progress, begin_progress
from benchmark.results.run_folder import ENDED_BY, FINISHED, SCENARIOS, TESTING, TRAINING, RunFolder
from benchmark.running.environments import NAME, create, environment
from benchmark.running.machine import machine
from benchmark.running.own_runner import own_code_runner
from benchmark.running.played import scenario_digests
from benchmark.running.progress import RunProgress
from benchmark.running.scalars import Scalars
from benchmark.running.testing import EVALUATION_SEED, play_test
from smarts.registry import import_own

CHECKPOINT_SECONDS = 60.0
"""Time between checkpoints, which is what a kill can cost."""


@dataclass(frozen=True)
class TrainingState:
    """State of training, saved with each checkpoint."""

    iteration: int = 0
    agent_steps: int = 0
    seconds: float = 0.0
    validations: int = 0
    best: tuple[float, float] | None = None
    """Completion and collision of the best validation."""


def train_and_evaluate(
    run: Run, folder: RunFolder, is_stopped: Callable[[], bool] = lambda: False
) -> Iterator[RunProgress]:
    """Train and test a run from its last checkpoint on; do nothing if it is finished.

    Args:
        run: The run.
        folder: Of its results.
        is_stopped: Called before each iteration; if True, training is saved and the function returns.

    Yields:
        Progress, after each iteration.

    Raises:
        SmartsError: The folder cannot be used, or the environment cannot be made.
        AlgorithmError: The settings do not fit the environment, or training fails.
    """
    tested = run.task_setting.test_content()
    if folder.is_finished(tested) and not folder.is_extended(run.content()):
        return
    folder.open(run.content())
    circumstances = {"begun": _now(), **machine()}
    scenarios = {SCENARIOS: scenario_digests(run.task_setting)}
    if folder.status is None:
        folder.note(status=TRAINING, run=str(run), **scenarios, **circumstances)
    else:
        folder.note_continuation(circumstances)
    with algorithm_of(run) as algo:
        training = Training(run, folder, algo)
        yield from training.go(is_stopped)
        if training.ended_by is None:
            return
        folder.note(status=TESTING, **{ENDED_BY: training.ended_by})
        began = time.monotonic()
        for share in play_test(run, folder, algo):
            yield RunProgress(TESTING, share)
    took = round(time.monotonic() - began, 1)
    folder.note(status=FINISHED, tested=tested, ended=_now(), test_seconds=took, **scenarios)


@contextmanager
def algorithm_of(run: Run) -> Iterator[Any]:
    """Provide the built algorithm of a run."""
    register_env(NAME, create)
    config = config_of(run)
    config.environment(NAME, env_config={"task_setting": run.task_setting, "discount": config.gamma})
    algo = config.build_algo()
    with suppress(OSError):
        Path(algo.logdir).rmdir()  # in ~/ray_results, always empty
    try:
        yield algo
    finally:
        algo.stop()


def config_of(run: Run) -> Any:
    """Return the RLlib config of a run's algorithm, without its environment.

    Raises:
        OwnCodeError: A `module:Class` cannot be imported, or is no algorithm.
    """
    import_own(run.task_setting.imports)
    config = CONFIGS[run.algorithm]()
    if run.task_setting.imports:
        config.env_runner_cls = own_code_runner(run.task_setting.imports)
    config.env_runners(
        num_env_runners=run.resources.env_runners, num_envs_per_env_runner=run.task_setting.num_envs
    )
    if run.resources.learner_gpus:
        config.learners(num_gpus_per_learner=run.resources.learner_gpus)
    config.debugging(seed=run.seed, log_level="ERROR")
    settings = dict(run.settings)
    if "checkpoint_replay" in config.setting_names:
        # Hundreds of megabytes a minute; a resumed run fills its replay buffer again.
        settings.setdefault("checkpoint_replay", False)
    return config.training(**settings)


def restore(algo: Any, checkpoint: Path) -> None:
    """Restore an algorithm from a checkpoint.

    Raises:
        ResultsError: The checkpoint is damaged, or of another version of this program; it names the file.
        AlgorithmError: The checkpoint does not fit the algorithm.
    """
    try:
        algo.restore_from_path(str(checkpoint.absolute()))
    except AlgorithmError:
        raise
    except Exception as error:  # unpickling half a file may raise anything
        for file in sorted(checkpoint.rglob("*.pkl")):
            unpickled(file)
        raise checkpoint_error(error, checkpoint) from error


def unpickled(file: Path) -> Any:
    """Return the content of a file of a checkpoint.

    Raises:
        ResultsError: It is missing, damaged, or of another version of this program.
    """
    try:
        with file.open("rb") as stream:
            return cloudpickle.load(stream)
    except Exception as error:  # unpickling half a file may raise anything
        raise checkpoint_error(error, file) from error


def checkpoint_error(error: Exception, place: Path) -> ResultsError:
    """Return the error for a checkpoint that cannot be read."""
    if is_of_other_version(error):
        return ResultsError(
            f"the checkpoint is of another version of this program: {error}",
            place=str(place),
            remedy="use the version that `commit` and `versions` in run.json name, or train again",
        )
    if isinstance(error, ModuleNotFoundError):
        return ResultsError(
            f"the checkpoint needs the module {error.name!r}, which cannot be imported",
            place=str(place),
            remedy="name its file or folder in `imports`; if the checkpoint is damaged, test the other one: "
            "--checkpoint last or best",
        )
    return ResultsError(
        f"the checkpoint is damaged: {type(error).__name__}: {error}",
        place=str(place),
        remedy="test the other one, --checkpoint last or best, or remove this one to train from the start",
    )


def is_of_other_version(error: Exception) -> bool:
    """Return whether unpickling failed for want of a class or module of this program."""
    if isinstance(error, ImportError):
        return (error.name or "").partition(".")[0] in PROGRAM
    named = re.search(r"<module '(\w+)", str(error)) if isinstance(error, AttributeError) else None
    return named is not None and named[1] in PROGRAM


class Training:
    """Trains from the last checkpoint to the end of the budget."""

    def __init__(self, run: Run, folder: RunFolder, algo: Any) -> None:
        self._run, self._folder, self._algo = run, folder, algo
        kept = folder.training_state()
        if kept is None:
            self._state = TrainingState()
        else:
            restore(algo, folder.checkpoint)
            self._state = TrainingState(**{**kept, "best": tuple(kept["best"]) if kept["best"] else None})
            # Fewer than were made if the budget has grown since: the others are repeated.
            self._state = replace(self._state, validations=min(self._due_validations(), kept["validations"]))
        lines = begin_progress(folder.progress, self._state.iteration)
        self._scalars = Scalars(folder.tensorboard, lines)

    @property
    def validations(self) -> int:
        """Number of validations, earlier parts of the run included."""
        return self._state.validations

    @property
    def ended_by(self) -> str | None:
        """The budget that is used up, "agent_steps" or "minutes"; None while both are left."""
        if self._share() < 1:
            return None
        return "agent_steps" if self._state.agent_steps >= self._run.budget.agent_steps else "minutes"

    def go(self, is_stopped: Callable[[], bool] = lambda: False) -> Iterator[RunProgress]:
        """Train until the budget is used up or `is_stopped`, and save; yield after each iteration."""
        with closing(self._scalars):
            yield from self._go(is_stopped)

    def _go(self, is_stopped: Callable[[], bool]) -> Iterator[RunProgress]:
        saved = time.monotonic()
        while self._share() < 1:
            if is_stopped():
                self._folder.save(self._folder.checkpoint, self._algo, asdict(self._state))
                return
            progress, line = self._iterate()
            validation = self._validate() if self._is_validation_due() else None
            line |= {f"validation_{name}": value for name, value in (validation or {}).items()}
            add_progress(self._folder.progress, line)
            self._scalars.add(line)
            if validation or time.monotonic() - saved > CHECKPOINT_SECONDS or self._share() >= 1:
                self._folder.save(self._folder.checkpoint, self._algo, asdict(self._state))
                saved = time.monotonic()
            yield replace(progress, validation=validation)

    def _share(self) -> float:
        budget, state = self._run.budget, self._state
        share = state.agent_steps / budget.agent_steps
        return min(1.0, max(share, state.seconds / (60 * budget.minutes) if budget.minutes else 0.0))

    def _iterate(self) -> tuple[RunProgress, dict[str, Any]]:
        began = time.monotonic()
        result = self._algo.train()
        took = time.monotonic() - began
        runners = result["env_runners"]
        decisions = sum(runners["num_agent_steps_sampled_lifetime"].values())
        agent_steps = int(decisions * self._run.task_setting.environment.decision_interval)
        speed = (agent_steps - self._state.agent_steps) / took
        self._state = replace(
            self._state,
            iteration=self._state.iteration + 1,
            agent_steps=agent_steps,
            seconds=self._state.seconds + took,
        )
        outcomes = runners.get("env", {})
        agents = self._run.task_setting.environment.agent_count
        progress = RunProgress(
            TRAINING,
            self._share(),
            self._state.iteration,
            agent_steps,
            self._state.seconds,
            speed,
            float(runners.get("episode_return_mean", np.nan)) / agents,
            float(outcomes.get("goal", np.nan)),
            float(outcomes.get("collision", np.nan)),
        )
        return progress, {
            "iteration": progress.iteration,
            "agent_steps": agent_steps,
            "seconds": round(progress.seconds, 2),
            "agent_steps_per_second": round(speed),
            "return": round(progress.returns, 4),
            "completion": round(progress.completion, 4),
            "collision": round(progress.collision, 4),
        }

    def _is_validation_due(self) -> bool:
        return self._due_validations() > self._state.validations

    def _due_validations(self) -> int:
        """Return how many validations are due by now."""
        return int(self._share() * self._run.task_setting.evaluation.validations)

    def _validate(self) -> Mapping[str, float]:
        """Play the validation episodes, and save the policy if it is the best so far."""
        with closing(environment(self._run.task_setting, discount=self._algo.config.gamma)) as env:
            episodes = evaluate(
                self._algo,
                self._run.task_setting.evaluation.validation_episodes,
                first_episode=FIRST_VALIDATION_EPISODE,
                env=env,
                seed=EVALUATION_SEED,
            )
        valid = [episode for episode in episodes if not episode.metrics["invalid"]]
        rows = [(each.metrics["goal"], each.metrics["collision"], each.returns.mean()) for each in valid]
        completion, collision, returns = (
            (float(np.mean(column)) for column in zip(*rows, strict=True)) if (rows) else (np.nan,) * 3
        )
        self._state = replace(self._state, validations=self._due_validations())
        best = self._state.best
        if valid and (best is None or (completion, -collision) > (best[0], -best[1])):
            self._state = replace(self._state, best=(completion, collision))
            self._folder.save(self._folder.best, self._algo, asdict(self._state))
        return {
            "return": round(returns, 4),
            "completion": round(completion, 4),
            "collision": round(collision, 4),
        }


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S%z")
