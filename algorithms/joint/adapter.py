"""The vector interface for any RLlib `MultiAgentEnv`; PettingZoo's through RLlib's wrapper."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Discrete
from ray.cloudpickle import cloudpickle

from algorithms.errors import EnvironmentFailure, SpaceError, nearest_names
from algorithms.joint.env import (
    AgentBlock,
    Bools,
    FinalStep,
    Ints,
    JointSpaces,
    JointStep,
    agents_of,
    episode_seed,
    name_of,
)
from algorithms.joint.rollout import View
from algorithms.joint.spaces import MASK, Flattening, check_action_space

logger = logging.getLogger(__name__)

COMMON = "__common__"
"""Key of `infos` for what belongs to no agent: `state`, `graph` (in the order of agents), `metrics`."""


class JointVector:
    """B environments (`MultiAgentEnv`) stepped in turn, each reset as soon as its episode ends.

    An agent is active while it is among the observations and has neither terminated nor truncated. An agent
    that ended may come back in a new trajectory; an agent that is left out without a flag must not, which
    would be turn-based play. It counts as truncated and is valued from its last observation. While no agent
    is active, the environment is stepped without actions as long as its `agents` names some and none that has
    ended in this episode; otherwise no agent is expected any more, and the episode ends as by `"__all__"`.

    Args:
        make: Creates environment b.
        num_envs: Number of environments B.
        max_failures: Failures in a row of one environment's constructor or reset that raise.

    Raises:
        SpaceError: A space cannot be handled.
        EnvironmentFailure: An environment cannot even be created.
    """

    def __init__(self, make: Callable[[int], Any], num_envs: int, *, max_failures: int = 10) -> None:
        self.num_envs = num_envs
        self._make = make
        self._max_failures = max_failures
        self._envs: list[Any] = []
        self._envs.extend(self._create(b) for b in range(num_envs))
        self._indices = np.zeros(num_envs, int)
        self._episodes = np.zeros(num_envs, int)
        self._seed = self._stride = 0
        first = self._envs[0]
        names, observation_space, action_space = agents_of(first)
        self._flattening = {a: Flattening(observation_space(a), a) for a in names}
        actions = {a: check_action_space(action_space(a), a) for a in names}
        infos = self._first_infos()
        self.spaces = _spaces(names, self._flattening, actions, infos)
        self._place = {
            agent: (column, number, row)
            for column, (number, row, agent) in enumerate(
                (number, row, agent)
                for number, block in enumerate(self.spaces.blocks)
                for row, agent in enumerate(block.agents)
            )
        }
        self._agents = tuple(self._place)
        self._order = np.array([names.index(agent) for agent in self._agents])
        self._view = View.empty(self.spaces, num_envs)
        self._away = np.zeros((num_envs, len(self._agents)), bool)  # left without a flag in this episode
        self._ended = np.zeros_like(self._away)  # terminated or truncated in this episode

    def reset(self, seed: int, indices: Ints, *, stride: int = 0) -> JointStep:
        """Start all environments; see `VectorJointEnv.reset`."""
        self._seed, self._stride = seed, stride
        self._indices, self._episodes = np.array(indices, int), np.zeros(self.num_envs, int)
        for b in range(self.num_envs):
            self._start_or_replace(b)
        return self._standing()

    def step(self, actions: tuple[np.ndarray, ...]) -> JointStep:
        """Act in all environments. An environment that raises is replaced by a fresh one."""
        shape = (self.num_envs, len(self._agents))
        rewards = np.zeros(shape, np.float32)
        terminated, truncated = np.zeros(shape, bool), np.zeros(shape, bool)
        reset = np.zeros(self.num_envs, bool)
        failed: dict[int, BaseException] = {}
        finals: list[tuple[int, View]] = []
        metrics: dict[int, Mapping[str, float]] = {}
        for b, env in enumerate(self._envs):
            alive = self._view.alive[b].copy()
            chosen = {
                agent: actions[number][b, row]
                for agent, (column, number, row) in self._place.items()
                if alive[column]
            }
            try:
                observations, reward, ends, cuts, infos = env.step(chosen)
            except Exception as error:
                # Any error of a user's environment costs one transition, not the run.
                failed[b] = error
                self._replace(b, error)
                continue
            self._account(b, alive, reward, ends, cuts, observations, (rewards, terminated, truncated))
            self._ended[b] |= terminated[b] | truncated[b]
            self._write(b, observations, infos, acted=alive)
            if ends.get("__all__") or cuts.get("__all__") or self._is_deserted(b):
                finals.append((b, self._view[np.array([b])]))
                metrics[b] = infos.get(COMMON, {}).get("metrics", {}) if infos else {}
                reset[b] = True
                self._next_episode(b)
        final = _final(finals) if finals else None
        return self._standing()._replace(
            rewards=rewards,
            terminated=terminated,
            truncated=truncated,
            reset=reset,
            final=final,
            failed=failed,
            metrics=metrics,
        )

    def recreate(self, failures: Mapping[int, BaseException]) -> JointStep:
        """Replace environments by fresh ones."""
        for b, cause in failures.items():
            self._replace(b, cause)
        return self._standing()._replace(failed=dict(failures))

    @property
    def worlds(self) -> Ints:
        """Index of the episode that each environment plays, (B,)."""
        return self._indices

    @property
    def name(self) -> str:
        """The class of the environments."""
        return name_of(self._envs[0])

    def close(self) -> None:
        """Close all environments."""
        for env in self._envs:
            env.close()

    def get_state(self) -> dict[str, Any] | None:
        """Return all that a continued run needs, or None where the environments cannot be pickled."""
        try:
            envs = [cloudpickle.dumps(env) for env in self._envs]
        except Exception as error:  # whatever a part of a user's environment raises when it is pickled
            logger.warning("environments cannot be pickled, a restored run begins new episodes: %s", error)
            return None
        return {
            "envs": envs,
            "worlds": self._indices.copy(),
            "episodes": self._episodes.copy(),
            "seed": (self._seed, self._stride),
            "view": cloudpickle.dumps((self._view, self._away)),
            "ended": self._ended.copy(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue where `get_state` was called."""
        self.close()
        self._envs = [cloudpickle.loads(env) for env in state["envs"]]
        self._indices, self._episodes = state["worlds"].copy(), state["episodes"].copy()
        self._seed, self._stride = state["seed"]
        self._view, self._away = cloudpickle.loads(state["view"])
        self._ended = state["ended"].copy()

    def _is_deserted(self, b: int) -> bool:
        """Return whether no agent is active in environment b, and none is expected in this episode."""
        if self._view.alive[b].any():
            return False
        # RLlib's wrapper of PettingZoo's environments has the agents of the first reset.
        live = getattr(self._envs[b], "par_env", self._envs[b])
        named = set(getattr(live, "agents", None) or ())
        ended = {agent for agent, (column, _, _) in self._place.items() if self._ended[b, column]}
        return not named or bool(named & ended)  # a list that names what has ended is fixed: it tells nothing

    def _account(self, b: int, alive, reward, ends, cuts, observations, out) -> None:
        """Write the outcomes of environment b, and which agents are active now."""
        rewards, terminated, truncated = out
        all_end, all_cut = ends.get("__all__", False), cuts.get("__all__", False)
        _check_names(observations, self._place)
        for agent, (column, _, _) in self._place.items():
            here = agent in observations
            own = bool(ends.get(agent, False)), bool(cuts.get(agent, False))
            self._view.alive[b, column] = here and not any(own)
            if not alive[column]:
                if here and self._away[b, column]:
                    raise _breach(
                        f"agent {agent!r} was left out of a step without having ended, and is back",
                        "observe all active agents in every step: no turns",
                    )
                continue
            end, cut = _outcome(*own, all_end, all_cut)
            self._away[b, column] = left = not any((here, end, cut))
            rewards[b, column] = reward.get(agent, 0.0)
            terminated[b, column], truncated[b, column] = end, cut or left

    def _write(
        self,
        b: int,
        observations: Mapping[str, Any],
        infos: Mapping[str, Any] | None,
        acted: Bools | None = None,
    ) -> None:
        """Write what agents see; an agent that acted and sees nothing keeps its last observation."""
        for agent, (column, _, _) in self._place.items():
            if agent in observations or acted is None or not acted[column]:
                self._write_agent(b, agent, observations.get(agent), (infos or {}).get(agent, {}))
        common, view = (infos or {}).get(COMMON, {}), self._view
        if view.state is not None:
            view.state[b] = common["state"]
        if view.graph is not None:
            view.graph[b] = np.asarray(common["graph"])[np.ix_(self._order, self._order)]

    def _write_agent(self, b: int, agent: str, seen: Any, info: Mapping[str, Any]) -> None:
        """Write an agent's observation and mask; zeros and every action where it is not there."""
        _, number, row = self._place[agent]
        leaves, mask = self._view.observations[number], self._view.masks[number]
        flattening = self._flattening[agent]
        parts, action_mask = {}, None
        if seen is None:
            action_mask = True
            for leaf in leaves.values():
                leaf[b, row] = 0
        elif flattening.plain:
            parts = {"": seen}
        else:
            parts, action_mask = flattening.split(seen)
        for name, part in parts.items():
            shape, dtype = flattening.arrays[name]
            exact = type(part) is np.ndarray and part.dtype == dtype and part.shape == shape
            leaves[name][b, row] = part if exact else _converted(agent, name, part, shape, dtype)
        if mask is not None:
            mask[b, row] = info.get(MASK, True) if action_mask is None else action_mask

    def _start(self, b: int) -> None:
        seed = episode_seed(self._seed, int(self._indices[b]), int(self._episodes[b]))
        observations, infos = self._envs[b].reset(seed=seed)
        _check_names(observations, self._place)
        self._away[b] = self._ended[b] = False
        for agent, (column, _, _) in self._place.items():
            self._view.alive[b, column] = agent in observations
        self._write(b, observations, infos)

    def _next_episode(self, b: int) -> None:
        if self._stride:
            self._indices[b] += self._stride
        else:
            self._episodes[b] += 1
        self._start_or_replace(b)

    def _start_or_replace(self, b: int) -> None:
        try:
            self._start(b)
        except SpaceError:
            raise
        except Exception as error:
            self._replace(b, error, fresh_episode=False)

    def _create(self, b: int) -> Any:
        return self._try(b, lambda: self._make(b))

    def _first_infos(self) -> Mapping[str, Any]:
        """Reset environment 0, whose infos show masks, state and graph."""

        def reset() -> Mapping[str, Any]:
            try:
                return self._envs[0].reset(seed=0)[1] or {}
            except Exception:
                self._renew(0)
                raise

        return self._try(0, reset)

    def _replace(self, b: int, cause: BaseException, *, fresh_episode: bool = True) -> None:
        logger.warning("environment %d is recreated after %r", b, cause)
        if fresh_episode and not self._stride:
            self._episodes[b] += 1

        def start() -> None:
            self._renew(b)
            self._start(b)

        self._try(b, start)

    def _renew(self, b: int) -> None:
        """Put a new environment in the place of one that failed, whatever that raises when it is closed."""
        try:
            self._envs[b].close()
        except Exception as error:
            logger.warning("environment %d could not be closed: %r", b, error)
        self._envs[b] = self._make(b)

    def _try(self, b: int, start: Callable[[], Any]) -> Any:
        """Return what `start` does, as soon as it does not raise.

        Raises:
            EnvironmentFailure: It raises `max_failures` times in a row.
        """
        cause: Exception | None = None
        for _ in range(self._max_failures):
            try:
                return start()
            except SpaceError:
                raise
            except Exception as error:
                logger.warning("environment %d could not be started: %r", b, error)
                cause = error
        raise EnvironmentFailure(
            f"environment {b} could not be started {self._max_failures} times in a row; last: {cause!r}",
            place=f"environment {self.name}" if self._envs else "environment",
            remedy="fix the environment: its constructor or reset raises",
        ) from cause

    def _standing(self) -> JointStep:
        """Return where the environments stand, as a step in which nothing happened."""
        view, nobody = self._view, np.zeros(self._view.alive.shape, bool)
        return JointStep(
            view.observations,
            np.zeros(view.alive.shape, np.float32),
            nobody,
            nobody,
            view.alive,
            np.zeros(self.num_envs, bool),
            masks=view.masks,
            state=view.state,
            graph=view.graph,
        )


