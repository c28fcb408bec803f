"""The Gymnasium face of the paper: dicts of agents, observation objects, adapters of the agents' specs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.agents.spec import AgentSpec
from smarts.env.adapters.actions import encode_one
from smarts.env.adapters.protocol import ArrayAdapter
from smarts.env.arrays import Adapter, EnvSettings, maker_of
from smarts.env.batch import Batch, Transition
from smarts.env.not_copied import NotCopied
from smarts.env.observation_collector import ObservationCollector
from smarts.env.setting_checks import check_instance
from smarts.env.solo import Episodes, annotate_each, as_row, check_names, info_of
from smarts.observations.context import AdapterContext
from smarts.rewards.weights import Rewards
from smarts.sim.assembly import Options
from smarts.types.actions import ActionSpaceType
from smarts.types.streams import check_seed


class HiWayEnv(NotCopied, gym.Env):
    """A simulation whose agents are driven by their specs: `gymnasium.make("smarts.env:hiway-v0", ...)`.

    Observations are `Observation` objects with the original's field names, rewards the metres gone along the
    route; both go through the adapters of the agent's spec. An agent whose time has come is among the
    observations; one that ends is in them, and in the done dicts, once more.

    Args:
        scenarios: Folders, or names of the suite; they are played in a seeded order.
        agent_specs: The agents' specs, or their interfaces alone, by name.
        seed: Of the run, until `reset` gives another.
        headless: Without effect: episodes are watched through their records.
        decision_interval: Steps of 0.1 s from one decision to the next.
        simulation: Options of the simulation.
        traffic: The variations of the scenarios' traffic that are played, by default all.
        sim_name: Without effect. Kept so that the original's calls work.

    Raises:
        SmartsError: A scenario or an agent is not what it has to be.
    """

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        scenarios: Sequence[str | Path],
        agent_specs: Mapping[str, AgentSpec | AgentInterface],
        *,
        seed: int = 42,
        headless: bool = True,
        decision_interval: int = 1,
        simulation: Options | None = None,
        traffic: Sequence[str] | None = None,
        sim_name: str | None = None,
    ) -> None:
        check_instance("agent_specs", agent_specs, Mapping, "a dict of specs by the agents' names")
        setting = EnvSettings(
            scenarios=scenarios,
            agents=agent_specs,
            seed=seed,
            decision_interval=decision_interval,
            simulation=Options() if simulation is None else simulation,
            traffic=traffic,
        )
        interfaces = setting.interfaces()
        self.agent_specs = {
            name: given if isinstance(given, AgentSpec) else AgentSpec(interface=given)
            for name, given in agent_specs.items()
        }
        self.agent_ids = list(agent_specs)
        """All agents that there may be."""
        self._interfaces = tuple(interfaces.values())
        parts = setting.assemble(interfaces)
        self._kinds = [ActionSpaceType(int(kind)) for kind in parts.rules.action]
        self._scene = parts.scene
        agents = np.arange(len(self.agent_ids), dtype=np.int32)
        none = ActionSpaceType.Empty
        served = AdapterContext(
            parts.scene, tuple(self.agent_ids), agents, none, decision_interval, max_steps=0
        )
        self._collector, self._metres = ObservationCollector(served), Rewards(served, "route_metres")
        self._columns = {name: agent_id for agent_id, name in enumerate(self.agent_ids)}
        self._batch = Batch(parts, [self._metres, self._collector], period=decision_interval)
        self._episodes = Episodes(seed)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin the next episode, or with a seed the first one of that seed."""
        if seed is not None:
            check_seed(seed, "reset")
        super().reset(seed=seed, options=options)
        self._batch.reset({0: self._episodes.next(seed)})
        self._batch.dispatch()
        present = np.flatnonzero(self._batch.alive[0]).tolist()
        infos = {
            self.agent_ids[agent_id]: {"env_obs": self._collector.seen[agent_id]} for agent_id in present
        }
        return {self.agent_ids[agent_id]: self._adapted(agent_id) for agent_id in present}, infos

    def step(self, action: Mapping[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        """Carry out a decision; return observations, rewards, terminated, truncated and infos by agent.

        Both done dicts have "__all__" too: whether the episode is over, and whether it is so because some of
        its last agents were only cut short. Actions of agents that are not there (any more, or yet) are
        ignored, so that a loop over the last observations may act for those that have just ended. An agent
        without an action goes on as before.

        Raises:
            ActionError: An agent is unknown, or an action is not one of its type.
            TrafficError: The traffic engine failed; the next reset works.
            SmartsError: It was closed, or never reset.
        """
        self._batch.check_begun()
        check_names(action, self.agent_ids)
        with self._batch.all_or_none():
            for name, chosen in action.items():
                self._put(name, chosen)
        transition = self._batch.step()
        for error in transition.failures.values():
            raise error
        told = self._told(transition)
        self._batch.conclude(*as_row(told[1], self._columns))
        self._batch.dispatch()
        return told

    def annotate(self, name: str, values: Mapping[str, ArrayLike]) -> None:
        """Add to the record what agents have to say about their next actions; nothing if nothing is recorded.

        Args:
            name: What it is, such as "probabilities".
            values: A number or numbers of each agent; those of agents that are not alive do not matter.

        Raises:
            ActionError: An agent is unknown.
        """
        check_names(values, self.agent_ids)
        annotate_each(self._batch, name, {self._columns[who]: given for who, given in values.items()})

    def watch(self, adapter: Adapter, options: Mapping[str, Any] | None = None) -> ArrayAdapter:
        """Let an array adapter see every step, so that its observations are there beside the objects.

        Args:
            adapter: A name of `smarts.env.adapters.ADAPTERS`, or a class.
            options: Its options.

        Returns:
            The adapter; its agents are all of the environment's, in the order of `agent_ids`.

        Raises:
            InterfaceError: The agents do not all act and see alike.
        """
        interfaces = self._interfaces
        if len({(each.action, each.max_episode_steps) for each in interfaces}) > 1:
            raise InterfaceError(
                "the agents differ in how they act or how long they may drive",
                place="HiWayEnv.watch",
                remedy="give them equal interfaces",
            )
        kind = ActionSpaceType.Empty if interfaces[0].action is None else interfaces[0].action
        served = AdapterContext(
            self._scene,
            tuple(self.agent_ids),
            np.arange(len(self.agent_ids), dtype=np.int32),
            kind,
            self._batch.period,
            interfaces[0].max_episode_steps or 0,
            interfaces,
        )
        made = maker_of(adapter)(served, interfaces[0], **(options or {}))
        self._batch.watch(made)
        return made

    def close(self) -> None:
        """Give back what the simulation holds; may be called again."""
        self._batch.close()

    def _put(self, name: str, action: Any) -> None:
        agent_id = self._columns[name]
        if self._batch.alive[0, agent_id]:
            adapted = self.agent_specs[name].action_adapter(action)
            action_mask = self._batch.world.agents.action_mask[0, agent_id]
            encode_one(name, self._kinds[agent_id], adapted, 0, agent_id, action_mask, self._batch.actions)

    def _told(self, transition: Transition) -> tuple[dict, dict, dict, dict, dict]:
        observations, rewards, infos = {}, {}, {}
        terminated: dict[str, bool] = {}
        truncated: dict[str, bool] = {}
        acted = transition.acted[0]
        for agent_id in np.flatnonzero(acted | self._batch.alive[0]).tolist():
            name, seen = self.agent_ids[agent_id], self._collector.seen[agent_id]
            reward = float(self._metres.values[0, agent_id]) if acted[agent_id] else 0.0
            observations[name] = self._adapted(agent_id)
            rewards[name] = self.agent_specs[name].reward_adapter(seen, reward)
            score = float(self._batch.world.agents.distance_travelled[0, agent_id])
            info = {**info_of(transition, agent_id), "score": score, "env_obs": seen}
            infos[name] = self.agent_specs[name].info_adapter(seen, reward, info)
            terminated[name] = bool(transition.terminated[0, agent_id])
            truncated[name] = bool(transition.truncated[0, agent_id])
        terminated["__all__"] = bool(transition.finished[0])
        truncated["__all__"] = terminated["__all__"] and any(truncated.values())
        return observations, rewards, terminated, truncated, infos

    def _adapted(self, agent_id: int) -> Any:
        return self.agent_specs[self.agent_ids[agent_id]].observation_adapter(self._collector.seen[agent_id])
