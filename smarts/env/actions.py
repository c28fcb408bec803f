"""The way of agents' actions into a simulation: all are checked before any is written.

Every environment API uses it. The format of an action is that of the agent's action type, which its
controller declares, unless the agents' array adapter is an `ActionEncoding` too.

Axis letters: B simulations, A agents, G agents of a group, N chosen actions.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
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
from smarts.env.groups import AgentGroup
from smarts.types.actions import Actions
from smarts.types.agent_states import AgentStatus
from smarts.types.world import World


class Parsed(NamedTuple):
    """Checked actions of one format, which only have to be written."""

    format: ActionFormat
    numbers: Floats
    places: Places
    action_mask: Bools | None = None
    """Lane actions that were allowed at the decision, shape (N, 4); None: those allowed now."""
    age: Any = 0
    """Steps since the decision, a number or shape (N,)."""

    def write(self, out: Actions, action_mask: Bools) -> None:
        """Write the actions, and mark them as fresh; `action_mask` says what is allowed now, (B, A, 4)."""
        self.format.write(self.numbers, self.places, out)
        mask = action_mask[self.places] if self.action_mask is None else self.action_mask
        out.action_mask[self.places], out.age[self.places] = mask, self.age
        out.given[self.places] = out.fresh[self.places] = True

    def kept(self, action_mask: Bools, age: int) -> Parsed:
        """Return what can be written later, at an age: the world's masks change meanwhile."""
        return self._replace(action_mask=action_mask[self.places].copy(), age=age)

    def at(self, there: Bools) -> Parsed | None:
        """Return the actions of the agents in a mask, shape (B, A); None if there are none."""
        is_there = there[self.places]
        if np.all(is_there):
            return self
        if np.ndim(is_there) == 0 or not is_there.any():
            return None
        rows, agent_ids = self.places
        assert self.action_mask is not None
        return self._replace(
            numbers=self.numbers[is_there],
            places=(rows[is_there], agent_ids[is_there]),
            action_mask=self.action_mask[is_there],
        )


class Own(NamedTuple):
    """Actions of a group's agents for its adapter's own encoding."""

    group: AgentGroup
    given: NDArray
    """Shape (B, G, ...)."""
    chosen: Bools
    """Shape (B, G)."""
    age: int = 0
    """Steps since the decision."""

    def write(self, out: Actions, action_mask: Bools) -> None:
        """Let the adapter check and write the actions.

        Raises:
            ActionError: It rejects one.
        """
        encoding: Any = self.group.adapter
        encoding.encode(self.given, self.chosen, out)
        rows, columns = np.nonzero(self.chosen)
        out.age[rows, self.group.agent_ids[columns]] = self.age

    def kept(self, action_mask: Bools, age: int) -> Own:
        """Return what can be written later, at an age: the arrays are the caller's."""
        return self._replace(given=self.given.copy(), chosen=self.chosen.copy(), age=age)

    def at(self, there: Bools) -> Own:
        """Return the actions of the agents in a mask, shape (B, A)."""
        return self._replace(chosen=self.chosen & there[:, self.group.agent_ids])


@dataclass
class _Sent:
    """Actions on their way."""

    actions: list[Own | Parsed]
    due: Ints
    """Step of each simulation from which on they are carried out, shape (B,)."""
    left: Bools
    """Simulations in which they are not yet carried out, shape (B,)."""


class ActionEncoder:
    """Checks agents' actions, and writes them into the buffers of a simulation, at once or some steps later.

    Until an action arrives the last one that has is kept; before the first one, a vehicle is driven as before
    its agent's first decision. An action whose agent has ended meanwhile is dropped.

    Args:
        actions: The buffers, with the action types of all agents.
        world: The simulations.
        latency: Steps from an action to when it is carried out.
    """

    def __init__(self, actions: Actions, world: World, latency: int = 0) -> None:
        self._actions, self._world, self._latency = actions, world, latency
        self._most_points = actions.path.shape[2]
        self._sent: list[_Sent] = []

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
        found = action_format(group.context.action)
        numbers = found.parse_batch(given[rows, columns])
        if isinstance(numbers, Rejected):
            row, column = int(rows[numbers.first]), int(columns[numbers.first])
            place = place_of(group.agents[column], row if len(chosen) > 1 else None)
            raise rejection(given[row, column].tolist(), numbers.problem, place, found.remedy)
        return Parsed(found, numbers, (rows, group.agent_ids[columns]))

    def write(self, given: Iterable[Own | Parsed]) -> None:
        """Write actions, and mark them as fresh; with a latency, `release` does.

        Raises:
            ActionError: An adapter's own encoding rejects an action.
        """
        mask, world = self._world.agents.action_mask, self._world
        if self._latency:
            kept = [each.kept(mask, self._latency) for each in given]
            self._sent.append(_Sent(kept, world.step + self._latency, np.ones(world.worlds, np.bool_)))
            return
        # Own encodings first: they may still reject an action.
        for each in sorted(given, key=_is_checked):
            each.write(self._actions, mask)

    def forget(self, rows: Collection[int]) -> None:
        """Drop the actions of simulations in which other episodes begin."""
        for sent in self._sent:
            sent.left[[*rows]] = False

    def release(self, env_mask: Bools) -> None:
        """Write the actions that arrive before the next step of some simulations, shape (B,).

        Raises:
            ActionError: An adapter's own encoding rejects an action.
        """
        agents = self._world.agents
        for sent in self._sent:
            arrives = env_mask & sent.left & (sent.due <= self._world.step)
            if arrives.any():
                there = arrives[:, None] & (agents.state == int(AgentStatus.ACTIVE))
                arrived = [part for each in sent.actions if (part := each.at(there)) is not None]
                for each in sorted(arrived, key=_is_checked):
                    each.write(self._actions, agents.action_mask)
                sent.left &= ~arrives
        self._sent = [sent for sent in self._sent if sent.left.any()]


def _is_checked(given: Own | Parsed) -> bool:
    return isinstance(given, Parsed)


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
    if len(group.agents) == 1 and values.shape == (worlds, *shape[2:]):
        values = values[:, None]
    if values.shape != shape or values.dtype.kind not in "iuf":
        place = f"actions of {', '.join(group.agents)}"
        raise rejection(
            given, "is not an array of its agents' numbers", place, f"give an array of shape {shape}"
        )
    return values
