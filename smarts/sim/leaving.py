"""Vehicles whose agent has ended: they stay until traffic takes them back, or until they are removed."""

from __future__ import annotations

import numpy as np

from smarts.arrays import Bools, Ints
from smarts.geometry.compiling import kernel
from smarts.types.agent_states import AgentStatus, ChangePhase
from smarts.types.events import Contacts, Outcome
from smarts.types.guidance import GuidePhase
from smarts.types.vehicles import Owner
from smarts.types.world import State

LONGEST_RELEASE = 5.0
"""Time without an open gate after which the fallback controller drives instead of the agent [s]."""

_VACANT, _WAITING = int(AgentStatus.VACANT), int(AgentStatus.WAITING)
_ACTIVE, _DONE, _LEAVING = int(AgentStatus.ACTIVE), int(AgentStatus.DONE), int(AgentStatus.LEAVING)
_AGENT, _COLLISION = int(Owner.AGENT), int(Outcome.COLLISION)
_FREE, _NO_CHANGE = int(GuidePhase.FREE), int(ChangePhase.NONE)


@kernel
def begin_leaving(state: State, env_mask: Bools) -> None:
    """Hand vehicles over to the fallback controller: of agents that are done, and that were to go long ago.

    Args:
        state: The state of the world; the agents and their guidance are written.
        env_mask: The simulations, shape (B,).
    """
    agents, vehicles = state.agents, state.vehicles
    for b in np.flatnonzero(env_mask):
        for a in range(agents.slot.shape[1]):
            slot = agents.slot[b, a]
            if slot < 0 or vehicles.owner[b, slot] != _AGENT:
                continue
            since = agents.release_step[b, a]
            is_done = agents.state[b, a] == _DONE
            is_late = since >= 0 and (state.step[b] - since) * state.dt > LONGEST_RELEASE
            if not (is_done or (agents.state[b, a] == _ACTIVE and is_late)):
                continue
            agents.state[b, a] = _LEAVING
            agents.harmed[b, a] = is_done and agents.outcome[b, a] == _COLLISION
            if since < 0 or agents.harmed[b, a]:
                agents.release_step[b, a] = state.step[b]
            agents.target_lane[b, a], agents.change_phase[b, a] = -1, _NO_CHANGE
            state.guidance.phase[b, a], state.guidance.speed[b, a] = _FREE, 0.0


@kernel
def drop_vanished(state: State, env_mask: Bools) -> None:
    """Vacate the columns of agents whose vehicle traffic has removed; they observed it.

    Args:
        state: The state of the world; the agents are written.
        env_mask: The simulations, shape (B,).
    """
    agents, vehicles = state.agents, state.vehicles
    for b in np.flatnonzero(env_mask):
        for a in range(agents.slot.shape[1]):
            slot = agents.slot[b, a]
            if slot < 0 or agents.state[b, a] in (_DONE, _WAITING):
                continue
            if not vehicles.alive[b, slot] or vehicles.generation[b, slot] != agents.generation[b, a]:
                agents.slot[b, a], agents.state[b, a], agents.release_step[b, a] = -1, _VACANT, -1


@kernel
def note_collisions(state: State, contacts: Contacts, env_mask: Bools) -> None:
    """Mark the vehicles of leaving agents that have collided in this step.

    Args:
        state: The state of the world; the agents are written.
        contacts: Contacts of the step.
        env_mask: The simulations, shape (B,).
    """
    agents = state.agents
    for b in np.flatnonzero(env_mask):
        for a in range(agents.slot.shape[1]):
            is_hit = agents.state[b, a] == _LEAVING and contacts.partner[b, a] >= 0
            if is_hit and not agents.harmed[b, a]:
                agents.harmed[b, a], agents.release_step[b, a] = True, state.step[b]


@kernel
def find_leavers(state: State, found: Ints, env_mask: Bools) -> int:
    """List the agents whose vehicles are to leave them, in some simulations; return how many there are.

    Args:
        state: The state of the world.
        found: Written: simulation and agent, shape (B A, 2).
        env_mask: The simulations, shape (B,).
    """
    agents, count = state.agents, 0
    for b in np.flatnonzero(env_mask):
        for a in range(agents.slot.shape[1]):
            status = agents.state[b, a]
            if agents.slot[b, a] >= 0 and (
                status in (_DONE, _LEAVING) or (status == _ACTIVE and agents.release_step[b, a] >= 0)
            ):
                found[count, 0], found[count, 1] = b, a
                count += 1
    return count
