"""One run: training within a budget with validations and checkpoints, and a test at the end."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import ray
from ray import cloudpickle
from ray.tune.registry import register_env

from algorithms.errors import AlgorithmError
from algorithms.joint.episode_indices import FIRST_VALIDATION_EPISODE
from algorithms.joint.evaluation import evaluate
from algorithms.joint.fitting import Agents, fitted_weights
from algorithms.joint.runner import JointEnvRunner, Reply
from benchmark.experiment.algorithm_settings import CONFIGS, own_defaults
from benchmark.experiment.runs import DATA, DEMONSTRATIONS, KL_TO, NOT_TAKEN, START, TESTED, Run
from benchmark.results.digests import OTHER_CHECKPOINT, check_digests, with_digests
from benchmark.results.files import ResultsError, files_in, write_json
from benchmark.results.run_folder import (
    BEST,
    CHECKPOINT,
    ENDED_BY,
    FINISHED,
    SCENARIOS,
    TESTING,
    TRAINING,
    RunFolder,
)
from benchmark.running.environments import NAME, create, environment
from benchmark.running.importing import named_own_code
from benchmark.running.machine import machine
from benchmark.running.messages import Began, Kept, Line, Message, Noted, RunProgress
from benchmark.running.played import scenario_digests
from benchmark.running.testing import EVALUATION_SEED, play_test, results_of
from smarts.env.demonstrations import about
from smarts.errors import OwnCodeError
from smarts.observations.lists import feature_list
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
    run: Run, scratch: RunFolder, is_stopped: Callable[[], bool] = lambda: False
) -> Iterator[Message]:
    """Train and test a run from its last checkpoint on.

    Args:
        run: The run.
        scratch: Folder for temporary files, with the checkpoint if there is one.
        is_stopped: Called before each iteration; if True, training is saved and the function returns.

    Yields:
        Results, and progress after each iteration.

    Raises:
        SmartsError: The checkpoint is damaged, or the environment cannot be made.
        AlgorithmError: The settings do not fit the environment, or training fails.
    """
    scenarios, run = scenario_digests(run.task_setting), with_files(run, scratch.inputs)
    yield Began({"begun": _now(), **machine()}, scenarios)
    with algorithm_of(run) as algo:
        training = Training(run, scratch, algo)
        if training.unfit is not None:
            yield Noted({NOT_TAKEN: training.unfit})
        if (data := run.settings.get(DATA)) and Path(data).is_file():
            yield Noted({DEMONSTRATIONS: about(data)})
        yield from training.go(is_stopped)
        if training.ended_by is None:
            return
        yield Noted({"status": TESTING, ENDED_BY: training.ended_by})
        began = time.monotonic()
        for share in play_test(run, scratch, algo.config.gamma, partial(_play, algo)):
            yield RunProgress(TESTING, share)
    took = round(time.monotonic() - began, 1)
    yield from results_of(scratch)
    tested = {TESTED: run.task_setting.test_content(), "ended": _now(), "test_seconds": took}
    yield Noted({"status": FINISHED, **tested, SCENARIOS: scenarios})


def with_files(run: Run, inputs: Path) -> Run:
    """Return a run whose settings name the files that it was sent, in place of those on another machine."""
    sent = {DATA: next((inputs / DATA).glob("*"), None), KL_TO: inputs / KL_TO}
    here = {name: str(place) for name, place in sent.items() if place and place.exists()}
    return replace(run, settings={**run.settings, **here})


def _play(algo: Any, env: Any, indices: range, mode: str) -> None:
    """Play the episodes of some indices with the present policies."""
    explore, first = mode == "sampled", indices.start
    evaluate(algo, len(indices), explore=explore, first_episode=first, env=env, seed=EVALUATION_SEED)


@contextmanager
def algorithm_of(run: Run) -> Iterator[Any]:
    """Provide the built algorithm of a run."""
    register_env(NAME, create)
    check_demonstrations(run)
    config = config_of(run)
    given = {"task_setting": run.task_setting, "discount": config.gamma, "policy": run.label}
    config.environment(NAME, env_config=given)
    algo = config.build_algo()
    with suppress(OSError):
        Path(algo.logdir).rmdir()  # in ~/ray_results, always empty
    try:
        yield algo
    finally:
        algo.stop()


def check_demonstrations(run: Run) -> None:
    """Raise if the demonstrations that a run learns from are not of its environment's agents.

    Raises:
        ResultsError: They observe, act or decide in another way.
    """
    data, environment = run.settings.get(DATA), run.task_setting.environment
    if data is None or not Path(data).is_file():
        return  # the algorithm says so
    said = about(data)
    if said.get("observation") is not None:
        said["observation"] = feature_list(said["observation"])
    here = {
        "observation": feature_list(environment.observation),
        "action": environment.action,
        "decision_interval": environment.decision_interval,
    }
    for name, value in here.items():
        if said.get(name) not in (None, value):
            raise ResultsError(
                f"the demonstrations are of another {name} than the environment's",
                place=f"data {Path(data).name}",
                remedy=f"demonstrate with the {name} of the experiment's `environment`",
            )


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
    config.learners(num_learners=run.resources.learners, num_gpus_per_learner=run.resources.learner_gpus)
    config.debugging(seed=run.seed, log_level="ERROR")
    return config.training(**{**own_defaults(config.setting_names), **run.settings})


def checkpoint_files(algo: Any, state: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the files of a checkpoint with the state of training and their digests."""
    with tempfile.TemporaryDirectory(prefix="smarts-bench-") as temporary:
        folder = Path(temporary, CHECKPOINT)
        algo.save_to_path(str(folder))
        write_json(folder / "training.json", dict(state))
        return with_digests(files_in(folder))


