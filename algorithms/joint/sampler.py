"""Environment plus policies to arrays, without Ray: what runners, evaluation and speed measurements use."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from gymnasium.spaces import Discrete
from torch import Generator

from algorithms.errors import EnvironmentFailure
from algorithms.joint.callbacks import EpisodeCallbacks
from algorithms.joint.env import LATENT, MEMORY, Bools, Ints, JointStep, VectorJointEnv, columns_of, name_of
from algorithms.joint.finite import non_finite
from algorithms.joint.masks import same_trajectory
from algorithms.joint.policies import Policies
from algorithms.joint.progress import Episode, EpisodeProgress
from algorithms.joint.rollout import JointRollout, View
from algorithms.joint.spaces import Action, learned_step, to_env
from algorithms.joint.spec import JointSpec
from algorithms.parts.distributions import Exploration, SampledActions

LATENTS = 1
"""Key of the random numbers that latents are drawn from."""


class Sampler:
    """Steps B environments with policies and accounts for their episodes.

    Args:
        env: The environments.
        policies: What acts.
        spec: Agents and groups.
        seed: Root seed of the episodes.
        source: (worker, restart_id), marks the rollouts. A sampler with another `restart_id` plays other
            episodes with other random actions; 0 plays those of `seed` itself.
        max_failures: Failures of one environment without a completed episode in between that stop the run.
        listener: Receives the episodes.
    """

    def __init__(
        self,
        env: VectorJointEnv,
        policies: Policies,
        spec: JointSpec,
        *,
        seed: int,
        source: tuple[int, int] = (0, 0),
        max_failures: int = 10,
        listener: EpisodeCallbacks | None = None,
    ) -> None:
        self._listener = listener
        self.env, self.policies, self.spec = env, policies, spec
        self._seed, self._source, self._max_failures = seed, source, max_failures
        self._generator = Generator().manual_seed(_mixed(seed, *source))
        self._has_latents = any(LATENT in block.observation for block in spec.spaces.blocks)
        self._now: Any = None  # a `View` once it has begun
        self._memories: list[np.ndarray | None] = []
        self.progress = EpisodeProgress.begin(np.zeros(env.num_envs, int), len(spec.agents))

    def begin(self, indices: Ints, *, stride: int = 0) -> None:
        """Start a new episode in every environment; see `VectorJointEnv.reset`."""
        step = learned_step(self.env.reset(_restarted(self._seed, self._source[1]), indices, stride=stride))
        step = self._finite_start(step)
        self.progress = EpisodeProgress.begin(
            self._indices(indices), len(self.spec.agents), stride, self.progress.failed_total
        )
        self._see(self._with_leaves(step, MEMORY, self._zeros(MEMORY)))
        every = np.arange(self.env.num_envs)
        if self._has_latents:
            self._draw_latents(every, self._zeros(LATENT))
        if self._listener is not None:
            self._listener.started(every)

    def fragment(
        self, steps: int, exploration: Exploration, most: float = math.inf, multiple: int = 1
    ) -> JointRollout:
        """Return the next `steps` steps of all environments; episodes continue from fragment to fragment.

        Args:
            steps: How many.
            exploration: How to act.
            most: Number of actions, of all agents, after which the fragment ends before that.
            multiple: Number of steps of which a fragment that ends earlier is made.

        Raises:
            EnvironmentFailure: An environment failed too often in a row.
        """
        count = self.env.num_envs
        spaces, now = self.spec.spaces, self._now
        if now is None:
            self.begin(self._source[0] * count + np.arange(count))
            now = self._now
        rollout = JointRollout.empty(spaces, steps, count, log_prob=self.policies.has_log_prob)
        rollout.source[:] = [(*self._source, b) for b in range(count)]
        rollout.start[:] = self.progress.steps
        rollout.views.write(0, now)
        rollout.views.alive[0] = now.alive
        taken = 0
        for t in range(steps):
            acting = self._act(self._now, exploration)
            for k, chosen in enumerate(acting):
                rollout.actions[k][t] = chosen.actions.numpy()
            if rollout.log_prob is not None:
                parts = [chosen.log_prob for chosen in acting if chosen.log_prob is not None]
                rollout.log_prob[t] = parts[0] if len(parts) == 1 else torch.cat(parts, 1)
            self._annotate(acting)
            step = self._step(self._in_env_units([actions[t] for actions in rollout.actions]))
            rollout.write(t, step)
            taken += int(rollout.views.alive[t].sum())
            if taken >= most and not (t + 1) % multiple:
                rollout = rollout.first(t + 1)
                break
        self._clear_inactive(rollout)
        return rollout.close()

    def episodes(self, indices: Ints, exploration: Exploration) -> list[Episode]:
        """Play the episodes of the given indices, dealt in turn to the environments.

        Args:
            indices: Episode indices, shape (c,), equally spaced.
            exploration: How to act.

        Returns:
            The episodes in the order of `indices`; an episode that failed in an environment which then
            continues with another index is missing.
        """
        count, last = self.env.num_envs, int(indices[-1])
        spacing = int(indices[1] - indices[0]) if len(indices) > 1 else 1
        self._generator.manual_seed(_mixed(self._seed, int(indices[0])))
        self.begin(indices[0] + spacing * np.arange(count), stride=spacing * count)
        finished: dict[int, Episode] = {}
        while (self.progress.episode_index <= last).any():
            acting = self._act(self._now, exploration)
            actions = self._in_env_units([chosen.actions.numpy() for chosen in acting])
            self._annotate(acting)
            self._step(actions)
            finished |= {episode.episode_index: episode for episode in self.take_episodes()}
        return [finished[index] for index in indices.tolist() if index in finished]

    def choose(self, exploration: Exploration) -> tuple[np.ndarray, ...]:
        """Return actions for where the environments stand, per block, in the environment's units."""
        return self._in_env_units([chosen.actions.numpy() for chosen in self._act(self._now, exploration)])

    def carry_out(self, actions: tuple[np.ndarray, ...]) -> None:
        """Step the environments by what `choose` returned."""
        self._step(actions)
        self.take_episodes()

    def take_episodes(self) -> list[Episode]:
        """Return the episodes that ended since the last call."""
        return self.progress.take()

    def get_state(self) -> dict[str, Any]:
        """Return all that an exactly continued run needs."""
        state = getattr(self.env, "get_state", lambda: None)()
        return {
            "generator": self._generator.get_state().numpy(),
            "env": state,
            "now": None if self._now is None else _copied(self._now),
            "progress": copy.deepcopy(self.progress),
            "source": self._source,
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue where `get_state` was called.

        With new episodes if the environments have no state, or there were others in number.
        """
        self._generator.set_state(torch.tensor(state["generator"]))
        if state["env"] is None or state["now"] is None or len(state["now"].alive) != self.env.num_envs:
            return
        self._source = state["source"]
        self.env.set_state(state["env"])  # type: ignore[attr-defined]
        self._now, self.progress = _copied(state["now"]), copy.deepcopy(state["progress"])
        if self._listener is not None:
            self._listener.started(np.arange(self.env.num_envs))

    def _indices(self, expected: Ints) -> Ints:
        """Return the indices that the environments play, by default the expected ones; a copy."""
        current = getattr(self.env, "worlds", None)
        return np.array(expected if current is None else current, int)

    def _in_env_units(self, actions: list[np.ndarray]) -> tuple[np.ndarray, ...]:
        return tuple(to_env(b.action, a) for b, a in zip(self.spec.spaces.blocks, actions, strict=True))

    def _act(self, view: View, exploration: Exploration) -> list[SampledActions]:
        acting = self.policies.act(view, exploration, self._generator)
        self._memories = [None if chosen.memory is None else chosen.memory.numpy() for chosen in acting]
        return acting

    def _annotate(self, acting: Sequence[SampledActions]) -> None:
        """Tell the environment what the next actions were sampled from, if it takes that."""
        annotate = getattr(self.env, "annotate", None)
        if annotate is None:
            return
        blocks = [
            _distribution_parts(block.action, chosen.distribution.numpy())
            for chosen, block in zip(acting, self.spec.spaces.blocks, strict=True)
        ]
        for name in ("probabilities", "mean", "std"):
            given = [parts.get(name) for parts in blocks]
            if any(each is not None for each in given):
                annotate(name, given)

    def _step(self, actions: tuple[np.ndarray, ...]) -> JointStep:
        before = self._now
        acted = before.alive.copy()
        step = self._with_leaves(
            self._fail_non_finite(learned_step(self.env.step(actions))), MEMORY, self._memories
        )
        over = self.progress.account(step, acted)
        if over.any():
            self._stop_at_failures(step)
            self.progress.episode_index = self._indices(self.progress.episode_index)
        self._see(step)
        self._forget(acted & same_trajectory(step.alive, step.terminated, step.truncated, over))
        if self._has_latents:
            self._draw_latents(np.flatnonzero(over), [leaves.get(LATENT) for leaves in before.observations])
            latents = [leaves.get(LATENT) for leaves in self._now.observations]
            step = self._with_leaves(step, LATENT, latents)
        if self._listener is not None:
            self._listener.stepped(step, acted)
        return step

    def _stop_at_failures(self, step: JointStep) -> None:
        """Raise if an environment fails time and again.

        Raises:
            EnvironmentFailure: It does.
        """
        for b, cause in step.failed.items():
            if self.progress.failures[b] > self._max_failures:
                raise EnvironmentFailure(
                    f"{self.progress.failures[b]} failures without a completed episode: {cause!r}",
                    place=f"environment {b}, a {name_of(self.env)}",
                    remedy="fix the environment, or raise `max_env_failures`",
                ) from cause

    def _zeros(self, name: str) -> list[np.ndarray | None]:
        """Return zeros (B, n, ...) for each block whose agents have a leaf of this name, None for others."""
        return [
            np.zeros((self.env.num_envs, len(block.agents), *block.observation[name].shape), np.float32)
            if name in block.observation
            else None
            for block in self.spec.spaces.blocks
        ]

    @staticmethod
    def _with_leaves(step: JointStep, name: str, parts: Sequence[np.ndarray | None]) -> JointStep:
        """Return the step with a leaf (B, n, ...) added to the observations of each block that has one."""
        if not any(part is not None for part in parts):
            return step
        seen = tuple(
            leaves if part is None else {**leaves, name: part}
            for leaves, part in zip(step.observations, parts, strict=True)
        )
        return step._replace(observations=seen)

    def _draw_latents(self, rows: Ints, latents: Sequence[np.ndarray | None]) -> None:
        """Show the latents (B, n, ...), redrawn for the episodes that begin in some environments.

        Each episode has a generator of its own: its latents do not depend on the number of environments.
        """
        view, root = self._now, _restarted(self._seed, self._source[1])
        for leaves, part in zip(view.observations, latents, strict=True):
            if part is not None:
                leaves[LATENT] = part.copy()
                leaves[LATENT][rows] = 0
        for b in rows.tolist():
            episode = int(self.progress.episode_index[b]), int(self.progress.number[b])
            generator = Generator().manual_seed(_mixed(root, *episode, LATENTS))
            drawn = self.policies.begin_episode(view[b : b + 1], generator)
            for leaves, latent in zip(view.observations, drawn, strict=True):
                if LATENT in leaves:
                    leaves[LATENT][b] = latent[0].numpy()

    def _forget(self, continues: Bools) -> None:
        """Empty the memory of agents whose trajectory ended, (B, N); rows handed out before keep it."""
        for leaves, columns in zip(self._now.observations, columns_of(self.spec.spaces.blocks), strict=True):
            if MEMORY in leaves:
                leaves[MEMORY] = np.where(continues[:, columns, None], leaves[MEMORY], 0)

    def _fail_non_finite(self, step: JointStep) -> JointStep:
        """Treat environments with NaN or infinite observations, states or rewards as failed."""
        broken = non_finite(step, self.spec.agents)
        if not broken:
            return step
        fresh = self._finite_start(learned_step(self.env.recreate(broken)))
        rewards = np.where(np.isfinite(step.rewards), step.rewards, 0)
        return step._replace(
            observations=fresh.observations,
            alive=fresh.alive,
            masks=fresh.masks,
            state=fresh.state,
            graph=fresh.graph,
            rewards=rewards,
            failed={**step.failed, **broken},
        )

    def _finite_start(self, step: JointStep) -> JointStep:
        """Return first moments without NaN or infinity: environments that begin with them are recreated."""
        attempts, broken = 1, non_finite(step, self.spec.agents)
        while broken:
            if attempts > self._max_failures:
                raise EnvironmentFailure(
                    f"environments {sorted(broken)} began {attempts} times in a row with NaN or infinity",
                    place=f"environment {name_of(self.env)}",
                    remedy="fix the environment: its reset gives non-finite observations or states",
                )
            self.progress.failed_total += len(broken)
            step = learned_step(self.env.recreate(broken))
            attempts, broken = attempts + 1, non_finite(step, self.spec.agents)
        return step

    def _see(self, step: JointStep) -> None:
        # Views of the environment's arrays, which it may reuse: valid until the next step.
        self._now = View(
            tuple(dict(leaves) for leaves in step.observations),
            step.alive,
            step.masks or (None,) * len(step.observations),
            step.state,
            step.graph,
        )

    def _clear_inactive(self, rollout: JointRollout) -> None:
        alive = rollout.views.alive[:-1]
        for actions, columns in zip(rollout.actions, columns_of(self.spec.spaces.blocks), strict=True):
            there = alive[..., columns]
            actions *= there.reshape(there.shape + (1,) * (actions.ndim - 3)).astype(actions.dtype)
        if rollout.log_prob is not None:
            rollout.log_prob *= alive


def _distribution_parts(space: Action, distribution: np.ndarray) -> dict[str, np.ndarray]:
    """Return what `annotate` takes of a block's distribution, by name; see `VectorJointEnv`."""
    if isinstance(space, Discrete):
        return {"probabilities": distribution}
    return {"mean": distribution[:, :, 0], "std": distribution[:, :, 1]}


def _copied(view: View) -> View:
    return View.concat([view, view[:0]], 0)


def _restarted(seed: int, restart_id: int) -> int:
    """Return the root seed, in [0, 2**63), of episodes that are not those before the restart."""
    if not restart_id:
        return seed
    return int(np.random.SeedSequence(seed, spawn_key=(restart_id,)).generate_state(1, np.uint64)[0] >> 1)


def _mixed(*numbers: int) -> int:
    return int(np.random.SeedSequence([n % 2**64 for n in numbers]).generate_state(1)[0])
