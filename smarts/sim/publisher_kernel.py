"""The publisher's copies out of a frame: the recorder's rows, of one simulation, with all of its vehicles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smarts.arrays import Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.sim.recorder_kernel import take_agent, take_decision, take_vehicle
from smarts.types.actions import Actions
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode_schema import AGENT_STATES, DECISIONS, VEHICLES
from smarts.types.events import Contacts, Events
from smarts.types.world import State

_VACANT, _WAITING = int(AgentStatus.VACANT), int(AgentStatus.WAITING)


class Rows(NamedTuple):
    """Rows of one simulation in one step, in the order of the schema's columns."""

    vehicles: Floats
    """Shape (V, columns); of those below (A, columns)."""
    agent_states: Floats
    decisions: Floats
    signals: Ints
    """Lane and light of the lanes that show one, shape (L, 2)."""
    newcomers: Ints
    """Slots of the vehicles that are not in `named`, shape (V,)."""
    used: Ints
    """How many rows of each of these are in use, shape (5,)."""
    named: Ints
    """Generation of the vehicle in each slot that was a newcomer once, 0 for none, shape (B, V)."""
    decided: Ints
    """Step of each agent's newest decision, UNSET where it was taken, shape (B, A)."""

    @classmethod
    def allocate(cls, capacity: int, worlds: int, lanes: int, agents: int) -> Rows:
        """Return room for V vehicles, B simulations, L lanes and A agents."""
        return cls(
            np.zeros((capacity, len(VEHICLES.columns))),
            np.zeros((agents, len(AGENT_STATES.columns))),
            np.zeros((agents, len(DECISIONS.columns))),
            np.zeros((lanes, 2), np.int32),
            np.zeros(capacity, np.int32),
            np.zeros(5, np.int32),
            np.zeros((worlds, capacity), np.int32),
            np.full((worlds, agents), UNSET, np.int32),
        )


@kernel
def take_row(state: State, out: Rows, events: Events, contacts: Contacts, actions: Actions, row: int) -> None:
    """Copy the vehicles, agents, decisions and lights of one simulation; `out` is written."""
    step, vehicles, agents = state.step[row], state.vehicles, state.agents
    out.used[:] = 0
    for slot in range(vehicles.alive.shape[1]):
        if vehicles.alive[row, slot]:
            take_vehicle(step, row, slot, vehicles, out.vehicles[out.used[0]])
            out.used[0] += 1
            if out.named[row, slot] != vehicles.generation[row, slot]:
                out.named[row, slot] = vehicles.generation[row, slot]
                out.newcomers[out.used[4]] = slot
                out.used[4] += 1
    for agent_id in range(agents.state.shape[1]):
        if agents.state[row, agent_id] not in (_VACANT, _WAITING) and agents.slot[row, agent_id] >= 0:
            take_agent(step, row, agent_id, agents, events, contacts, out.agent_states[out.used[1]])
            out.used[1] += 1
        if out.decided[row, agent_id] >= 0:
            # The values stay where the action is not fresh any more.
            decided = out.decided[row, agent_id]
            take_decision(decided, row, agent_id, agents, actions, out.decisions[out.used[2]])
            out.decided[row, agent_id] = UNSET
            out.used[2] += 1
    for lane in range(state.signals.shape[1]):
        if state.signals[row, lane]:
            out.signals[out.used[3], 0], out.signals[out.used[3], 1] = lane, state.signals[row, lane]
            out.used[3] += 1
