"""A trained policy in one's own loop, on any of the environments, without a Ray cluster."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np
from gymnasium.spaces import Discrete
from numpy.typing import NDArray
from ray import cloudpickle

from algorithms.joint.env import CARRIED, Block, JointSpaces, JointStep
from algorithms.joint.policies import Policies
from algorithms.joint.sampler import Sampler
from algorithms.joint.spec import JointSpec
from algorithms.joint.threads import torch_threads
from benchmark.experiment.runs import Run
from benchmark.results.files import ResultsError
from benchmark.results.run_folder import RunFolder
from benchmark.running.again import read_run
from benchmark.running.training import config_of
from smarts.env.adapters.protocol import MASK
from smarts.env.hiway import HiWayEnv
from smarts.env.vector import VectorStep
from smarts.errors import ActionError, nearest_names

STEPS = "num_env_steps_sampled_lifetime"
MODES = ("greedy", "sampled")
CHECKPOINTS = ("last", "best")


def load_policy(
    path: str | Path,
    *,
    mode: Literal["greedy", "sampled"] = "greedy",
    checkpoint: Literal["last", "best"] = "last",
    seed: int = 0,
    imports: Sequence[str | Path] = (),
) -> Policy:
    """Return the policy of a run, as `smarts-bench evaluate` plays it.

    Args:
        path: A run's folder, or its `checkpoint` or `best`.
        mode: Way of acting.
        checkpoint: The last, or the best in validation; of a run's folder.
        seed: Of sampled actions.
        imports: Files and folders of own code, by default the ones of the training.

    Raises:
        ResultsError: There is no run, or it has no such checkpoint, or that is damaged; or `mode` or
            `checkpoint` is unknown.
        OwnCodeError: Own code cannot be imported.
    """
    for name, value, known in (("mode", mode, MODES), ("checkpoint", checkpoint, CHECKPOINTS)):
        if value not in known:
            raise ResultsError(
                f"{name} is {value!r}", place="load_policy", remedy=f"give one of {', '.join(known)}"
            )
    place = Path(path)
    if (place / "rllib_checkpoint.json").exists():
        folder, kept = RunFolder(place.absolute().parent), place
    else:
        folder = RunFolder(place)
        kept = folder.checkpoint if checkpoint == "last" else folder.best
    run = read_run(folder, imports)
    if not kept.exists():
        raise ResultsError(
            f"the run has no {checkpoint} checkpoint", place=str(path), remedy="train it further"
        )
    return Policy(run, kept, is_sampled=mode == "sampled", seed=seed)


class Policy:
    """Acts for all agents of a run, and remembers what recurrent policies have to.

    Args:
        run: What was trained.
        checkpoint: Its folder.
        is_sampled: Whether actions are sampled as in training, instead of greedy.
        seed: Of sampled actions.

    Raises:
        ResultsError: The checkpoint is damaged.
    """

    def __init__(self, run: Run, checkpoint: Path, *, is_sampled: bool, seed: int) -> None:
        self._run, self._seed = run, seed
        self._config = config_of(run)
        modules = _modules(checkpoint)
        self._spec: JointSpec = next(iter(modules.values())).spec
        self._policies = Policies(self._spec, modules)
        steps = int(_read(checkpoint / "env_runner" / "state.pkl").get(STEPS, 0))
        self._exploration = self._config.exploration(steps)._replace(explore=is_sampled)
        self._blocks = tuple(_seen(block) for block in self._spec.spaces.blocks)
        self.agents: tuple[str, ...] = self._spec.agents
        """Names of the agents that the policy acts for."""
        self._playing: tuple[_GivenSteps, Sampler] | None = None
        self._last: tuple[NDArray, ...] | None = None
        self._attached: Any = None

    def reset(self) -> None:
        """Forget the last episode. To be called with each `reset` of an environment."""
        self._last = None

    def act(self, observations: Any, infos: Mapping[str, Any] | None = None) -> Any:
        """Return actions, to be handed to the environment's `step`.

        Args:
            observations: What `reset` and `step` return. Dicts of agents: an action for each agent in it,
                which need not be all. Of `SingleHiWayEnv`: the agent's action. Of `VectorHiWayEnv`, its whole
                `VectorStep`: an array for each block; a simulation that was reset is taken for a new episode.
            infos: What they return beside them, where masks of lane actions are, unless the observations hold
                them.

        Raises:
            ActionError: An agent is unknown, its observation is none that the policy was trained on, or there
                is no mask of its actions although it was trained with one.
        """
        if isinstance(observations, VectorStep):
            return [*self._choose(observations)]
        # An empty dict is one by agent, none of which drives at the moment.
        by_name = isinstance(observations, Mapping) and (not observations or {*observations} & {*self.agents})
        is_single = not by_name
        if is_single and len(self.agents) > 1:
            known = nearest_names(str(next(iter(observations), "")), self.agents)
            raise ActionError("observations of no agent of the policy", place="Policy.act", remedy=known)
        only = next(iter(self.agents))
        by_agent = {only: observations} if is_single else observations
        by_info = {only: infos or {}} if is_single else infos or {}
        actions = self._by_name(self._choose(self._step_of(by_agent, by_info)))
        return actions[only] if is_single else {name: actions[name] for name in by_agent}

    def attach(self, env: HiWayEnv) -> None:
        """Look at a `HiWayEnv`, whose observations are objects, by the adapter of the training.

        Its agents must be called, see and act as those of the training, with the same `decision_interval`.

        Raises:
            ActionError: Its agents are others.
            SmartsError: The adapter cannot serve them.
        """
        if tuple(env.agent_ids) != self.agents:
            raise ActionError(
                f"the environment has the agents {env.agent_ids}",
                place="Policy.attach",
                remedy=f"the policy was trained for {[*self.agents]}, in this order",
            )
        given = self._run.cell.environment
        self._attached = env.watch(given.adapter, given.options)
        self.reset()

    def _choose(self, now: Any) -> tuple[NDArray, ...]:
        """Return the actions of all agents, per block."""
        with torch_threads(self._config.torch_threads):
            given, sampler = self._playing_in(len(now.alive))
            given.now = now
            if self._last is None:
                sampler.begin(np.arange(given.num_envs))
            else:
                sampler.carry_out(self._last)
            self._last = sampler.choose(self._exploration)
        return self._last

    def _playing_in(self, count: int) -> tuple[_GivenSteps, Sampler]:
        """Return the sampler of `count` simulations; another number of them starts a new one."""
        if self._playing is None or self._playing[0].num_envs != count:
            given = _GivenSteps(count, self._spec.spaces._replace(blocks=self._blocks))
            env = self._config.adapt(given)
            self._playing = given, Sampler(env, self._policies, self._spec, seed=self._seed)
            self._last = None
        return self._playing

    def _step_of(self, by_agent: Mapping[str, Any], infos: Mapping[str, Any]) -> JointStep:
        """Return what the agents see as arrays of one simulation; those left out are not there."""
        for name in by_agent:
            if name not in self.agents:
                raise ActionError(
                    f"there is no agent {name!r}",
                    place="Policy.act",
                    remedy=nearest_names(name, self.agents),
                )
        leaves, masks = [], []
        for block in self._blocks:
            arrays: dict[str, NDArray] = {
                leaf: np.zeros((1, len(block.agents), *box.shape), box.dtype)
                for leaf, box in block.observation.items()
            }
            action_mask = np.ones((1, len(block.agents), int(block.action.n)), bool) if block.masked else None  # type: ignore[union-attr]
            for row, name in enumerate(block.agents):
                if name in by_agent:
                    seen = self._arrays_of(name, by_agent[name])
                    _fill(name, seen, {leaf: array[0, row] for leaf, array in arrays.items()})
                    if action_mask is not None:
                        action_mask[0, row] = _mask_in(name, seen, infos.get(name))
                        action_mask[0, row, 0] |= not action_mask[0, row].any()
            leaves.append(arrays)
            masks.append(action_mask)
        alive = np.array([[name in by_agent for name in self.agents]])
        ended = self._playing_in(1)[0].alive & ~alive
        nothing = np.zeros(alive.shape, bool)
        return JointStep(
            tuple(leaves),
            np.zeros(alive.shape, np.float32),
            ended,
            nothing,
            alive,
            np.zeros(1, bool),
            masks=tuple(masks),
        )

    def _arrays_of(self, name: str, seen: Any) -> Any:
        if isinstance(seen, Mapping | np.ndarray):
            return seen
        if self._attached is None:
            raise ActionError(
                f"the observation of {name!r} is a {type(seen).__name__}",
                place="Policy.act",
                remedy="call policy.attach(env) once, so that it sees what it was trained on",
            )
        agent = self.agents.index(name)
        return {leaf: array[0, agent] for leaf, array in self._attached.observations.items()}

    def _by_name(self, actions: Sequence[NDArray]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for block, chosen in zip(self._blocks, actions, strict=True):
            for row, name in enumerate(block.agents):
                action = chosen[0, row]
                found[name] = int(action) if isinstance(block.action, Discrete) else action.copy()
        return found


class _GivenSteps:
    """A vector environment whose next step is set from outside: algorithms wrap it like any other."""

    def __init__(self, num_envs: int, spaces: JointSpaces) -> None:
        self.num_envs, self.spaces = num_envs, spaces
        self.now: Any = None

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Which agents were active in the last step, shape (B, N)."""
        agents = sum(len(block.agents) for block in self.spaces.blocks)
        return np.zeros((self.num_envs, agents), bool) if self.now is None else self.now.alive

    def reset(self, seed: int, worlds: Any, *, stride: int = 0) -> Any:
        """Return the step that was set."""
        return self.now

    def step(self, actions: Any) -> Any:
        """Return the step that was set."""
        return self.now

    def recreate(self, failures: Mapping[int, BaseException]) -> NoReturn:
        """Raise, since an observation is not finite."""
        raise ActionError("an observation is not finite", place="Policy.act") from next(
            iter(failures.values())
        )

    def close(self) -> None:
        """Do nothing."""


