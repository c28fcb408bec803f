"""The Gymnasium face of a single agent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym

from smarts.agents.interface import AgentInterface
from smarts.agents.spec import AgentSpec
from smarts.env.arrays import Adapter, EnvSettings
from smarts.env.not_copied import NotCopied
from smarts.env.solo import SoloWorld
from smarts.errors import ActionError
from smarts.sim.assembly import Options
from smarts.types.streams import check_seed


class SingleHiWayEnv(NotCopied, gym.Env):
    """A simulation with one learning agent, "agent-0".

    Args:
        scenarios: Folders, or names of the suite; they are played in a seeded order, and so are the missions
            of each.
        agent: Its spec or interface; by default, that of the benchmark.
        seed: Of the run, until `reset` gives another.
        decision_interval: Steps of 0.1 s from one decision to the next.
        adapter: What the agent sees and is paid for: a name of `smarts.env.adapters.ADAPTERS`, or a class; if
            its spec has adapters of its own, what these say.
        adapter_options: Its options, such as `{"reward": "paper"}`.
        simulation: Options of the simulation.
        traffic: The variations of the scenarios' traffic that are played, by default all.
        action_mask: Whether observations hold the mask of the lane actions too, which is in each info.

    Raises:
        SmartsError: A scenario or the agent is not what it has to be.
    """

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        scenarios: Sequence[str | Path],
        agent: AgentSpec | AgentInterface | None = None,
        *,
        seed: int = 42,
        decision_interval: int = 5,
        adapter: Adapter = "benchmark",
        adapter_options: Mapping[str, Any] | None = None,
        simulation: Options | None = None,
        traffic: Sequence[str] | None = None,
        action_mask: bool = False,
    ) -> None:
        self._world = SoloWorld(
            EnvSettings(
                scenarios=scenarios,
                agents=1 if agent is None else {"agent-0": agent},
                seed=seed,
                decision_interval=decision_interval,
                adapter=adapter,
                adapter_options={} if adapter_options is None else adapter_options,
                simulation=Options() if simulation is None else simulation,
                traffic=traffic,
                action_mask=action_mask,
            )
        )
        (self._agent,) = self._world.possible_agents
        self.observation_space = self._world.observation_spaces[self._agent]
        self.action_space = self._world.action_spaces[self._agent]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin the next episode, or with a seed the first one of that seed."""
        if seed is not None:
            check_seed(seed, "reset")
        super().reset(seed=seed, options=options)
        observations, infos = self._world.reset(seed)
        return observations[self._agent], infos[self._agent]

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Carry out a decision.

        Raises:
            ActionError: The action is not in the space, or the episode is over.
            TrafficError: The traffic engine failed; the next reset works.
            SmartsError: It was closed, or never reset.
        """
        told, name = self._world.step({self._agent: action}), self._agent
        if name not in told.observations:
            raise ActionError("the episode is over", place="SingleHiWayEnv.step", remedy="call reset()")
        return (
            told.observations[name],
            told.rewards[name],
            told.terminated[name],
            told.truncated[name],
            told.infos[name],
        )

    def annotate(self, name: str, values: Any) -> None:
        """Add to the record what the agent has to say about its next action; see `SoloWorld.annotate`."""
        self._world.annotate(name, {self._agent: values})

    def close(self) -> None:
        """Give back what the simulation holds; may be called again."""
        self._world.close()
