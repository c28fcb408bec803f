"""The way of agents' actions into a simulation: all are checked before any is written.

Every environment API uses it. The format of an action is that of the agent's action type, which its
controller declares, unless the agents' array adapter is an `ActionEncoding` too.

Axis letters: B simulations, A agents, G agents of a group, N chosen actions.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from smarts.arrays import Bools, Floats, Ints
from smarts.controllers import action_format
from smarts.controllers.action_formats import (
    ActionFormat,
    Places,
    Rejected,
    numbers_of,
    rejection,
)
from smarts.env.groups import ActionEncoding, AgentGroup
from smarts.types.actions import Actions


class Parsed(NamedTuple):
    """Checked actions of one format, which only have to be written."""

    format: ActionFormat
    numbers: Floats
    places: Places
    action_mask: Bools | None = None
    """Lane actions that were allowed at the decision, shape (N, 4); None: those allowed now."""
    age: Any = 0
    """Steps since the decision, a number or shape (N,)."""


class Own(NamedTuple):
    """Actions for an adapter's own encoding."""

    encoding: ActionEncoding
    given: NDArray
    """Shape (B, G, ...)."""
    chosen: Bools
    """Shape (B, G)."""
    agent_ids: Ints
    """Rows of `AgentStates`, shape (G,)."""
    age: int = 0
    """Steps since the decision."""


class ActionEncoder:
    """Checks agents' actions, and writes them into the buffers of a simulation.

    Args:
        actions: The buffers, with the action types of all agents.
        action_mask: Which lane actions are allowed now, shape (B, A, 4).
    """

    def __init__(self, actions: Actions, action_mask: Bools) -> None:
        self._actions, self._action_mask = actions, action_mask
        self._most_points = actions.path.shape[2]

    def parse(self, agent: str, action: Any, row: int, agent_id: int) -> Parsed:
        """Check one agent's action, given as users do: numbers, a lane action's name, a tuple of columns.

        Args:
            agent: Its name, for errors.
            action: The action.
            row: Its simulation.
            agent_id: The agent.

        Raises:
            ActionError: The action is not of the agent's type, or not finite.
        """
        found = action_format(int(self._actions.kind[row, agent_id]))
        return Parsed(found, found.parse(action, place_of(agent), self._most_points), (row, agent_id))

    def parse_group(self, group: AgentGroup, given: NDArray, chosen: Bools) -> Parsed:
        """Check the chosen agents' actions, given as an array of shape (B, G, ...).

        Raises:
            ActionError: An action is not finite, or not one of a discrete space.
        """
        rows, columns = np.nonzero(chosen)
        found = action_format(group.kind)
        numbers = found.parse_batch(given[rows, columns])
        if isinstance(numbers, Rejected):
            row, column = int(rows[numbers.first]), int(columns[numbers.first])
            place = place_of(group.agents[column], row if len(chosen) > 1 else None)
            raise rejection(given[row, column].tolist(), numbers.problem, place, found.remedy)
        return Parsed(found, numbers, (rows, group.agent_ids[columns]))

    def write(self, parsed: Iterable[Parsed], own: Sequence[Own] = ()) -> None:
        """Write actions, and mark them as fresh.

        Raises:
            ActionError: An adapter's own encoding rejects an action.
        """
        actions = self._actions
        for encoding, given, chosen, agent_ids, age in own:
            encoding.encode(given, chosen, actions)
            rows, columns = np.nonzero(chosen)
            actions.age[rows, agent_ids[columns]] = age
        for each in parsed:
            each.format.write(each.numbers, each.places, actions)
            mask = self._action_mask[each.places] if each.action_mask is None else each.action_mask
            actions.action_mask[each.places], actions.age[each.places] = mask, each.age
            actions.given[each.places] = actions.fresh[each.places] = True


def place_of(agent: str, row: int | None = None) -> str:
    """Return what errors call an agent's action, in one of several simulations."""
    return f"action of {agent!r}" + ("" if row is None else f" in simulation {row}")


def element_of(group: AgentGroup, agent: str, action: Any) -> NDArray:
    """Return one agent's action as an element of its adapter's own space, in that space's type.

    Raises:
        ActionError: It is not made of finite numbers of the space's shape; for integers, of whole numbers.
    """
    place, space, remedy = place_of(agent), group.action, f"give an element of {group.action}"
    values = numbers_of(action, space.shape or (), place, lambda: remedy)
    if np.issubdtype(space.dtype, np.integer) and (values != np.round(values)).any():
        raise rejection(action, "is not made of whole numbers", place, remedy)
    return values.astype(space.dtype)


def arrays_of(actions: Any, groups: Sequence[AgentGroup], worlds: int) -> list[NDArray]:
    """Return numeric arrays of shape (B, G, ...) for each group.

    Args:
        actions: A list of an array for each group, or groups of one size stacked; of any array library.
        groups: Groups in the order of their columns.
        worlds: B.

    Raises:
        ActionError: There are not as many arrays as groups, or one is not of its group's numbers.
    """
    blocks = actions if isinstance(actions, Sequence) else np.atleast_1d(actions)
    if len(blocks) != len(groups):
        remedy = f"give an array for each of {len(groups)} blocks of agents"
        raise rejection(actions, "is not a list of an array for each block", "actions", remedy)
    return [_numeric(group, given, worlds) for group, given in zip(groups, blocks, strict=True)]


def _numeric(group: AgentGroup, given: ArrayLike, worlds: int) -> NDArray:
    shape = (worlds, len(group.agents), *(group.action.shape or ()))
    try:
        values = np.asarray(given)
    except ValueError:  # its rows are of different lengths
        values = np.empty(0)
    if values.shape != shape or values.dtype.kind not in "iuf":
        place = f"actions of {', '.join(group.agents)}"
        raise rejection(
            given, "is not an array of its agents' numbers", place, f"give an array of shape {shape}"
        )
    return values
