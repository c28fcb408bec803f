"""The vector environment: B simulations stepped together, arrays in and out, for learners."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.agents.options import InterfaceError
from smarts.env.actions import Own, arrays_of
from smarts.env.grouped_runner import make_runner
from smarts.env.groups import ALONE, AgentGroup, box_of, rewards_of
from smarts.env.listeners import StepListener
from smarts.env.runner import EpisodeKey, NotCopied, Transition
from smarts.env.settings import Agents, EnvOptions, EnvSettings, check_keywords
from smarts.env.vector_step import Block, Final, Ints, Spaces, VectorStep
from smarts.errors import TrafficError
from smarts.types.episode import EpisodeStart
from smarts.types.events import Outcome
from smarts.types.streams import check_seed

Part = TypeVar("Part")
MOST_TRIES = 10
"""Episodes in a row that a simulation may fail to begin."""


class VectorHiWayEnv(NotCopied):
    """B simulations with the same agents, stepped together; each is reset as soon as its episode ends.

    An episode is a function of (seed, world, episode) alone.

    Args:
        num_envs: B.
        scenarios: Folders, or names of the suite; they are played in a seeded order.
        agents: How many agents of the benchmark, or specs or interfaces by name; specs without adapters of
            their own, which would have to be called for each agent.
        options: See `EnvSettings`.

    Raises:
        SmartsError: A scenario or an agent is invalid.
    """

    def __init__(
        self,
        num_envs: int,
        scenarios: Sequence[str | Path],
        agents: Agents = 4,
        **options: Unpack[EnvOptions],
    ) -> None:
        check_keywords(VectorHiWayEnv, options)
        settings = EnvSettings(scenarios, agents, num_envs, **options)
        for name, spec in settings.specs().items():
            if spec.own_adapters:
                raise InterfaceError(
                    f"the spec of agent {name!r} has adapters: {', '.join(sorted(spec.own_adapters))}",
                    place="VectorHiWayEnv",
                    remedy="write an array adapter (docs/guide/adapters.md), or use an environment by name",
                )
        self.num_envs = num_envs
        self._runner, self._groups = make_runner(settings)
        self.agents = tuple(name for group in self._groups for name in group.agents)
        self.spaces = Spaces(tuple(_block(group) for group in self._groups))
        self._seed = settings.seed
        self._world_numbers = np.arange(num_envs)
        self._episodes = np.zeros(num_envs, int)
        self._stride = 0
        self._none = np.zeros((num_envs, len(self.agents)), np.bool_)
        self._endings = np.zeros((num_envs, len(Outcome)), int)  # of the present episodes, by outcome

    @property
    def episodes(self) -> tuple[EpisodeStart, ...]:
        """What is being played in each simulation; nothing before the first reset."""
        return tuple(start for start in self._runner.starts if start is not None)

    @property
    def episode_steps(self) -> Ints:
        """Steps of the present episodes, shape (B,)."""
        return self._runner.world.step.copy()

    @property
    def worlds(self) -> Ints:
        """The world that each simulation plays, shape (B,): where one fails, another one may be played."""
        return self._world_numbers.copy()

    def reset(
        self, seed: int | None = None, worlds: Ints | None = None, *, episode: int = 0, stride: int = 0
    ) -> VectorStep:
        """Begin an episode in all simulations.

        Args:
            seed: Seed of the run from now on.
            worlds: Number of the world that each simulation is, shape (B,); by default 0 to B - 1.
            episode: Number of the episode that each begins with.
            stride: 0: the episodes of a world follow each other. Else the simulation continues with the same
                episode of the world that lies `stride` further: a list of worlds is dealt out.

        Raises:
            SmartsError: The seed is out of its range.
            TrafficError: A simulation does not begin.
        """
        seed = self._seed if seed is None else seed
        check_seed(seed, "reset")
        self._seed, self._stride = seed, stride
        self._world_numbers[:] = np.arange(self.num_envs) if worlds is None else worlds
        self._episodes[:] = episode
        self._begin(np.arange(self.num_envs))
        return self._result(social_infos=self._social_infos())

    def step(self, actions: Sequence[ArrayLike] | NDArray) -> VectorStep:
        """Step all simulations until the next decision; reset each simulation whose episode ends.

        Args:
            actions: Per block, whole numbers of shape (B, n), or numbers of shape (B, n, k); tensors on a CPU
                will do, and blocks of one size may be stacked. Those of agents that are not active are
                unspecified.

        Raises:
            ActionError: An action is not in the space, or an array has not the shape of its block. No action
                is taken then.
            TrafficError: A simulation does not begin again.
            SmartsError: The environment was closed, or never reset.
        """
        runner = self._runner
        runner.check_begun()
        self._encode(actions)
        transition = runner.step()
        rewards = rewards_of(self._groups, transition.acted)
        terminated, truncated = transition.terminated, transition.truncated
        failed = dict(transition.failures)
        over = transition.finished
        ended = over.copy()
        for row in failed:
            rewards[row], terminated[row], truncated[row], ended[row] = 0.0, False, False, False
        rows = np.flatnonzero(ended)
        if self._runner.learns_in_bubbles:
            env_ids, columns = np.nonzero(terminated | truncated)
            np.add.at(self._endings, (env_ids, transition.outcome[env_ids, columns]), 1)
        final = self._final(rows) if len(rows) else None
        metrics = {row: self._metrics(row, transition) for row in rows.tolist()}
        social_infos = self._social_infos()
        # Before the next episodes begin: the rewards of these decisions belong to the last ones.
        runner.conclude(rewards, ~self._none)
        if over.any():
            self._next_episodes(np.flatnonzero(over))
        return self._result(
            social_infos=social_infos,
            rewards=rewards,
            terminated=terminated,
            truncated=truncated,
            reset=ended,
            final=final,
            failed=failed,
            metrics=metrics,
        )

    def listen(self, listener: StepListener) -> None:
        """Show every step to one more listener."""
        self._runner.listen(listener)

    def change_starts(self, change: Callable[[EpisodeStart], EpisodeStart]) -> None:
        """Let every episode from now on begin as `change` returns it; agents and map have to stay."""
        self._runner.change_start = change

    def annotate(self, name: str, values: Sequence[NDArray | None]) -> None:
        """Add values to the record of the next step; without a record, a no-op.

        Args:
            name: What the values are, such as "probabilities".
            values: Per block, of each agent, shape (B, n, ...), or None. Those of agents that are not active
                are ignored.
        """
        for group, given in zip(self._groups, values, strict=True):
            if given is not None and self._runner.recorder is not None:
                given = np.asarray(given)
                numbers = np.zeros((*self._none.shape, *given.shape[2:]))
                numbers[:, group.columns] = given
                egos = self._none.copy()
                egos[:, group.columns] = True
                self._runner.annotate(name, numbers, egos)

    def recreate(self, failures: Mapping[int, BaseException]) -> VectorStep:
        """Begin the next episode in some simulations."""
        self._next_episodes(np.array(sorted(failures)))
        return self._result(failed=dict(failures), social_infos=self._social_infos())

    def close(self) -> None:
        """Free the simulations; may be called again."""
        self._runner.close()

    def _encode(self, actions: Sequence[ArrayLike] | NDArray) -> None:
        """Check all actions, then write the actions of active agents."""
        encoder, checked = self._runner.encoder, []
        for group, given in zip(self._groups, arrays_of(actions, self._groups, self.num_envs), strict=True):
            acts = self._runner.alive[:, group.columns]
            checked.append(
                Own(group, given, acts) if group.encodes else encoder.parse_group(group, given, acts)
            )
        encoder.write(checked)

    def _result(self, **decision: Any) -> VectorStep:
        """Ask the social agents for their next actions, and return where the simulations stand.

        Args:
            decision: Fields that tell of the decision.
        """
        self._runner.dispatch()
        now = VectorStep(
            tuple(_leaves(group) for group in self._groups),
            np.zeros(self._none.shape, np.float32),
            self._none,
            self._none,
            self._runner.alive,
            reset=np.zeros(self.num_envs, np.bool_),
            masks=tuple(group.action_mask() for group in self._groups),
            social_failures=self._runner.take_social_failures(),
        )
        return now._replace(**decision)

    def _social_infos(self) -> dict[int, dict[str, Any]]:
        """Return the simulations' `SimulationRunner.social_info` that are not empty."""
        infos = {row: self._runner.social_info(row) for row in range(self.num_envs)}
        return {row: info for row, info in infos.items() if info}

    def _next_episodes(self, rows: Ints) -> None:
        self._advance(rows)
        self._begin(rows)

    def _advance(self, rows: Ints) -> None:
        if self._stride:
            self._world_numbers[rows] += self._stride
        else:
            self._episodes[rows] += 1

    def _begin(self, rows: Ints) -> None:
        """Begin episodes; if an episode fails, the next one."""
        self._endings[rows] = 0
        try:
            self._runner.reset({int(row): self._key(row) for row in rows})
        except TrafficError:
            for row in rows:
                self._begin_one(int(row))

    def _begin_one(self, row: int) -> None:
        problem = None
        for _ in range(MOST_TRIES):
            try:
                return self._runner.reset({row: self._key(row)})
            except TrafficError as error:
                problem = error
                self._advance(np.array([row]))
        raise TrafficError(
            f"simulation {row} failed to begin {MOST_TRIES} episodes in a row", place="VectorHiWayEnv"
        ) from problem

    def _key(self, row: Any) -> EpisodeKey:
        return EpisodeKey(int(self._world_numbers[row]), int(self._episodes[row]), self._seed)

    def _final(self, rows: Ints) -> Final:
        """Return copies: the reset overwrites the observations."""
        observations = tuple(
            {name: array[rows] for name, array in _leaves(group).items()} for group in self._groups
        )
        masks = [group.action_mask() for group in self._groups]
        return Final(rows, observations, tuple(None if mask is None else mask[rows] for mask in masks))

    def _metrics(self, row: int, transition: Transition) -> dict[str, float]:
        endings = np.bincount(transition.outcome[row], minlength=len(Outcome))
        if self._runner.learns_in_bubbles:
            endings = self._endings[row]
        count = max(1, int(endings.sum()))
        shares = {
            outcome.name.lower(): float(endings[outcome]) / count
            for outcome in Outcome
            if outcome != Outcome.NONE and (self._runner.learns_in_bubbles or outcome != Outcome.LEFT_BUBBLE)
        }
        return {**shares, "steps": float(self._runner.world.step[row])}


def _leaves(group: AgentGroup) -> dict[str, NDArray]:
    return _named(group.arrays)


def _block(group: AgentGroup) -> Block:
    spaces, action = _named({field.name: box_of(field) for field in group.fields}), cast(Any, group.action)
    return Block(group.agents, spaces, action, group.action_mask() is not None)


def _named(parts: dict[str, Part]) -> dict[str, Part]:
    """Return the parts of an observation, under "" if there is only one array."""
    return {"": parts[ALONE]} if [*parts] == [ALONE] else parts