def check_checkpoint(checkpoint: Path) -> None:
    """Raise if a checkpoint cannot be used, before anything is made of it.

    Raises:
        ResultsError: A file is not as it was written, or weights are not finite.
    """
    check_digests(checkpoint, OTHER_CHECKPOINT)
    for file in sorted(checkpoint.glob("learner_group/learner/rl_module/*/module_state.pkl")):
        broken = [name for name, each in unpickled(file).items() if not np.isfinite(each).all()]
        if broken:
            problem = f"the weights of {broken[0]} are not finite"
            raise ResultsError(problem, place=str(file), remedy=OTHER_CHECKPOINT)


def restore(algo: Any, checkpoint: Path) -> None:
    """Restore an algorithm from a checkpoint.

    Raises:
        ResultsError: The checkpoint is damaged.
        AlgorithmError: The checkpoint does not fit the algorithm.
    """
    check_checkpoint(checkpoint)
    algo.restore_from_path(str(checkpoint.absolute()))


def index_of(run: Run) -> int | None:
    """Return where a run's observation has the number of the agent, None where it has none."""
    environment = run.task_setting.environment
    if environment.adapter is not None:
        return None
    found = feature_list(environment.observation).layout(environment.agent_count).get("agent_index")
    return None if found is None else found.start


def take_weights(run: Run, algo: Any, networks: Path) -> list[str]:
    """Take the weights of another run that fit; return the names of an algorithm's weights that do not.

    Raises:
        ResultsError: None fits, or a file is damaged.
    """
    weights = algo.learner_group.get_weights()
    unfit = []
    for module, own in weights.items():
        folder, left = networks / module, [*own]
        if folder.exists():
            built = unpickled(folder / "class_and_ctor_args.pkl")["ctor_args_and_kwargs"][1]["model_config"]
            here, there = (Agents.of(spec, built["group"]) for spec in (algo.spec, built["spec"]))
            given = unpickled(folder / "module_state.pkl")
            weights[module], left = fitted_weights(own, given, here, there, index_of(run))
        # One name for a network of which nothing fits.
        unfit += [module] if len(left) == len(own) else [f"{module}.{name}" for name in left]
    if unfit == [*weights]:
        raise ResultsError(
            "none of the weights fits",
            place=str(run.task_setting.task.start_from),
            remedy="start from a run with the same observation and networks",
        )
    algo.learner_group.set_weights(weights)
    return unfit


def unpickled(file: Path) -> Any:
    """Return the content of a file of a checkpoint.

    Raises:
        ResultsError: It is missing or damaged, or needs a module that cannot be imported.
    """
    try:
        with file.open("rb") as stream:
            return cloudpickle.load(stream)
    except Exception as error:  # unpickling half a file may raise anything
        is_own = isinstance(error, ModuleNotFoundError)
        raise ResultsError(
            f"damaged, or of another version of this program: {type(error).__name__}: {error}",
            place=str(file),
            remedy=f"name the file or folder of {error.name!r} in `imports`" if is_own else OTHER_CHECKPOINT,
        ) from error


