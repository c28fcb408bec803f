"""Interfaces -> the rules that the step applies to each agent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from smarts.agents.interface import AgentInterface
from smarts.agents.options import InterfaceError
from smarts.errors import nearest_names
from smarts.types.actions import ActionSpaceType
from smarts.types.interface import AgentRules

NEVER = np.iinfo(np.int32).max
"""Larger than any episode length."""


def agent_rules(interfaces: Sequence[AgentInterface | None], dt: float = 0.1) -> AgentRules:
    """Return the rules for each agent.

    Args:
        interfaces: One interface per column, shape (A,); None for the defaults.
        dt: Length of a step [s].
    """
    rules = AgentRules.allocate(len(interfaces))
    for agent_id, interface in enumerate(interfaces):
        if interface is None:
            continue
        moving = interface.event_configuration
        rules.action[agent_id] = ActionSpaceType.Empty if interface.action is None else interface.action
        rules.ending[agent_id] = interface.done_criteria.events
        rules.max_steps[agent_id] = interface.max_episode_steps or 0
        rules.not_moving_steps[agent_id] = round(min(max(1.0, moving.not_moving_time / dt), NEVER))
        rules.not_moving_distance[agent_id] = moving.not_moving_distance
    return rules


@dataclass(frozen=True)
class AliveRule:
    """An agent ends when fewer than `minimum` of some agents are left."""

    agent_id: int
    counted: NDArray[np.bool_]
    """Shape (A,)."""
    minimum: int


def alive_rules(
    interfaces: Sequence[AgentInterface | None], names: Sequence[str], egos: int
) -> tuple[AliveRule, ...]:
    """Return one rule per `agents_alive` criterion.

    Args:
        interfaces: One interface per column, shape (A,).
        names: The egos' names; lists cannot name other agents, which come and go.
        egos: Number of egos; they come first.

    Raises:
        InterfaceError: A list names an unknown agent.
    """
    columns = np.arange(len(interfaces))
    rules: list[AliveRule] = []
    for agent_id, interface in enumerate(interfaces):
        criteria = interface and interface.done_criteria.agents_alive
        if not criteria:
            continue
        groups = [
            (columns < egos, criteria.minimum_ego_agents_alive),
            (columns >= 0, criteria.minimum_total_agents_alive),
            *(
                (
                    np.isin(columns, _agent_ids_of(alive.agents_list, names)),
                    alive.minimum_agents_alive_in_list,
                )
                for alive in criteria.agent_lists_alive or ()
            ),
        ]
        rules += [AliveRule(agent_id, counted, least) for counted, least in groups if least is not None]
    return tuple(rules)


def _agent_ids_of(wanted: Sequence[str], names: Sequence[str]) -> list[int]:
    for name in wanted:
        if name not in names:
            raise InterfaceError(
                f"there is no agent {name!r}",
                place="AgentsListAlive.agents_list",
                remedy=nearest_names(name, names),
            )
    return [names.index(name) for name in wanted]
