"""Environment plus policies to arrays, without Ray: what runners, evaluation and speed measurements use."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from gymnasium.spaces import Discrete
from torch import Generator

from algorithms.errors import EnvironmentFailure
from algorithms.joint.env import MEMORY, Bools, Floats, Ints, JointStep, VectorJointEnv
from algorithms.joint.finite import non_finite
from algorithms.joint.masks import goes_on
from algorithms.joint.policies import Policies
from algorithms.joint.rollout import JointRollout, View
from algorithms.joint.spaces import to_env
from algorithms.joint.spec import JointSpec
from algorithms.parts.distributions import Exploration, SampledActions


class Episode(NamedTuple):
    """An episode that ended.

    Attributes:
        copy: Copy that played it.
        length: Steps.
        returns: Undiscounted sum of rewards of each agent, (N,).
        metrics: Numbers that the environment reported.
        world: World of the episode, where it was asked for by world.
    """

    copy: int
    length: int
    returns: Floats
    metrics: Mapping[str, float]
    world: int = -1

    def env_steps(self) -> int:
        """Return the number of steps (RLlib asks for it)."""
        return self.length

    def agent_steps(self) -> int:
        """Return the number of agent-steps (RLlib asks for it), as if all agents had lived throughout."""
        return self.length * len(self.returns)


class EvaluatedStep(NamedTuple):
    """One step of all copies in an evaluation, handed over before the next step reuses the arrays.

    Attributes:
        playing: World of the episode each copy plays, -1 if it idles, (B,).
        view: What the agents saw, leading axis (B,).
        distributions: Per block, what the actions were sampled from; see `SampledActions.distribution`.
        actions: Per block, in the environment's units.
        step: What the environment answered.
    """

    playing: Ints
    view: View
    distributions: tuple[np.ndarray, ...]
    actions: tuple[np.ndarray, ...]
    step: JointStep


class Listener(Protocol):
    """Is told about the episodes of a sampler."""

    def started(self, rows: Ints) -> None:
        """Hear that these copies began new episodes."""
        ...

    def stepped(self, step: JointStep, acted: Bools) -> None:
        """Hear of a step, and who acted in it, (B, N), before anybody acts again."""
        ...


@dataclass
class Progress:
    """Where each copy stands in its present episode.

    Attributes:
        returns: Sum of rewards so far, (B, N).
        lengths: Steps so far, (B,).
        steps: Steps since the sampler began, (B,).
        failures: Failures since the last completed episode, (B,).
        failed_total: All failures so far.
        ended: Episodes completed since they were last taken.
    """

    returns: Floats
    lengths: Ints
    steps: Ints
    failures: Ints
    failed_total: int = 0
    ended: list[Episode] = field(default_factory=list)


class Sampler:
    """Steps an environment with policies and keeps the books of its episodes.

    Args:
        env: B copies.
        policies: What acts.
        spec: Agents and groups.
        seed: Root seed of the episodes.
        source: (worker, restart_id), marks the rollouts. A sampler with another `restart_id` plays other
            episodes with other random actions; 0 plays those of `seed` itself.
        max_failures: Failures of one copy without a completed episode in between before the run is stopped.
        listener: Who is told about the episodes.
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
        listener: Listener | None = None,
    ) -> None:
        self._listener = listener
        self.env, self.policies, self._spec = env, policies, spec
        self._seed, self._source, self._max_failures = seed, source, max_failures
        self._generator = Generator().manual_seed(_mixed(seed, *source))
        self._now: View | None = None
        self._memories: list[np.ndarray | None] = []
        agents = len(spec.agents)
        self.progress = _fresh_progress(env.num_envs, agents)

    def begin(self, worlds: Ints, *, stride: int = 0) -> None:
        """Start all copies in new episodes; see `VectorJointEnv.reset`."""
        step = self.env.reset(_restarted(self._seed, self._source[1]), worlds, stride=stride)
        step = self._finite_start(step)
        self._see(self._remember(step, self._empty_memories()))
        fresh = _fresh_progress(self.env.num_envs, len(self._spec.agents))
        fresh.failed_total = self.progress.failed_total
        self.progress = fresh
        if self._listener is not None:
            self._listener.started(np.arange(self.env.num_envs))

    def fragment(self, steps: int, exploration: Exploration) -> JointRollout:
        """Return the next `steps` steps of all copies, episodes running on between fragments.

        Raises:
            EnvironmentFailure: A copy failed too often in a row.
        """
        copies = self.env.num_envs
        if self._now is None:
            self.begin(self._source[0] * copies + np.arange(copies))
        spaces, now = self._spec.spaces, self._view()
        rollout = JointRollout.empty(spaces, steps, copies, log_prob=self.policies.has_log_prob)
        rollout.source[:] = [(*self._source, b) for b in range(copies)]
        rollout.start[:] = self.progress.steps
        rollout.views.write(0, now)
        rollout.views.alive[0] = now.alive
        for t in range(steps):
            acting = self._act(self._view(), exploration)
            for k, chosen in enumerate(acting):
                rollout.actions[k][t] = chosen.actions.numpy()
            if rollout.log_prob is not None:
                parts = [chosen.log_prob for chosen in acting if chosen.log_prob is not None]
                rollout.log_prob[t] = parts[0] if len(parts) == 1 else torch.cat(parts, 1)
            step = self._step(self._in_env_units([actions[t] for actions in rollout.actions]))
            rollout.write(t, step)
        self._silence_the_dead(rollout)
        return rollout.close()

    def episodes(
        self,
        worlds: Ints,
        exploration: Exploration,
        on_step: Callable[[EvaluatedStep], None] | None = None,
    ) -> list[Episode]:
        """Play one episode in each of the given worlds, dealt in turn to the copies.

        Args:
            worlds: Equally spaced numbers, shape (c,).
            exploration: How to act.
            on_step: Called with every step of all copies.

        Returns:
            The episodes in the order of `worlds`, without those that failed in an environment that then
            goes on with another world.
        """
        copies = self.env.num_envs
        spacing = int(worlds[1] - worlds[0]) if len(worlds) > 1 else 1
        self._generator.manual_seed(_mixed(self._seed, int(worlds[0])))
        self.begin(worlds[0] + spacing * np.arange(copies), stride=spacing * copies)
        playing = self._worlds(worlds[0] + spacing * np.arange(copies))
        finished: dict[int, Episode] = {}
        while (playing <= worlds[-1]).any():
            seen = self._view() if on_step is None else _copied(self._view())
            acting = self._act(seen, exploration)
            actions = self._in_env_units([chosen.actions.numpy() for chosen in acting])
            self._annotate(acting)
            step = self._step(actions)
            if on_step is not None:
                active = np.where(playing <= worlds[-1], playing, -1)
                given = tuple(chosen.distribution.numpy() for chosen in acting)
                on_step(EvaluatedStep(active, seen, given, actions, step))
            for episode in self.take_episodes():
                world = int(playing[episode.copy])
                if world <= worlds[-1]:
                    finished[world] = episode._replace(world=world)
                playing[episode.copy] += spacing * copies
            playing = self._worlds(playing)
        return [finished[world] for world in worlds.tolist() if world in finished]

    def choose(self, exploration: Exploration) -> tuple[np.ndarray, ...]:
        """Return actions for where the copies stand, per block, in the environment's units."""
        return self._in_env_units([chosen.actions.numpy() for chosen in self._act(self._view(), exploration)])

    def carry_out(self, actions: tuple[np.ndarray, ...]) -> None:
        """Step the environment by what `choose` returned."""
        self._step(actions)
        self.take_episodes()

    def take_episodes(self) -> list[Episode]:
        """Return the episodes that ended since the last call."""
        ended, self.progress.ended = self.progress.ended, []
        return ended

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
        """Go on where `get_state` was called; with new episodes if the environments have no state."""
        self._generator.set_state(torch.tensor(state["generator"]))
        if state["env"] is None or state["now"] is None:
            return
        self._source = state["source"]
        self.env.set_state(state["env"])  # type: ignore[attr-defined]
        self._now, self.progress = _copied(state["now"]), copy.deepcopy(state["progress"])
        if self._listener is not None:
            self._listener.started(np.arange(self.env.num_envs))

    def _worlds(self, expected: Ints) -> Ints:
        """Return a copy of the worlds that are played, as expected unless the environment tells."""
        told = getattr(self.env, "worlds", None)
        return np.array(expected if told is None else told, int)

    def _empty_memories(self) -> list[np.ndarray | None]:
        """Return zeros (B, n, H) for each recurrent block."""
        return [
            np.zeros((self.env.num_envs, len(block.agents), *block.observation[MEMORY].shape), np.float32)
            if MEMORY in block.observation
            else None
            for block in self._spec.spaces.blocks
        ]

    def _view(self) -> View:
        if self._now is None:
            raise RuntimeError("the sampler has not begun an episode")
        return self._now

    def _in_env_units(self, actions: list[np.ndarray]) -> tuple[np.ndarray, ...]:
        return tuple(to_env(b.action, a) for b, a in zip(self._spec.spaces.blocks, actions, strict=True))

    def _act(self, view: View, exploration: Exploration) -> list[SampledActions]:
        acting = self.policies.act(view, exploration, self._generator)
        self._memories = [None if chosen.memory is None else chosen.memory.numpy() for chosen in acting]
        return acting

    def _annotate(self, acting: Sequence[SampledActions]) -> None:
        annotate = getattr(self.env, "annotate", None)
        if annotate is None:
            return
        given = [chosen.distribution.numpy() for chosen in acting]
        discrete = [isinstance(block.action, Discrete) for block in self._spec.spaces.blocks]
        for name, wanted in (("probabilities", True), ("mean_std", False)):
            if wanted in discrete:
                annotate(name, [g if d == wanted else None for g, d in zip(given, discrete, strict=True)])

    def _step(self, actions: tuple[np.ndarray, ...]) -> JointStep:
        progress = self.progress
        acted = self._view().alive.copy()
        step = self._remember(self._void_non_finite(self.env.step(actions)), self._memories)
        progress.returns += step.rewards * acted
        progress.lengths += 1
        progress.steps += 1
        if step.reset.any() or step.failed:
            self._end_episodes(step)
        self._see(step)
        self._forget(acted, step)
        if self._listener is not None:
            self._listener.stepped(step, acted)
        return step

    def _remember(self, step: JointStep, memories: Sequence[np.ndarray | None]) -> JointStep:
        """Return the step with the memory (B, n, H) that each recurrent block takes along."""
        if not any(memory is not None for memory in memories):
            return step
        seen = tuple(
            leaves if memory is None else {**leaves, MEMORY: memory}
            for leaves, memory in zip(step.observations, memories, strict=True)
        )
        return step._replace(observations=seen)

    def _forget(self, acted: Bools, step: JointStep) -> None:
        """Empty the memory of all whose life did not go on; what was handed out keeps it."""
        over = step.reset.copy()
        over[list(step.failed)] = True
        ended = ~(acted & goes_on(step.alive, step.terminated, step.truncated, over))
        column = 0
        for leaves, block in zip(self._view().observations, self._spec.spaces.blocks, strict=True):
            if MEMORY in leaves:
                own = ended[:, column : column + len(block.agents)]
                leaves[MEMORY] = np.where(own[..., None], 0, leaves[MEMORY])
            column += len(block.agents)

    def _end_episodes(self, step: JointStep) -> None:
        progress = self.progress
        for b in np.flatnonzero(step.reset).tolist():
            if b not in step.failed:
                metrics = step.metrics.get(b, {})
                progress.ended.append(
                    Episode(b, int(progress.lengths[b]), progress.returns[b].copy(), metrics)
                )
                progress.failures[b] = 0
        for b, cause in step.failed.items():
            progress.failures[b] += 1
            progress.failed_total += 1
            if progress.failures[b] > self._max_failures:
                raise EnvironmentFailure(
                    f"copy {b} failed {progress.failures[b]} times without completing an episode: {cause!r}",
                    place=f"environment {type(self.env).__name__}",
                    remedy="mend the environment, or raise `max_env_failures`",
                ) from cause
        over = step.reset.copy()
        over[list(step.failed)] = True
        progress.returns[over] = 0
        progress.lengths[over] = 0

    def _void_non_finite(self, step: JointStep) -> JointStep:
        """Treat copies with NaN or infinite observations, states or rewards like copies that raised."""
        broken = non_finite(step)
        if not broken:
            return step
        fresh = self._finite_start(self.env.recreate(broken))
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
        """Return first moments without NaN or infinity: copies that begin with such are created anew."""
        attempts, broken = 1, non_finite(step)
        while broken:
            if attempts > self._max_failures:
                raise EnvironmentFailure(
                    f"copies {sorted(broken)} began {attempts} times in a row with NaN or infinity",
                    place=f"environment {type(self.env).__name__}",
                    remedy="mend the environment: its reset gives non-finite observations or states",
                )
            self.progress.failed_total += len(broken)
            step = self.env.recreate(broken)
            attempts, broken = attempts + 1, non_finite(step)
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

    def _silence_the_dead(self, rollout: JointRollout) -> None:
        alive, column = rollout.views.alive[:-1], 0
        for actions, block in zip(rollout.actions, self._spec.spaces.blocks, strict=True):
            there = alive[..., column : column + len(block.agents)]
            actions *= there.reshape(there.shape + (1,) * (actions.ndim - 3)).astype(actions.dtype)
            column += len(block.agents)
        if rollout.log_prob is not None:
            rollout.log_prob *= alive


def _fresh_progress(copies: int, agents: int) -> Progress:
    def zeros() -> Ints:
        return np.zeros(copies, int)

    return Progress(np.zeros((copies, agents)), zeros(), zeros(), zeros())


def _copied(view: View) -> View:
    return View.concat([view, view[:0]], 0)


def _restarted(seed: int, restart_id: int) -> int:
    """Return the root seed, in [0, 2**63), of episodes that are not those before the restart."""
    if not restart_id:
        return seed
    return int(np.random.SeedSequence(seed, spawn_key=(restart_id,)).generate_state(1, np.uint64)[0] >> 1)


def _mixed(*numbers: int) -> int:
    return int(np.random.SeedSequence([n % 2**64 for n in numbers]).generate_state(1)[0])
