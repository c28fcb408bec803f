"""The PettingZoo face: all agents act at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gymnasium.spaces import Space
from pettingzoo import ParallelEnv

from smarts.env.arrays import Adapter, Agents, EnvSettings
from smarts.env.not_copied import NotCopied
from smarts.env.solo import SoloWorld
from smarts.sim.assembly import Options


class ParallelHiWayEnv(NotCopied, ParallelEnv):
    """A simulation as PettingZoo's `ParallelEnv`; see `hiway_parallel_env`."""

    metadata = {"name": "hiway_v0", "render_modes": [], "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, setting: EnvSettings) -> None:
        self._world = SoloWorld(setting)
        self.possible_agents = self._world.possible_agents
        self.agents: list[str] = []
        self.observation_spaces = self._world.observation_spaces
        self.action_spaces = self._world.action_spaces
        self.render_mode = None

    def observation_space(self, agent: str) -> Space:
        """Return what an agent sees; the same object each time."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space:
        """Return what an agent chooses from; the same object each time."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin the next episode, or with a seed the first one of that seed."""
        observations, infos = self._world.reset(seed)
        self.agents = self._world.agents
        return observations, infos

    def step(self, actions: Mapping[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Carry out a decision; those who end with it are told so, and are not among `agents` afterwards.

        Raises:
            ActionError: An agent is unknown, or an action is not in its space.
            TrafficError: The traffic engine failed; the next reset works.
        """
        told = self._world.step(actions)
        self.agents = self._world.agents
        entered = [name for name in self.agents if name not in told.rewards]
        # Who has just entered has an observation, and nothing to be told of its past.
        rewards = {**told.rewards, **dict.fromkeys(entered, 0.0)}
        terminated = {**told.terminated, **dict.fromkeys(entered, False)}
        truncated = {**told.truncated, **dict.fromkeys(entered, False)}
        return told.observations, rewards, terminated, truncated, told.infos

    def annotate(self, name: str, values: Mapping[str, Any]) -> None:
        """Add to the record what agents have to say about their next actions; see `SoloWorld.annotate`."""
        self._world.annotate(name, values)

    def render(self) -> None:
        """Draw nothing: record episodes, and let `smarts-bench render` draw them."""

    def close(self) -> None:
        """Give back what the simulation holds; may be called again."""
        self._world.close()


def hiway_parallel_env(
    scenarios: Sequence[str | Path],
    agents: Agents = 4,
    *,
    seed: int = 42,
    decision_interval: int = 5,
    adapter: Adapter = "benchmark",
    adapter_options: Mapping[str, Any] | None = None,
    simulation: Options | None = None,
    traffic: Sequence[str] | None = None,
    action_mask: bool = False,
) -> ParallelHiWayEnv:
    """Return a simulation as a PettingZoo parallel environment.

    Each info has the agent's "action_mask" if it chooses among lane actions.

    Args:
        scenarios: Folders, or names of the suite; they are played in a seeded order.
        agents: How many agents of the benchmark, or specs or interfaces by name.
        seed: Of the run, until `reset` gives another.
        decision_interval: Steps of 0.1 s from one decision to the next.
        adapter: What agents see and are paid for: a name of `smarts.env.adapters.ADAPTERS`, or a class;
            agents whose specs have adapters of their own see and are paid what these say.
        adapter_options: Its options, such as `{"reward": "paper"}`.
        simulation: Options of the simulation.
        traffic: The variations of the scenarios' traffic that are played, by default all.
        action_mask: Whether observations hold the mask too: `{"observation": ..., "action_mask": ...}`.

    Raises:
        SmartsError: A scenario or an agent is not what it has to be.
    """
    return ParallelHiWayEnv(
        EnvSettings(
            scenarios=scenarios,
            agents=agents,
            seed=seed,
            decision_interval=decision_interval,
            adapter=adapter,
            adapter_options={} if adapter_options is None else adapter_options,
            simulation=Options() if simulation is None else simulation,
            traffic=traffic,
            action_mask=action_mask,
        )
    )