def _outcome(own_end: bool, own_cut: bool, all_end: bool, all_cut: bool) -> tuple[bool, bool]:
    """Return whether an agent terminated, or else was truncated; its own flag goes before all agents'."""
    end = own_end or (all_end and not own_cut)
    return end, (own_cut or all_cut) and not end


def _breach(problem: str, remedy: str) -> SpaceError:
    """Return the error of an environment that breaks the contract."""
    return SpaceError(problem, place="environment", remedy=remedy)


def _check_names(seen: Mapping[str, Any], known: Mapping[str, Any]) -> None:
    """Raise if an agent observes that is not among the possible ones."""
    for agent in seen.keys() - known.keys():
        raise _breach(
            f"there is an observation of {agent!r}, which is not among the `possible_agents`",
            nearest_names(str(agent), known),
        )


def _converted(agent: str, name: str, part: Any, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Return an observation in the shape and type of its space; axes of length one may differ.

    Raises:
        SpaceError: It has another shape, or the type of its space does not hold its values. Floating-point
            numbers may be rounded to others.
    """
    given, where = np.asarray(part), f" in {name!r}" if name else ""
    fits = given.dtype.kind in "biufO" and [n for n in given.shape if n > 1] == [n for n in shape if n > 1]
    array = given.astype(dtype) if fits else given
    if not fits or (dtype.kind != "f" and (array != given).any()):
        raise _breach(
            f"agent {agent!r} observes{where} {given.dtype} of shape {given.shape}, "
            f"its space has {dtype} of shape {shape}",
            "give observations of the shape of the observation space, with values that its type holds",
        )
    return array.reshape(shape)


def _spaces(
    names: list[str],
    flattening: Mapping[str, Flattening],
    actions: Mapping[str, Any],
    infos: Mapping[str, Any],
) -> JointSpaces:
    """Return the agents in blocks of equal spaces."""
    with_mask = [agent for agent in names if MASK in infos.get(agent, {})]
    found: list[tuple[str, AgentBlock]] = []
    # The mask comes with the observation or with the infos; agents that enter later are like the others.
    kinds = [(flattening[agent].leaves, actions[agent]) for agent in with_mask]
    for agent in names:
        leaves, action = flattening[agent].leaves, actions[agent]
        late = agent not in infos and (leaves, action) in kinds
        masked = flattening[agent].masked or agent in with_mask or late
        # Only Discrete actions can be masked.
        block = AgentBlock((), leaves, action, masked and isinstance(action, Discrete))
        found.append((agent, block))
    common = infos.get(COMMON, {})
    return JointSpaces(_in_blocks(found), int(np.size(common.get("state", ()))), "graph" in common)


def _in_blocks(found: list[tuple[str, AgentBlock]]) -> tuple[AgentBlock, ...]:
    """Return the different blocks, each with its agents."""
    blocks: list[AgentBlock] = []
    members: list[list[str]] = []
    for agent, block in found:
        if block not in blocks:
            blocks.append(block)
            members.append([])
        members[blocks.index(block)].append(agent)
    return tuple(block._replace(agents=tuple(a)) for block, a in zip(blocks, members, strict=True))


def _final(finals: list[tuple[int, View]]) -> FinalStep:
    view = View.concat([view for _, view in finals], 0)
    rows = np.array([b for b, _ in finals])
    return FinalStep(rows, view.observations, view.masks, view.state, view.graph)
