"""`load_policy`: a trained policy in a user's own loop, in any environment, without a Ray cluster."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from gymnasium.spaces import Discrete
from numpy.typing import NDArray

from algorithms.joint.env import CARRIED, MEMORY, AgentBlock, JointStep, VectorJointEnv
from algorithms.joint.fitting import Agents, fitted_weights
from algorithms.joint.policies import Policies
from algorithms.joint.reference import policies_in
from algorithms.joint.sampler import Sampler
from algorithms.joint.signature import check_signature
from algorithms.joint.spec import SPEC, JointSpec
from algorithms.joint.threads import torch_threads
from benchmark.experiment.runs import TEST, TESTED, Run, run_from
from benchmark.results.files import ResultsError
from benchmark.results.run_folder import RunFolder
from benchmark.running.environments import environment
from benchmark.running.given_steps import GivenSteps, among, check_step, fill, mask_in
from benchmark.running.training import check_checkpoint, config_of, index_of, unpickled
from smarts.env.hiway import HiWayEnv
from smarts.env.vector import VectorStep
from smarts.errors import ActionError, nearest_names
from smarts.registry import import_own


def checked_modules(run: Run, checkpoint: Path) -> dict[str, Any]:
    """Return the policy networks of a run's checkpoint by group, for as many agents as the run has now.

    Raises:
        ResultsError: The checkpoint is damaged, or its networks are of the training's number of agents.
        CheckpointError: The run's algorithm, or a setting of its networks, is another than the checkpoint's.
    """
    check_checkpoint(checkpoint)
    built = unpickled(checkpoint / "env_runner" / "class_and_ctor_args.pkl")["ctor_args_and_kwargs"][1]
    config = config_of(run)
    check_signature(built["config"].checkpoint_signature(), config.checkpoint_signature())
    with _quiet():
        made = policies_in((checkpoint / "learner_group/learner/rl_module").glob("*/"), unpickled)
    groups = [group.id for group in next(iter(made.values())).spec.groups]
    made = {group: made[group] for group in groups}
    is_same = len(made[groups[0]].spec.agents) == run.task_setting.environment.agent_count
    return made if is_same else _for_agents(run, made, config, str(checkpoint))


def _for_agents(run: Run, made: Mapping[str, Any], config: Any, place: str) -> dict[str, Any]:
    """Return policy networks for a run's agents with the weights of those for others."""
    with closing(environment(run.task_setting, num_envs=1)) as env, _quiet():
        spec = config.spec_of(config.adapt(env))
        fresh = config.get_multi_rl_module_spec(spaces={SPEC: (spec, None)}, inference_only=True).build()
    for group in spec.groups:
        trained, module = made.get(group.id), fresh[group.id]
        here, there = (Agents.of(each, group.id) for each in (spec, trained.spec if trained else spec))
        given = trained.get_state() if trained else {}
        weights, unfit = fitted_weights(module.get_state(), given, here, there, index_of(run))
        if unfit:
            raise ResultsError(
                f"cannot act for {len(spec.agents)} agents: {unfit[0]} of {group.id!r} does not fit",
                place=place,
                remedy="train it with `sharing: all`, or leave out --agents",
            )
        module.set_state(weights)
        module.eval()
    return {group.id: fresh[group.id] for group in spec.groups}


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep RLlib from warning of what its own constructor of modules does."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)


def read_run(folder: RunFolder, imports: Sequence[str | Path] = ()) -> Run:
    """Return the run of a folder and import its own code.

    Args:
        folder: The run's.
        imports: Files and folders of own code, by default the ones of the training.

    Raises:
        ResultsError: The folder has no run, or its config is damaged.
        OwnCodeError: A file or folder of own code does not exist.
    """
    try:
        tested = folder.facts().get(TESTED) or {}
        run = run_from(folder.read_config(), tested.get(TEST, ()))
        metrics = tuple(tested["metrics"]) if "metrics" in tested else None
        own = tuple(str(Path(path).absolute()) for path in imports) or run.task_setting.imports
        import_own(own)
        return replace(run, task_setting=replace(run.task_setting, imports=own, metrics=metrics))
    except (ResultsError, ValueError) as error:
        near = nearest_names(folder.path.name, (each.name for each in folder.path.parent.glob("*/")))
        raise ResultsError(
            f"not a run: {getattr(error, 'problem', error)}",
            place=str(folder.config if folder.path.exists() else folder.path),
            remedy="give a folder such as results/NAME/ppo/intersection/no_social_vehicles/seed_1, or that "
            "of an exported policy" + (f"; {near}" if near.startswith("did you mean") else ""),
        ) from error


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
        seed: Seed of sampled actions.
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
    place, given = Path(path), {"is_sampled": mode == "sampled", "seed": seed}
    if (place / "rllib_checkpoint.json").exists():
        return Policy(read_run(RunFolder(place.absolute().parent), imports), place, **given)
    folder = RunFolder(place)
    return Policy(read_run(folder, imports), folder.kept(checkpoint), **given)


