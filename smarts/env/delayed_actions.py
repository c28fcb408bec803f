"""Latency of actions: an action is carried out some steps after the agent has decided on it.

Axis letters: B simulations, A agents.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from smarts.arrays import Bools, Ints
from smarts.env.actions import ActionEncoder, Own, Parsed
from smarts.types.actions import Actions
from smarts.types.agent_states import AgentStatus
from smarts.types.world import World


@dataclass
class _Sent:
    """Actions on their way."""

    parsed: list[Parsed]
    own: list[Own]
    due: Ints
    """Step of each simulation from which on they are carried out, shape (B,)."""
    left: Bools
    """Simulations in which they are not yet carried out, shape (B,)."""


class DelayedEncoder(ActionEncoder):
    """Writes actions some steps after they were given.

    Until then the last action that has arrived is kept; before the first one, a vehicle is driven as before
    its agent's first decision. An action whose agent has ended meanwhile is dropped.

    Args:
        actions: The buffers, with the action types of all agents.
        world: The simulations.
        latency: Steps, 1 or more.
    """

    def __init__(self, actions: Actions, world: World, latency: int) -> None:
        super().__init__(actions, world.agents.action_mask)
        self._world, self._latency = world, latency
        self._sent: list[_Sent] = []

    def write(self, parsed: Iterable[Parsed], own: Sequence[Own] = ()) -> None:
        """Take actions, to be written by `release`."""
        # The arrays are the caller's or the world's, and change before the actions arrive.
        kept = [
            each._replace(action_mask=self._action_mask[each.places].copy(), age=self._latency)
            for each in parsed
        ]
        copied = [
            each._replace(given=each.given.copy(), chosen=each.chosen.copy(), age=self._latency)
            for each in own
        ]
        due = self._world.step + self._latency
        self._sent.append(_Sent(kept, copied, due, np.ones(len(due), np.bool_)))

    def forget(self, rows: Collection[int]) -> None:
        """Drop the actions of simulations in which other episodes begin."""
        for sent in self._sent:
            sent.left[[*rows]] = False

    def release(self, env_mask: Bools) -> None:
        """Write the actions that arrive before the next step of some simulations, shape (B,).

        Raises:
            ActionError: An adapter's own encoding rejects an action.
        """
        world = self._world
        for sent in self._sent:
            arrives = env_mask & sent.left & (sent.due <= world.step)
            if arrives.any():
                there = arrives[:, None] & (world.agents.state == int(AgentStatus.ACTIVE))
                parsed = [part for each in sent.parsed if (part := _chosen(each, there)) is not None]
                own = [each._replace(chosen=each.chosen & there[:, each.agent_ids]) for each in sent.own]
                super().write(parsed, own)
                sent.left &= ~arrives
        self._sent = [sent for sent in self._sent if sent.left.any()]


def _chosen(parsed: Parsed, there: Bools) -> Parsed | None:
    """Return the actions at the places of a mask, shape (B, A); None if there are none."""
    is_there = there[parsed.places]
    if np.all(is_there):
        return parsed
    if np.ndim(is_there) == 0 or not is_there.any():
        return None
    rows, agent_ids = parsed.places
    assert parsed.action_mask is not None
    return parsed._replace(
        numbers=parsed.numbers[is_there],
        places=(rows[is_there], agent_ids[is_there]),  # type: ignore[index]
        action_mask=parsed.action_mask[is_there],
    )
