"""The dict environment of agents with array adapters, with adapters of their specs on top."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Space

from smarts.agents.options import InterfaceError
from smarts.env.actions import Own, Parsed, element_of
from smarts.env.agent_notes import note_agents
from smarts.env.dict_env import DictEnv, StepResult
from smarts.env.groups import AgentGroup, make_groups, rewards_of
from smarts.env.observation_collector import ObservationCollector
from smarts.env.rendering import RenderMode
from smarts.env.runner import SimulationRunner, Transition
from smarts.env.settings import EnvSettings
from smarts.observations.action_mask import MASK
from smarts.observations.context import AdapterContext
from smarts.sensors.observation import Observation
from smarts.sim.assembly import Assembly
from smarts.types.actions import ActionSpaceType


class AdapterDictEnv(DictEnv):
    """One simulation whose agents have the settings' array adapter.

    An agent's spec may have adapters, which are applied on top: its observation adapter gets an
    `Observation` object instead of the arrays; its reward and info adapters get that object and the array
    adapter's reward; its action adapter returns an action as `HiWayEnv` takes it.

    Args:
        settings: Settings with one simulation.
        world: See `DictEnv`.
        render_mode: See `Renderer`.

    Raises:
        InterfaceError: A spec has an observation adapter without the space that it leads to.
    """

    def __init__(self, settings: EnvSettings, world: int = 0, render_mode: RenderMode | None = None) -> None:
        assembly, self._groups = make_groups(settings)
        adapters = [group.adapter for group in self._groups]
        runner = SimulationRunner(assembly, adapters, period=settings.decision_interval)
        note_agents(runner, self._groups, settings)
        self._places = {
            name: (number, place)
            for number, group in enumerate(self._groups)
            for place, name in enumerate(group.agents)
        }
        names, specs = [*self._places], settings.specs()
        super().__init__(runner, names, settings.interfaces(), specs, settings.seed, world, render_mode)
        self._encoded = {name for name in self._places if self._is_encoded(name)}
        self._rewards, self._masks = [0.0] * len(self._places), [None] * len(self._groups)
        self._collector = self._collect_objects(assembly)
        self.observation_spaces = {name: self._observation_space(name) for name in self.columns}
        self.action_spaces = {name: self._action_space(name) for name in self.columns}

    def _has_own(self, name: str, adapter: str) -> bool:
        return adapter in self.specs[name].own_adapters

    def _is_encoded(self, name: str) -> bool:
        """Return whether an agent acts in its adapter's own encoding."""
        return self._group(name).encoding is not None and not self._has_own(name, "action")

    def _group(self, name: str) -> AgentGroup:
        return self._groups[self._places[name][0]]

    def _collect_objects(self, assembly: Assembly) -> ObservationCollector | None:
        """Return a listener that makes observations for the agents with adapters of their own."""
        names = [name for name in self.columns if self.specs[name].own_adapters]
        if not names:
            return None
        agent_ids = np.array([self.columns[name] for name in names], np.int32)
        context = AdapterContext(
            assembly.scene, tuple(names), agent_ids, ActionSpaceType.Empty, self.runner.period, max_steps=0
        )
        collector = ObservationCollector(context)
        self.runner.listen(collector)
        return collector

    def _observation_space(self, name: str) -> Space:
        if not self._has_own(name, "observation"):
            return self._group(name).observation
        space = self.specs[name].observation_space
        if not isinstance(space, Space):
            raise InterfaceError(
                f"agent {name!r} has an observation adapter, and its observation_space is {space!r}",
                place="AgentSpec.observation_space",
                remedy="give the Gymnasium space of what the adapter returns, or use HiWayEnv",
            )
        return space

    def _action_space(self, name: str) -> Space:
        space = self.specs[name].action_space if self._has_own(name, "action") else None
        return self._group(name).action if space is None else space

    def _parse(self, actions: Mapping[str, Any]) -> tuple[list[Parsed], list[Own]]:
        """Check the actions of active agents; return actions in an adapter's own encoding apart."""
        parsed, _ = super()._parse({n: a for n, a in actions.items() if n not in self._encoded})
        groups = self._groups if self._encoded else ()
        return parsed, [self._own(group, actions) for group in groups if group.encoding is not None]

    def _own(self, group: AgentGroup, actions: Mapping[str, Any]) -> Own:
        """Return the actions of a group's active agents in its adapter's own encoding."""
        given = np.zeros((1, len(group.agents), *(group.action.shape or ())), group.action.dtype)
        chosen = np.zeros((1, len(group.agents)), np.bool_)
        for place, name in enumerate(group.agents):
            if name in actions and name in self._encoded and self.runner.alive[0, self.columns[name]]:
                given[0, place] = element_of(group, name, actions[name])
                chosen[0, place] = True
        encoding: Any = group.encoding
        return Own(encoding, given, chosen, group.agent_ids)

    def _step_result(self, transition: Transition) -> StepResult:
        self._rewards = rewards_of(self._groups, transition.acted)[0].tolist()
        self._read_masks()
        return super()._step_result(transition)

    def _first_infos(self, agents: Collection[str]) -> dict[str, Any]:
        self._read_masks()
        return {name: self._with_mask(name, {}) for name in agents}

    def _reward_and_info(self, name: str, acted: bool, info: dict[str, Any]) -> tuple[Any, Any]:
        reward, spec = self._rewards[self.columns[name]], self.specs[name]
        if not spec.own_adapters:
            return reward, self._with_mask(name, info)
        seen = self._object(name)
        info["score"] = float(self.runner.world.agents.distance_travelled[0, self.columns[name]])
        adapted = self._with_mask(name, spec.info_adapter(seen, reward, info))
        if not acted:
            return reward, adapted
        return spec.reward_adapter(seen, reward), adapted

    def _read_masks(self) -> None:
        self._masks = [group.action_mask() for group in self._groups]

    def _with_mask(self, name: str, info: Any) -> Any:
        """Return an info with the mask of the agent's actions, if it has one and the info is a mapping."""
        number, place = self._places[name]
        mask = self._masks[number]
        if mask is None or self._has_own(name, "action") or not isinstance(info, Mapping):
            return info
        # As `Discrete.sample(mask)` takes it.
        return {**info, MASK: mask[0, place].astype(np.int8)}

    def _observation(self, name: str) -> Any:
        if self._has_own(name, "observation"):
            return self.specs[name].observation_adapter(self._object(name))
        number, place = self._places[name]
        return self._groups[number].observe(0, place)

    def _object(self, name: str) -> Observation:
        # There is a collector if any agent has adapters.
        return self._collector.seen[self.columns[name]]  # type: ignore[union-attr]