class Training:
    """Trains from the last checkpoint to the end of the budget.

    Args:
        run: The run.
        folder: With the checkpoint, if there is one; nothing else of it is used, and what it holds stays.
        algo: The built algorithm.
    """

    def __init__(self, run: Run, folder: RunFolder, algo: Any) -> None:
        self._run, self._algo = run, algo
        kept = folder.training_state()
        self.unfit: list[str] | None = None
        """Weights that did not fit of the run that it starts from; None where it starts from none."""
        if kept is None:
            self._state = TrainingState()
            if (start := folder.inputs / START).exists():
                self.unfit = take_weights(run, algo, start)
        else:
            restore(algo, folder.checkpoint)
            self._state = TrainingState(**{**kept, "best": tuple(kept["best"]) if kept["best"] else None})
            # Fewer than were made if the budget has grown since: the others are repeated.
            self._state = replace(self._state, validations=min(self._due_validations(), kept["validations"]))

    @property
    def validations(self) -> int:
        """Number of validations, earlier parts of the run included."""
        return self._state.validations

    @property
    def ended_by(self) -> str | None:
        """The budget that is used up, "agent_steps" or "minutes"; None while both are left."""
        if self._share() < 1:
            return None
        return "agent_steps" if self._state.agent_steps >= self._run.budget.most_steps else "minutes"

    def go(self, is_stopped: Callable[[], bool] = lambda: False) -> Iterator[Message]:
        """Train until the budget is used up or `is_stopped`; the last checkpoint is of the last iteration.

        Yields:
            Results, and progress after each iteration.
        """
        saved = time.monotonic()
        while self._share() < 1:
            if is_stopped():
                yield self._saved(CHECKPOINT)
                return
            line, validation, best = self._iterate(), None, self._state.best
            if self._is_validation_due():
                validation = self._validate()
                line |= {f"validation_{name}": value for name, value in validation.items()}
                if self._state.best != best:
                    yield self._saved(BEST)
            yield Line(line)
            if validation or time.monotonic() - saved > CHECKPOINT_SECONDS or self._share() >= 1:
                yield self._saved(CHECKPOINT)
                saved = time.monotonic()
            yield RunProgress(TRAINING, self._share(), line, validation)

    def _saved(self, place: str) -> Kept:
        """Return a checkpoint with the state of training."""
        return Kept(place, checkpoint_files(self._algo, asdict(self._state)))

    def _share(self) -> float:
        budget, state = self._run.budget, self._state
        share = state.agent_steps / budget.most_steps
        return min(1.0, max(share, state.seconds / (60 * budget.minutes) if budget.minutes else 0.0))

    def _iterate(self) -> dict[str, Any]:
        """Train for an iteration; return the columns of progress.csv."""
        began = time.monotonic()
        interval = self._run.task_setting.environment.decision_interval
        self._algo.actions_left = (self._run.budget.most_steps - self._state.agent_steps) / interval
        result = self._algo.train()
        took = time.monotonic() - began
        runners = result["env_runners"]
        agent_steps = int(sum(runners["num_agent_steps_sampled_lifetime"].values()) * interval)
        speed = (agent_steps - self._state.agent_steps) / took
        self._state = replace(
            self._state,
            iteration=self._state.iteration + 1,
            agent_steps=agent_steps,
            seconds=self._state.seconds + took,
        )
        outcomes = runners.get("env", {})
        agents = self._run.task_setting.environment.agent_count
        returns = float(runners.get("episode_return_mean", np.nan)) / agents
        return {
            "iteration": self._state.iteration,
            "agent_steps": agent_steps,
            "seconds": round(self._state.seconds, 2),
            "agent_steps_per_second": round(speed),
            "return": round(returns, 4),
            "completion": round(float(outcomes.get("goal", np.nan)), 4),
            "collision": round(float(outcomes.get("collision", np.nan)), 4),
        }

    def _is_validation_due(self) -> bool:
        return self._due_validations() > self._state.validations

    def _due_validations(self) -> int:
        """Return how many validations are due by now."""
        return int(self._share() * self._run.task_setting.evaluation.validations)

    def _environment(self) -> Any:
        run = self._run
        given = {"scenarios": run.task_setting.task.validated_on, "discount": self._algo.config.gamma}
        return environment(run.task_setting, **given, policy=run.label)

    def _validate(self) -> Mapping[str, float]:
        """Play the validation episodes, and note whether the policy is the best so far."""
        with closing(self._environment()) as env:
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
            (float(np.mean(column)) for column in zip(*rows, strict=True)) if rows else (np.nan,) * 3
        )
        self._state = replace(self._state, validations=self._due_validations())
        best = self._state.best
        if valid and (best is None or (completion, -collision) > (best[0], -best[1])):
            self._state = replace(self._state, best=(completion, collision))
        return {
            "return": round(returns, 4),
            "completion": round(completion, 4),
            "collision": round(collision, 4),
        }


def _now() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%S%z")


class _Imports:
    """Paths that are imported wherever this is unpickled."""

    def __init__(self, paths: Sequence[str]) -> None:
        self._paths = tuple(paths)
        import_own(self._paths)

    def __reduce__(self):
        return _Imports, (self._paths,)


class OwnCodeRunner(JointEnvRunner):
    """Answers with errors of own code, which end the run; other errors end the runner, which is restarted."""

    def request(self, state: dict[str, Any] | ray.ObjectRef, steps: int, most: float = math.inf) -> Reply:
        """Take over weights and counters, return a fragment."""
        try:
            with named_own_code("the run's own code"):
                return super().request(state, steps, most)
        except OwnCodeError as error:
            failure = AlgorithmError(error.problem, place=error.place, remedy=error.remedy)
            return Reply(self.worker_index, failure, self.get_metrics())


def own_code_runner(paths: Sequence[str]) -> type[JointEnvRunner]:
    """Return the class of environment runners of a run with these files and folders of own code.

    RLlib's runners are actors, whose arguments name classes of the user's: Ray unpickles the actor's class
    first. This one is in no module, so it is pickled whole, with the paths.
    """
    return type("ImportingRunner", (OwnCodeRunner,), {"__module__": __name__, "imports": _Imports(paths)})