def _seen(block: Block) -> Block:
    """Return a block with what environments deliver alone."""
    kept = {name: box for name, box in block.observation.items() if not name.startswith(CARRIED)}
    return block._replace(observation=kept)


def _mask_in(name: str, *given: Any) -> NDArray[np.bool_]:
    """Return the first mask of an agent's actions that there is.

    Raises:
        ActionError: There is none: without it the policy would act in a way that it was not trained for.
    """
    for each in given:
        if isinstance(each, Mapping) and MASK in each:
            return np.asarray(each[MASK], bool)
    raise ActionError(
        f"there is no {MASK!r} for {name!r}, with which the policy was trained",
        place="Policy.act",
        remedy="hand over the infos too, or use an environment with action_mask=True",
    )


def _fill(name: str, seen: Any, rows: Mapping[str, NDArray]) -> None:
    """Copy an agent's observation into its rows.

    Raises:
        ActionError: It lacks an array, or has one of another shape.
    """
    for leaf, row in rows.items():
        try:
            part = seen
            if isinstance(seen, Mapping):
                full = leaf or "observation"
                for key in [full] if full in seen else full.split("/"):
                    part = part[key]
            array = np.asarray(part)
        except (KeyError, TypeError) as error:
            raise ActionError(
                f"the observation of {name!r} has no {leaf or 'observation'!r}",
                place="Policy.act",
                remedy="use the adapter and options of the training",
            ) from error
        if array.shape != row.shape:
            raise ActionError(
                f"{leaf or 'observation'!r} of {name!r} has the shape {array.shape}, not {row.shape}",
                place="Policy.act",
                remedy="use the number of agents, the adapter and the options of the training",
            )
        row[...] = array


