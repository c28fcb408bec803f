"""The RLlib environment runner: a `Sampler` behind RLlib's interface, with evaluation, metrics and state."""

from __future__ import annotations

import logging
import math
from collections import deque
from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any, NamedTuple

import numpy as np
import ray
from ray.rllib.core import COMPONENT_RL_MODULE
from ray.rllib.env.env_context import EnvContext
from ray.rllib.env.env_runner import EnvRunner
from ray.rllib.utils.checkpoints import Checkpointable
from ray.rllib.utils.metrics import (
    EPISODE_LEN_MEAN,
    EPISODE_RETURN_MAX,
    EPISODE_RETURN_MEAN,
    EPISODE_RETURN_MIN,
    NUM_AGENT_STEPS_SAMPLED,
    NUM_AGENT_STEPS_SAMPLED_LIFETIME,
    NUM_ENV_STEPS_SAMPLED,
    NUM_ENV_STEPS_SAMPLED_LIFETIME,
    NUM_EPISODES,
    NUM_EPISODES_LIFETIME,
    WEIGHTS_SEQ_NO,
)

from algorithms.errors import AlgorithmError
from algorithms.joint.adapter import JointVector
from algorithms.joint.callbacks import EpisodeCallbacks
from algorithms.joint.config import JointConfig
from algorithms.joint.env import Floats, Ints, VectorJointEnv, is_vector_env
from algorithms.joint.episode_indices import FIRST_VALIDATION_EPISODE
from algorithms.joint.making import creator_of
from algorithms.joint.metrics import EPISODE_MEAN
from algorithms.joint.policies import Policies
from algorithms.joint.progress import Episode
from algorithms.joint.rollout import JointRollout
from algorithms.joint.sampler import Sampler
from algorithms.joint.spec import SPEC, agent_spaces
from algorithms.joint.threads import torch_threads

logger = logging.getLogger(__name__)

SAMPLERS = "samplers"
"""Key of the samplers' states; each belongs to one process, and others ignore it."""
RECENT = "recent"
"""Key of the episodes, within a sampler's state, over which results are smoothed."""
GREEDY, SAMPLED = "greedy", "sampled"
"""Names of both modes of play in an evaluation of both."""
FAILED_ENVS = "num_failed_envs_lifetime"


class Reply(NamedTuple):
    """A runner's answer to a request.

    Attributes:
        worker: Index of the runner, so that results can be put in order.
        data: A fragment, or the error that stops the run; to a request to evaluate: the episodes.
        metrics: RLlib metrics of the data.
    """

    worker: int
    data: Any
    metrics: Any


