"""The RLlib algorithm: one training step for on-policy and off-policy learning, and its state."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, ClassVar, NoReturn

import ray
from ray import cloudpickle
from ray.exceptions import RayActorError
from ray.rllib.algorithms.algorithm import Algorithm
from ray.rllib.core import COMPONENT_LEARNER, COMPONENT_RL_MODULE, DEFAULT_MODULE_ID
from ray.rllib.utils.metrics import (
    ENV_RUNNER_RESULTS,
    EVALUATION_RESULTS,
    LEARNER_RESULTS,
    NUM_ENV_STEPS_SAMPLED_LIFETIME,
    WEIGHTS_SEQ_NO,
)

from algorithms.errors import (
    AlgorithmError,
    DamagedCheckpointError,
    LearnerFailure,
    RunnerFailure,
    SpaceError,
)
from algorithms.joint.config import JointConfig
from algorithms.joint.data_parallel import FAILURE
from algorithms.joint.learner import JointTorchLearner
from algorithms.joint.making import check_environment
from algorithms.joint.rollout import JointRollout
from algorithms.joint.runner import SAMPLERS, JointEnvRunner, Reply
from algorithms.joint.signature import SEQUENCES, check_signature
from algorithms.joint.spec import SPEC, JointSpec, check_spaces
from algorithms.joint.training_data import JointTrainingData

logger = logging.getLogger(__name__)

SIGNATURE = "checkpoint_signature"
KILLED = "num_hung_env_runners_killed"
RESTART_POLL = 0.2
"""Time between two looks whether a lost runner is back [s]."""
LONGEST_RESTART = 60.0
"""Time for a lost runner to come back where `sample_timeout_s` is None [s]."""
LEARNER_ANSWERS = 10.0
"""Time for the other learners to show that they are there, after one of them failed [s]."""


class JointAlgorithm(Algorithm):
    """Asks runners for fragments, in one round trip with the weights, and learns from what comes back.

    An algorithm subclasses it and names its config and its learner:

        class PPO(JointAlgorithm):
            config_class = PPOConfig
            learner_class = PPOLearner
    """

    config_class: ClassVar[type[JointConfig]]
    learner_class: ClassVar[type[JointTorchLearner]]
    runner_class: ClassVar[type[JointEnvRunner]] = JointEnvRunner
    config: JointConfig  # type: ignore[assignment]
    env_runner_group: Any
    learner_group: Any
    actions_left: float = math.inf
    """Number of actions, of all agents, to which the next fragment is cut; set before `train`."""
    _evaluated = 0
    """Place in the evaluation list of the next episode, where evaluations do not begin again."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Name the algorithm in its config."""
        super().__init_subclass__(**kwargs)
        if "config_class" in vars(cls):
            # A function: Ray walks the attributes of a class, without end where classes name each other.
            cls.config_class.algorithm_class = staticmethod(lambda: cls)

    @classmethod
    def get_default_config(cls) -> JointConfig:
        """Return the defaults (RLlib, which rebuilds configs from them)."""
        return cls.config_class(cls)

    def setup(self, config: JointConfig) -> None:  # type: ignore[override]
        """Check settings of evaluation and spaces, then build runners and networks (RLlib).

        RLlib starts Ray before it makes an environment; so one is made and checked before, unless Ray runs.

        Raises:
            SpaceError: There is no environment, or the algorithm cannot handle it; evaluations have another
                one with other agents or spaces.
            ValueError: A setting for evaluation is out of its range.
        """
        if self.config.env is None:
            raise SpaceError(
                "there is no environment",
                place=f"config of {self.config.algorithm!r}",
                remedy="give one: .environment(...)",
            )
        for_evaluation = self.config.get_evaluation_config_object()
        if for_evaluation is not None:
            for_evaluation.validate()
        if not ray.is_initialized():
            check_environment(self.config, self.runner_class)
        super().setup(config)
        if self.eval_env_runner_group is not None:
            spaces: Any = self.eval_env_runner_group.get_spaces()
            check_spaces(spaces[SPEC][0], self.spec, place="evaluation(evaluation_config=...)")

    @property
    def spec(self) -> JointSpec:
        """Agents and groups."""
        spaces: Any = self.env_runner_group.get_spaces() if self.spaces is None else self.spaces
        return spaces[SPEC][0]

    def training_step(self) -> None:
        """Sample with the newest weights, then learn (RLlib).

        Raises:
            RunnerFailure: No environment runner answers.
            LearnerFailure: A learner's process is lost, or weights are not finite any more.
        """
        replies = self._replies()
        self.metrics.aggregate([reply.metrics for reply in replies], key=ENV_RUNNER_RESULTS)
        rollouts: list[JointRollout] = []
        for reply in sorted(replies, key=lambda r: r.worker):
            if isinstance(reply.data, AlgorithmError):
                raise reply.data
            rollouts.append(reply.data)
        steps = {NUM_ENV_STEPS_SAMPLED_LIFETIME: self._steps()}
        shortest = min(len(rollout.rewards) for rollout in rollouts)  # they differ at the end of a budget
        data: Any = JointRollout.concat([rollout.first(shortest) for rollout in rollouts])
        if self.config.num_learners:
            data = ray.put(data)
        self.metrics.aggregate(self._update(JointTrainingData(data), steps), key=LEARNER_RESULTS)

    def get_state(self, components=None, *, not_components=None, **kwargs: Any) -> dict[str, Any]:
        """Return RLlib's state, where every sampler stands, and what the state fits (RLlib)."""
        state = super().get_state(components, not_components=not_components, **kwargs)
        state[SIGNATURE] = self._signature()
        if self._check_component(SAMPLERS, components, not_components):
            states = self.env_runner_group.foreach_env_runner(
                _sampler_state, local_env_runner=not self.config.num_env_runners
            )
            state[SAMPLERS] = {key: value for part in states for key, value in part.items()}
        return state

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore (RLlib).

        Raises:
            CheckpointError: The state is of another algorithm, of other agents, spaces or groups, or of
                networks built from other settings.
        """
        if SIGNATURE in state:
            self._check_signature(state[SIGNATURE])
        super().set_state(state)
        if state.get(SAMPLERS):
            self.env_runner_group.foreach_env_runner(
                partial(_restore_sampler, samplers=state[SAMPLERS], steps=self._steps()),
                local_env_runner=not self.config.num_env_runners,
                timeout_seconds=self.config.sample_timeout_s,
            )

    def restore_from_path(self, path: Any, *args: Any, **kwargs: Any) -> None:
        """Restore from a checkpoint folder (RLlib), after checking that it fits before any weight is touched.

        Raises:
            CheckpointError: The checkpoint is of another algorithm, of other agents, spaces or groups, or of
                networks built from other settings.
            DamagedCheckpointError: A file cannot be read.
        """
        folder = Path(getattr(path, "path", path))
        try:
            self._check_signature(_stored_signature(folder / f"{self.STATE_FILE_NAME}.pkl"))
            super().restore_from_path(path, *args, **kwargs)
        except (OSError, EOFError, UnpicklingError) as error:
            raise DamagedCheckpointError(
                f"a file is missing or damaged: {error!r}",
                place=f"checkpoint {folder}",
                remedy="continue from another checkpoint",
            ) from error

    def get_module(self, module_id: str = DEFAULT_MODULE_ID) -> Any:
        """Return a policy with the newest weights, as the local runner holds it, or None (RLlib)."""
        self.env_runner_group.local_env_runner.set_state(self.runner_state())
        return super().get_module(module_id)

    def restore_env_runners(self, env_runner_group: Any) -> list[int]:
        """Take runners that came back into the group again (RLlib).

        Requests for data and evaluations bring weights and counters. RLlib's own method copies the networks
        of the local runner, which builds them at first use.
        """
        return env_runner_group.probe_unhealthy_env_runners()

    def _evaluate_with_fixed_duration(self) -> tuple[None, int, int, list[Any]]:
        """Play the evaluation list on the runners for evaluation (RLlib).

        A share that is not answered is dealt again. RLlib asks the other runners for as many episodes, which
        would be other ones, and may ask for none forever.

        Returns:
            Nothing, steps of environments and of agents, nothing.
        """
        group, config = self.eval_env_runner_group, self.config
        duration: Any = config.evaluation_duration
        first = 0 if config.evaluation_force_reset_envs_before_iteration else self._evaluated
        self._evaluated = end = first + int(duration)
        count = max(group.num_healthy_remote_workers(), 1)
        waiting = [range(start, end, count) for start in range(first, min(first + count, end))]
        results: list[Reply] = []
        while waiting and (healthy := group.healthy_worker_ids()):
            shares = dict(zip(healthy, waiting, strict=False))
            replies = group.foreach_env_runner(
                "evaluate_share",
                kwargs={"shares": shares},
                local_env_runner=False,
                remote_worker_ids=[*shares],
                timeout_seconds=config.evaluation_sample_timeout_s,
            )
            results += replies
            for reply in replies:
                waiting.remove(shares[reply.worker])
            if not replies and healthy == group.healthy_worker_ids():
                break
        if waiting:
            missing = sum(len(share) for share in waiting)
            logger.warning("%d episodes of an evaluation were not played: no runner answered", missing)
        self.metrics.aggregate(
            [result.metrics for result in results], key=(EVALUATION_RESULTS, ENV_RUNNER_RESULTS)
        )
        episodes = [episode for result in results for episode in result.data]
        return None, sum(e.env_steps() for e in episodes), sum(e.agent_steps() for e in episodes), []

    def _replies(self) -> list[Reply]:
        """Return at least one runner's reply; while all are lost, wait for those that Ray restarts.

        Raises:
            RunnerFailure: No request was answered, however often it was repeated.
        """
        requests = self.config.max_silent_iterations
        for _ in range(requests):
            if replies := self._ask():
                return replies
            self._await_runner()
        raise RunnerFailure(
            f"no environment runner has answered {requests} requests",
            place="environment runners",
            remedy="see their logs; raise `sample_timeout_s` if fragments take longer",
        )

    def _await_runner(self) -> None:
        """Wait until a runner is there, for `sample_timeout_s` at most: a restart takes seconds."""
        group = self.env_runner_group
        limit = self.config.sample_timeout_s if self.config.restart_failed_env_runners else 0.0
        deadline = time.monotonic() + (LONGEST_RESTART if limit is None else limit)
        while not group.num_healthy_remote_workers() and time.monotonic() < deadline:
            time.sleep(RESTART_POLL)
            if restored := self.restore_env_runners(group):
                self._make_on_env_runners_recreated_callbacks(
                    config=self.config, env_runner_group=group, restored_env_runner_indices=restored
                )

    def _ask(self) -> list[Reply]:
        """Return the replies of runners that answer in time; others are killed and come back."""
        group = self.env_runner_group
        state = self.runner_state()
        steps = int(self.config.rollout_fragment_length)
        if not self.config.num_env_runners:
            return [group.local_env_runner.request(state, steps, self.actions_left)]
        asked = set(group.healthy_worker_ids())
        most = self.actions_left / max(len(asked), 1)
        replies = group.foreach_env_runner(
            "request",
            kwargs={"state": ray.put(state), "steps": steps, "most": most},
            local_env_runner=False,
            timeout_seconds=self.config.sample_timeout_s,
        )
        # RLlib leaves a runner that times out in its group, healthy, with its requests queueing up.
        hung = (asked & set(group.healthy_worker_ids())) - {reply.worker for reply in replies}
        for worker in sorted(hung):
            logger.warning(
                "environment runner %d did not answer in %s s: killed", worker, self.config.sample_timeout_s
            )
            ray.kill(group._worker_manager.actors()[worker], no_restart=False)
            group._worker_manager.set_actor_state(worker, healthy=False)
        self.metrics.log_value(KILLED, len(hung), reduce="lifetime_sum")
        return list(replies)

    def runner_state(self) -> dict[str, Any]:
        """Return weights and counters as runners take them over."""
        try:
            weights = self.learner_group.get_state(
                components=f"{COMPONENT_LEARNER}/{COMPONENT_RL_MODULE}", inference_only=True
            )[COMPONENT_LEARNER]
        except RayActorError:
            self._fail({0: "its process is lost"})  # the first one is asked
        return {
            COMPONENT_RL_MODULE: weights[COMPONENT_RL_MODULE],
            WEIGHTS_SEQ_NO: weights[WEIGHTS_SEQ_NO],
            NUM_ENV_STEPS_SAMPLED_LIFETIME: self._steps(),
        }

    def _update(self, data: JointTrainingData, timesteps: dict[str, int]) -> list[Any]:
        """Return the metrics of all learners, after each has learned.

        Raises:
            LearnerFailure: One has failed; the others, which wait for its gradients, are ended.
        """
        if not self.config.num_learners:
            return self.learner_group.update(training_data=data, timesteps=timesteps)
        workers = self.learner_group._workers
        numbers = {
            worker.update.remote(training_data=shard, timesteps=timesteps): number
            for number, (worker, (shard, _)) in enumerate(
                zip(workers, data.shard(num_shards=len(workers)), strict=True)
            )
        }
        results: dict[int, Any] = {}
        failures: dict[int, str] = {}
        waiting = list(numbers)
        while waiting:
            done, waiting = ray.wait(waiting, timeout=LEARNER_ANSWERS if failures else None)
            if not done:
                break
            (number,) = (numbers[ref] for ref in done)
            try:
                results[number] = ray.get(done[0])
            except RayActorError:
                failures[number] = "its process is lost"
            else:
                if FAILURE in results[number]:
                    failures[number] = results[number][FAILURE]
        if failures:
            self._fail(dict(sorted(failures.items())))
        return [results[number] for number in sorted(results)]

    def _fail(self, reasons: Mapping[int, str]) -> NoReturn:
        """End all learners, since no learner can work without the others, and raise.

        Args:
            reasons: What happened, by the learner's number.
        """
        for worker in self.learner_group._workers:
            ray.kill(worker)
        said = "; ".join(f"learner {number}: {reason}" for number, reason in reasons.items())
        raise LearnerFailure(
            f"{said} (of {self.config.num_learners})",
            place="learners",
            remedy="see their logs; continue from the last checkpoint, with any number of learners",
        )

    def _steps(self) -> int:
        return int(self.metrics.peek((ENV_RUNNER_RESULTS, NUM_ENV_STEPS_SAMPLED_LIFETIME), default=0))

    def _signature(self) -> dict[str, Any]:
        signature = {**self.config.checkpoint_signature(), **self.spec.describe()}
        if self.config.gru and getattr(self.config, "checkpoint_replay", False):
            signature[SEQUENCES] = self.config.sequence_length
        return signature

    def _check_signature(self, stored: dict[str, Any] | None) -> None:
        if stored is not None:
            check_signature(stored, self._signature())


def _sampler_state(runner: JointEnvRunner) -> dict[Any, Any]:
    return runner.sampler_state()


def _restore_sampler(runner: Any, samplers: dict[Any, Any], steps: int) -> None:
    runner.set_state({NUM_ENV_STEPS_SAMPLED_LIFETIME: steps, SAMPLERS: samplers})


def _stored_signature(file: Path) -> dict[str, Any] | None:
    """Return what a checkpoint says it fits, or None where the file is not local."""
    if not file.is_file():
        return None
    with file.open("rb") as stream:
        return cloudpickle.load(stream).get(SIGNATURE)