def _modules(checkpoint: Path) -> dict[str, Any]:
    """Return the policy networks of a checkpoint by group."""
    root = checkpoint / "learner_group" / "learner" / "rl_module"
    made: dict[str, Any] = {}
    names = sorted(folder.name for folder in root.iterdir() if folder.is_dir()) if root.is_dir() else []
    for name in (name for name in names if "__" not in name):  # critics have it in their names
        described = _read(root / name / "class_and_ctor_args.pkl")
        named = described["ctor_args_and_kwargs"][1]
        wanted = {key: named[key] for key in ("observation_space", "action_space", "model_config")}
        with _quiet():
            made[name] = described["class"](**wanted, inference_only=True)
        made[name].set_state(_read(root / name / "module_state.pkl"))
        made[name].eval()
    groups = [group.id for group in next(iter(made.values())).spec.groups] if made else []
    if not made or not {*groups} <= made.keys():
        raise ResultsError("holds no policy of each group", place=str(root), remedy="train it further")
    return {group: made[group] for group in groups}


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep RLlib from warning of what its own constructor of modules does."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)


def _read(file: Path) -> Any:
    """Return the content of a file of a checkpoint.

    Raises:
        ResultsError: It is missing or damaged.
    """
    try:
        with file.open("rb") as stream:
            return cloudpickle.load(stream)
    except Exception as error:  # whatever unpickling half a file ends in
        raise ResultsError(
            f"the checkpoint is damaged: {type(error).__name__}: {error}",
            place=str(file),
            remedy="use the other one: checkpoint='last' or 'best'",
        ) from error