class JointEnvRunner(EnvRunner, Checkpointable):
    """Steps B environments with one batched forward pass per step."""

    config: JointConfig  # type: ignore[assignment]

    def __init__(self, *, config: JointConfig, **kwargs: Any) -> None:
        super().__init__(config=config, **kwargs)
        self.worker_index = self.worker_index or 0
        self._given_spaces = kwargs.get("spaces")
        self._sampler: Sampler | None = None
        self._own_evaluation_env: VectorJointEnv | None = None
        self._policies: Policies | None = None
        self._weights = -1
        self._evaluated = 0
        # Results pool the windows of all runners.
        episodes, runners = (
            int(config.metrics_num_episodes_for_smoothing or 1),
            max(int(self.num_workers or 0), 1),
        )
        self._recent: deque[Episode] = deque(maxlen=ceil(episodes / runners))
        self.module: Any = None
        self.num_env_steps_sampled_lifetime = 0
        self.make_env()

    def make_env(self) -> None:
        """Create the environments, unless this is the local runner beside remote ones."""
        if self._has_env():
            self.env: VectorJointEnv | None = self._new_env()
            self.spec = self.config.spec_of(self.env)
        else:
            self.spec = self._given_spaces[SPEC][0]  # type: ignore[index]

    def make_module(self) -> None:
        """Build the inference part of the policies.

        Done at first use, after the algorithm has checked the spaces: an error in the constructor of a remote
        runner would surface only as an actor that died.
        """
        if self.module is None:
            spec = self.config.get_multi_rl_module_spec(spaces=self.get_spaces(), inference_only=True)
            self.module = spec.build()
            self._policies = Policies(self.spec, {g.id: self.module[g.id] for g in self.spec.groups})

    def request(self, state: dict[str, Any] | ray.ObjectRef, steps: int, most: float = math.inf) -> Reply:
        """Set weights and counters and return a fragment, in one round trip: weights are never stale.

        Args:
            state: Of the algorithm.
            steps: Steps of each environment.
            most: Number of actions after which the fragment ends before that.
        """
        self.set_state(ray.get(state) if isinstance(state, ray.ObjectRef) else state)
        try:
            rollout = self._sample_fragment(steps, most=most)
        except AlgorithmError as failure:
            # Raised here, it would count as the actor's death, and the actor would be restarted forever.
            return Reply(self.worker_index, failure, self.get_metrics())
        return Reply(self.worker_index, rollout, self.get_metrics())

    def sample(  # type: ignore[override]
        self,
        *,
        num_timesteps: int | None = None,
        num_episodes: int | None = None,
        explore: bool | None = None,
        force_reset: bool = False,
    ) -> Sequence[JointRollout | Episode]:
        """Return a fragment, or exactly `num_episodes` episodes of the evaluation list (RLlib).

        Without numbers, an evaluation runner plays the next episodes of its list, one for each environment.
        Fragments continue the episodes of the fragment before; `force_reset` is for evaluations.
        """
        num_envs = int(self.config.num_envs_per_env_runner or 1)
        if num_episodes is None and (num_timesteps is not None or not self.config.in_evaluation):
            asked = self.config.rollout_fragment_length if num_timesteps is None else num_timesteps / num_envs
            return [self._sample_fragment(ceil(asked), explore)]
        if force_reset or (num_episodes is not None and self.worker_index == 0):
            self._evaluated = 0
        # Its share of the fixed list: with W runners it plays every W-th index of it.
        count, runners = num_envs if num_episodes is None else num_episodes, max(self.num_workers or 0, 1)
        first = max(self.worker_index - 1, 0) + runners * self._evaluated
        self._evaluated += count
        return self._play_listed(range(first, first + runners * count, runners), explore)

    def evaluate_share(self, shares: Mapping[int, range]) -> Reply:
        """Play this runner's share of an evaluation.

        Args:
            shares: Places in the evaluation list, by the index of the runner.
        """
        episodes = self._play_listed(shares[self.worker_index])
        return Reply(self.worker_index, episodes, self.get_metrics())

    def play(
        self,
        indices: Ints,
        *,
        explore: bool,
        env: VectorJointEnv | None = None,
        seed: int | None = None,
    ) -> list[Episode]:
        """Play one episode per index in a separate environment; training episodes are not interrupted.

        Args:
            indices: Episode indices, shape (c,), equally spaced.
            explore: Sample actions as in training, or act greedily.
            env: Environment to play in instead, with the agents and spaces of the training; left open.
            seed: Root seed of the episodes and of action sampling, by default the config's.

        Raises:
            SpaceError: `env` has other agents or spaces.
        """
        evaluator = self._new_sampler(self._evaluation_env(env), restart_id=0, seed=seed)
        exploration = self.config.exploration(self.num_env_steps_sampled_lifetime)._replace(explore=explore)
        with torch_threads(self.config.torch_threads):
            return evaluator.episodes(indices, exploration)

    def get_metrics(self) -> Any:
        """Return and clear what was logged since the last call."""
        return self.metrics.reduce()

    def get_spaces(self) -> dict[str, Any]:
        """Return {group: (observation space, action space)}, and the `JointSpec` under its own key."""
        return {SPEC: (self.spec, None), **{g.id: agent_spaces(g) for g in self.spec.groups}}

    def assert_healthy(self) -> None:
        """Return: a runner that exists is healthy (RLlib)."""

    def stop(self) -> None:
        """Close the environments."""
        training = self.env if self._sampler is None else self._sampler.env
        for env in (training, self._own_evaluation_env):
            if env is not None:
                env.close()

    def get_state(self, components=None, *, not_components=None, **kwargs: Any) -> dict[str, Any]:
        """Return weights and counters (RLlib); where the episodes are is `sampler_state`."""
        state: dict[str, Any] = {NUM_ENV_STEPS_SAMPLED_LIFETIME: self.num_env_steps_sampled_lifetime}
        if self._check_component(COMPONENT_RL_MODULE, components, not_components):
            self.make_module()
            state[COMPONENT_RL_MODULE] = self.module.get_state(
                components=self._get_subcomponents(COMPONENT_RL_MODULE, components),
                not_components=self._get_subcomponents(COMPONENT_RL_MODULE, not_components),
                **kwargs,
            )
            state[WEIGHTS_SEQ_NO] = self._weights
        return state

    def sampler_state(self) -> dict[tuple[bool, int], Any]:
        """Return the sampler's state under this process's key, nothing before the first fragment."""
        if self._sampler is None:
            return {}
        return {self._key(): self._sampler.get_state() | {RECENT: list(self._recent)}}

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore weights, counters and the state of this process's own sampler.

        RLlib hands a restarted runner the local runner's state, and an evaluation runner a training runner's;
        hence what belongs to one process is keyed by that process.
        """
        # Not `<` as in stock runners: after an in-place restore the older weights are the right ones.
        if COMPONENT_RL_MODULE in state and state.get(WEIGHTS_SEQ_NO, 0) != self._weights:
            self.make_module()
            weights = state[COMPONENT_RL_MODULE]
            self.module.set_state(ray.get(weights) if isinstance(weights, ray.ObjectRef) else weights)
            self._weights = state.get(WEIGHTS_SEQ_NO, 0)
            if self._policies is not None:
                self._policies.refresh()
        if NUM_ENV_STEPS_SAMPLED_LIFETIME in state:
            self.num_env_steps_sampled_lifetime = int(state[NUM_ENV_STEPS_SAMPLED_LIFETIME])
            for module in self.module.values() if self.module is not None else ():
                module.exploration = self.config.exploration(self.num_env_steps_sampled_lifetime)
        own = state.get(SAMPLERS, {}).get(self._key())
        if own is not None and self._has_env():
            self._sampler = None  # it would continue episodes that are not the state's
            self._training_sampler().set_state(own)
            self._recent = deque(own.get(RECENT, ()), maxlen=self._recent.maxlen)

    def get_ctor_args_and_kwargs(self) -> tuple[tuple, dict[str, Any]]:
        """Return how to build this runner again (RLlib)."""
        return (), {"config": self.config}

    def get_checkpointable_components(self) -> list[tuple[str, Any]]:
        """Return the parts with a state of their own (RLlib)."""
        self.make_module()
        return [(COMPONENT_RL_MODULE, self.module)]

    def _key(self) -> tuple[bool, int]:
        return bool(self.config.in_evaluation), self.worker_index

    def _has_env(self) -> bool:
        local_beside_remote = self.worker_index == 0 and self.num_workers > 0
        return self.config.env is not None and (not local_beside_remote or self._given_spaces is None)

    def _new_env(self) -> VectorJointEnv:
        return self.config.adapt(self._plain_env())

    def _plain_env(self) -> VectorJointEnv:
        num_envs = int(self.config.num_envs_per_env_runner or 1)

        def context(b: int) -> EnvContext:
            return EnvContext(
                {**self.config.env_config, "num_envs": num_envs},
                worker_index=self.worker_index,
                num_workers=self.num_workers,
                vector_index=b,
            )

        create = creator_of(self.config.env)
        first: Any = create(context(0))
        if is_vector_env(first):
            return first
        spare = [first]  # made only to see which interface it has
        limit = self.config.max_env_failures
        return JointVector(
            lambda b: spare.pop() if spare else create(context(b)), num_envs, max_failures=limit
        )

    def _training_sampler(self) -> Sampler:
        if self._sampler is None:
            if self.env is None:
                self.env = self._new_env()
            # Ray restarts an actor with its first arguments, so only the steps made so far tell a restarted
            # runner from a new one; it must not replay its predecessor's episodes and noise.
            callbacks = EpisodeCallbacks(self)
            self._sampler = self._new_sampler(
                self.env, self.num_env_steps_sampled_lifetime, listener=callbacks or None
            )
        return self._sampler

    def _new_sampler(
        self,
        env: VectorJointEnv,
        restart_id: int,
        *,
        seed: int | None = None,
        listener: EpisodeCallbacks | None = None,
    ) -> Sampler:
        self.make_module()
        worker = max(self.worker_index - 1, 0)
        return Sampler(
            env,
            self._policies,  # type: ignore[arg-type]
            self.spec,
            seed=(self.config.seed or 0) if seed is None else seed,
            source=(worker, restart_id),
            max_failures=self.config.max_env_failures,
            listener=listener,
        )

    def _evaluation_env(self, given: VectorJointEnv | None) -> VectorJointEnv:
        """Return the environment given, as the agents see it, by default one that is kept for evaluation."""
        if given is None:
            self._own_evaluation_env = self._own_evaluation_env or self._new_env()
            return self._own_evaluation_env
        return self.config.fitting(given, self.spec)

    def _sample_fragment(
        self, steps: int, explore: bool | None = None, most: float = math.inf
    ) -> JointRollout:
        sampler = self._training_sampler()
        failures = sampler.progress.failed_total
        exploration = self.config.exploration(self.num_env_steps_sampled_lifetime)
        explore = self.config.explore if explore is None else explore
        with torch_threads(self.config.torch_threads):
            exploration = exploration._replace(explore=bool(explore))
            multiple = int(self.config.sequence_length) if self.config.gru else 1  # of whole sequences
            rollout = sampler.fragment(steps, exploration, most, multiple)
        self.num_env_steps_sampled_lifetime += rollout.env_steps()
        self._log(rollout, sampler.progress.failed_total - failures)
        ended = sampler.take_episodes()
        self._recent.extend(ended)
        self._log_episodes(ended, self._recent)
        return rollout

    def _play_listed(self, places: range, explore: bool | None = None) -> list[Episode]:
        """Play the episodes at these places of the evaluation list, and log their results."""
        indices = FIRST_VALIDATION_EPISODE + np.array(places)
        if explore is None:
            # Without a group for evaluation, RLlib evaluates on a training runner, by the training's config.
            own = self.config if self.config.in_evaluation else self.config.get_evaluation_config_object()
            explore = bool((own or self.config).explore)
        episodes = self.play(indices, explore=explore)
        self._log_episodes(episodes, episodes)
        if self.config.evaluate_sampled and not explore:
            totals = [float(episode.returns.sum()) for episode in self.play(indices, explore=True)]
            self._log_mean((SAMPLED, EPISODE_RETURN_MEAN), totals)
            self._log_mean((GREEDY, EPISODE_RETURN_MEAN), [float(e.returns.sum()) for e in episodes])
        self.metrics.log_value(NUM_ENV_STEPS_SAMPLED, sum(e.length for e in episodes), reduce="sum")
        return episodes

    def _log(self, rollout: JointRollout, failures: int) -> None:
        metrics, steps = self.metrics, rollout.env_steps()
        by_agent = dict(zip(self.spec.agents, rollout.views.alive[:-1].sum((0, 1)).tolist(), strict=True))
        metrics.log_value(NUM_ENV_STEPS_SAMPLED, steps, reduce="sum")
        metrics.log_value(NUM_ENV_STEPS_SAMPLED_LIFETIME, steps, reduce="lifetime_sum", with_throughput=True)
        metrics.log_dict(by_agent, key=NUM_AGENT_STEPS_SAMPLED, reduce="sum")
        metrics.log_dict(by_agent, key=NUM_AGENT_STEPS_SAMPLED_LIFETIME, reduce="lifetime_sum")
        metrics.log_value(FAILED_ENVS, failures, reduce="lifetime_sum")

    def _log_episodes(self, episodes: Sequence[Episode], recent: Sequence[Episode]) -> None:
        """Count the episodes that ended, and report means over the recent ones.

        Means are taken here, once a fragment: RLlib's windows are slow to fill one by one, and show NaN in
        iterations in which no episode ends. They carry their number of episodes, see `EpisodeMean`.
        """
        metrics = self.metrics
        metrics.log_value(NUM_EPISODES, len(episodes), reduce="sum")
        metrics.log_value(NUM_EPISODES_LIFETIME, len(episodes), reduce="lifetime_sum")
        if not recent:
            return
        returns = np.stack([episode.returns for episode in recent])
        totals = returns.sum(1)
        metrics.log_value(EPISODE_RETURN_MIN, float(totals.min()), reduce="min")
        metrics.log_value(EPISODE_RETURN_MAX, float(totals.max()), reduce="max")
        self._log_mean(EPISODE_RETURN_MEAN, totals)
        self._log_mean(EPISODE_LEN_MEAN, [episode.length for episode in recent])
        for agent, own in zip(self.spec.agents, returns.T, strict=True):
            self._log_mean(("agent_episode_returns_mean", agent), own)
        for name in sorted({name for episode in recent for name in episode.metrics}):
            values = [episode.metrics[name] for episode in recent if name in episode.metrics]
            self._log_mean(("env", name), values)

    def _log_mean(self, key: str | tuple[str, ...], values: Floats | Sequence[float]) -> None:
        self.metrics.log_value(key, (float(np.mean(values)), len(values)), reduce=EPISODE_MEAN)