class Policy:
    """Acts for all agents of a run; keeps the state of recurrent networks.

    Args:
        run: The trained run.
        checkpoint: Its folder.
        is_sampled: Whether actions are sampled as in training, instead of greedy.
        seed: Seed of sampled actions.

    Raises:
        ResultsError: The checkpoint is damaged.
        CheckpointError: The run's algorithm, or a setting of its networks, is another now.
    """

    def __init__(self, run: Run, checkpoint: Path, *, is_sampled: bool, seed: int) -> None:
        self._run, self._seed = run, seed
        self._config = config_of(run)
        modules = checked_modules(run, checkpoint)
        self._spec: JointSpec = next(iter(modules.values())).spec
        self._policies = Policies(self._spec, modules)
        steps = int(unpickled(checkpoint / "env_runner" / "state.pkl").get(STEPS, 0))
        self._exploration = self._config.exploration(steps)._replace(explore=is_sampled)
        self._blocks = tuple(_seen(block) for block in self._spec.spaces.blocks)
        self.agents: tuple[str, ...] = self._spec.agents
        """Names of the agents that the policy acts for."""
        self.discount: float = self._config.gamma
        """Discount of the learner, with which shaped rewards agree."""
        self.needs_others = any(
            module.communicates or module.acts_jointly or _is_shown_others(module)
            for module in modules.values()
        )
        """Whether actions depend on more than the agent's own observation: messages, common draws."""
        self._playing: tuple[GivenSteps, Sampler] | None = None
        self._last: tuple[NDArray, ...] | None = None
        self._begun = 0  # episodes of a user's own loop
        self._attached: Any = None

    def reset(self) -> None:
        """Begin a new episode; to be called with each `reset` of an environment."""
        self._last = None

    def act(self, observations: Any, infos: Mapping[str, Any] | None = None) -> Any:
        """Return actions, to be handed to the environment's `step`.

        Args:
            observations: What `reset` and `step` return. Of a dict of agents, perhaps not all: an action for
                each. Of `SingleHiWayEnv`: the agent's action. Of `VectorHiWayEnv`, its `VectorStep`: an array
                for each block; a simulation that was reset begins a new episode.
            infos: What they return beside them, where masks of lane actions are, unless the observations hold
                them.

        Raises:
            ActionError: An agent is unknown, its observation does not fit the training, or its action mask is
                missing although the policy was trained with one.
        """
        if isinstance(observations, VectorStep):
            check_step(observations, self._blocks)
            # The environment reuses the array, and which agents acted has to be known after its next step.
            return [*self._choose(observations._replace(alive=observations.alive.copy()))]
        infos, only = infos or {}, self.agents[0]
        # An empty dict is one by agent: none is active at the moment.
        is_by_agent = isinstance(observations, Mapping) and {*observations} <= {*self.agents}
        if len(self.agents) > 1 or is_by_agent:
            actions = self._by_name(self._choose(self._step_of(observations, infos)))
            return {name: actions[name] for name in observations}
        return self._by_name(self._choose(self._step_of({only: observations}, {only: infos})))[only]

    def act_for(self, agents: NDArray[np.bool_], now: VectorStep, worlds: NDArray) -> list[NDArray]:
        """Return the actions of some agents of a `VectorHiWayEnv`, beside others that somebody else drives.

        The policy sees these agents alone: messages, and what it knows of others' observations and actions,
        are of them. Actions of other agents are unspecified.

        Args:
            agents: The agents, shape (N,).
            now: What the environment returned.
            worlds: Its `worlds`.

        Returns:
            An array for each block, as `act` does.

        Raises:
            ActionError: As `act` does.
        """
        check_step(now, self._blocks)
        return [*self._choose(among(agents, now), worlds)]

    def play(self, env: VectorJointEnv, indices: range) -> None:
        """Play test episodes; the environment also records the action probabilities.

        Args:
            env: One that records them, with the agents and the observation of the training; it stays open.
            indices: Indices of the episodes.

        Raises:
            SpaceError: It has other agents, or these see or do something else.
        """
        sampler = Sampler(
            self._config.fitting(env, self._spec),
            self._policies,
            self._spec,
            seed=self._seed,
            max_failures=self._config.max_env_failures,
        )
        with torch_threads(self._config.torch_threads):
            sampler.episodes(np.array(indices), self._exploration)

    def attach(self, env: HiWayEnv) -> None:
        """Observe a `HiWayEnv`, whose observations are objects, with the observation of the training.

        Its agents' names, sensors, actions and `decision_interval` must be those of the training.

        Raises:
            ActionError: Its agents have other names, or decide in other steps.
            SmartsError: Its agents do not fit the observation.
        """
        given = self._run.task_setting.environment
        if (*env.agent_ids, env.decision_interval) != (*self.agents, given.decision_interval):
            raise ActionError(
                f"the environment has the agents {env.agent_ids}, decision_interval={env.decision_interval}",
                place="Policy.attach",
                remedy=f"make it with the agents of the training, {[*self.agents]} in this order, and "
                f"decision_interval={given.decision_interval}",
            )
        self._attached = env.watch(
            given.observation, given.reward, adapter=given.adapter, adapter_options=given.adapter_options
        )
        self.reset()

    def _choose(self, now: Any, worlds: NDArray | None = None) -> tuple[NDArray, ...]:
        """Return the actions of all agents, per block.

        Args:
            now: What they see.
            worlds: Index of each simulation's episode, shape (B,), by which tests draw latents.
        """
        with torch_threads(self._config.torch_threads):
            given, sampler = self._playing_in(len(now.alive))
            given.now, given.worlds = now, worlds
            if self._last is None and worlds is not None:
                sampler.begin(worlds, stride=given.num_envs)
            elif self._last is None:
                sampler.begin(self._begun + np.arange(given.num_envs))
                self._begun += given.num_envs
            else:
                sampler.carry_out(self._last)
            self._last = sampler.choose(self._exploration)
        return self._last

    def _playing_in(self, count: int) -> tuple[GivenSteps, Sampler]:
        """Return the sampler of `count` simulations; another number of them starts a new one."""
        if self._playing is None or self._playing[0].num_envs != count:
            given = GivenSteps(count, self._spec.spaces._replace(blocks=self._blocks))
            env = self._config.adapt(given)
            self._playing = given, Sampler(env, self._policies, self._spec, seed=self._seed)
            self._last = None
        return self._playing

    def _step_of(self, by_agent: Mapping[str, Any], infos: Mapping[str, Any]) -> JointStep:
        """Return observations as arrays of one simulation; agents left out are inactive."""
        unknown = next((name for name in by_agent if name not in self.agents), None)
        if unknown is not None:
            remedy = nearest_names(unknown, self.agents)
            raise ActionError(f"there is no agent {unknown!r}", place="Policy.act", remedy=remedy)
        leaves, masks = zip(*(self._rows_of(block, by_agent, infos) for block in self._blocks), strict=True)
        alive = np.array([[name in by_agent for name in self.agents]])
        ended = self._playing_in(1)[0].alive & ~alive
        nothing = np.zeros(alive.shape, bool)
        return JointStep(
            leaves, np.zeros(alive.shape, np.float32), ended, nothing, alive, np.zeros(1, bool), masks=masks
        )

    def _rows_of(
        self, block: AgentBlock, by_agent: Mapping[str, Any], infos: Mapping[str, Any]
    ) -> tuple[dict[str, NDArray], NDArray[np.bool_] | None]:
        """Return observations and action mask of a block's agents, zeros and True for agents without one."""
        agents = len(block.agents)
        arrays: dict[str, NDArray] = {
            leaf: np.zeros((1, agents, *box.shape), box.dtype) for leaf, box in block.observation.items()
        }
        action_mask = np.ones((1, agents, int(block.action.n)), bool) if block.masked else None  # type: ignore[union-attr]
        for row, name in enumerate(block.agents):
            if name not in by_agent:
                continue
            seen = self._arrays_of(name, by_agent[name])
            fill(name, seen, {leaf: array[0, row] for leaf, array in arrays.items()})
            if action_mask is not None:
                action_mask[0, row] = mask_in(name, seen, infos.get(name))
                action_mask[0, row, 0] |= not action_mask[0, row].any()
        return arrays, action_mask

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


def _is_shown_others(module: Any) -> bool:
    """Return whether observations have more than the agent's own and the policy's memory."""
    return any(name.startswith(CARRIED) and name != MEMORY for name in module.group.observation)


def _seen(block: AgentBlock) -> AgentBlock:
    """Return a block without observations that the algorithm adds."""
    kept = {name: box for name, box in block.observation.items() if not name.startswith(CARRIED)}
    return block._replace(observation=kept)
