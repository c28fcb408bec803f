"""The recorder's copies out of a frame, in one call for all simulations.

Rows are floating-point numbers in the order of the columns of `smarts.types.episode_schema`; all its whole
numbers are exact in them. Axis letters: B simulations, A agents, V slots, L lanes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.geometry.compiling import kernel
from smarts.types.actions import Actions
from smarts.types.agent_states import UNSET, AgentStates, AgentStatus
from smarts.types.episode_schema import AGENT_STATES, DECISIONS, SIGNALS, VEHICLES
from smarts.types.events import Contacts, Events
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State, World

NEAR = 150.0
"""Vehicles this near to an agent are recorded [m]."""
FOR_A_WHILE = 15.0
"""A vehicle stays recorded for so long [s], so that no encounter is cut off."""

VEHICLE_ROWS, AGENT_ROWS, DECISION_ROWS, SIGNAL_ROWS, NEWCOMERS = range(5)
"""Columns of `Buffers.used`."""


_SHADOWING, _ACTIVE, _DONE = int(AgentStatus.SHADOWING), int(AgentStatus.ACTIVE), int(AgentStatus.DONE)
_LEAVING = int(AgentStatus.LEAVING)


class Buffers(NamedTuple):
    """Rows to be written, and the recorder's memory of each simulation."""

    vehicles: Floats
    """Shape (B, rows, columns), like those below."""
    agent_states: Floats
    decisions: Floats
    signals: Floats
    used: Ints
    """Number of rows in use, shape (B, 5)."""
    until: Ints
    """Step until which a slot's vehicle is recorded, near or not, shape (B, V)."""
    known: Ints
    """Generation that was recorded near an agent in each slot, 0 for none, shape (B, V)."""
    named: Ints
    """Generation that was recorded in each slot, 0 for none, shape (B, V)."""
    newcomers: Ints
    """Slots of vehicles that were recorded for the first time, shape (B, V)."""
    lights: Bytes
    """The last recorded signals, shape (B, L)."""
    most: Ints
    """The most vehicles at a time, shape (B,)."""
    decided: Ints
    """Step of each agent's newest decision, UNSET where it was taken, shape (B, A)."""

    @classmethod
    def allocate(cls, world: World, *, rows: int = 4096, everything: bool = False) -> Buffers:
        """Return empty buffers; one that is less than half full has room for the rows of a frame."""
        worlds, agents = world.agents.slot.shape
        capacity, lanes = world.vehicles.capacity, world.signals.shape[1]
        # Where there are many vehicles, larger blocks take fewer bytes in the file.
        near = max(4 * rows if everything else rows, capacity) + capacity
        return cls(
            vehicles=np.zeros((worlds, near, len(VEHICLES.columns))),
            agent_states=np.zeros((worlds, max(rows // 4, agents) + agents, len(AGENT_STATES.columns))),
            decisions=np.zeros((worlds, max(rows // 8, agents) + agents, len(DECISIONS.columns))),
            signals=np.zeros((worlds, max(rows // 8, lanes) + lanes, len(SIGNALS.columns))),
            used=np.zeros((worlds, 5), np.int32),
            until=np.zeros((worlds, capacity), np.int32),
            known=np.zeros((worlds, capacity), np.int32),
            named=np.zeros((worlds, capacity), np.int32),
            newcomers=np.zeros((worlds, capacity), np.int32),
            lights=np.zeros((worlds, lanes), np.int8),
            most=np.zeros(worlds, np.int32),
            decided=np.full((worlds, agents), UNSET, np.int32),
        )

    def clear(self, row: int) -> None:
        """Clear the buffers of one simulation."""
        for array in (self.used, self.until, self.known, self.named, self.lights, self.most):
            array[row] = 0
        self.decided[row] = UNSET


@kernel
def take_frame(
    state: State,
    keep: int,
    near: float,
    out: Buffers,
    events: Events,
    contacts: Contacts,
    actions: Actions,
    env_mask: Bools,
) -> bool:
    """Copy the rows of a frame that are recorded.

    Args:
        state: State of the world.
        keep: Steps for which a vehicle is recorded once it was near.
        near: Vehicles this near to an agent are recorded [m]; infinite: all are.
        out: Written; there is room for the rows of one frame.
        events: Events of the step.
        contacts: Contacts of the step.
        actions: Actions that led here; in the frame of a reset no action is fresh.
        env_mask: Which simulations the frame is of, shape (B,).

    Returns:
        Whether there are newcomers, or a buffer has no room for another frame, in any simulation.
    """
    step, vehicles, agents, signals = state.step, state.vehicles, state.agents, state.signals
    is_busy = False
    for row in range(len(env_mask)):
        if not env_mask[row]:
            continue
        out.used[row, NEWCOMERS] = 0
        _take_vehicles(step[row], row, vehicles, agents, keep, near, out)
        for agent_id in range(agents.state.shape[1]):
            if (
                agents.state[row, agent_id] in (_SHADOWING, _ACTIVE, _DONE, _LEAVING)
                and agents.slot[row, agent_id] >= 0
            ):
                into = out.agent_states[row, out.used[row, AGENT_ROWS]]
                _take_agent(step[row], row, agent_id, agents, events, contacts, into)
                out.used[row, AGENT_ROWS] += 1
            if actions.fresh[row, agent_id]:
                out.decided[row, agent_id] = step[row] - 1 - actions.age[row, agent_id]
            if out.decided[row, agent_id] >= 0:
                # The values stay where the action is not fresh any more.
                into = out.decisions[row, out.used[row, DECISION_ROWS]]
                _take_decision(out.decided[row, agent_id], row, agent_id, agents, actions, into)
                out.decided[row, agent_id] = UNSET
                out.used[row, DECISION_ROWS] += 1
        for lane in range(signals.shape[1]):
            if signals[row, lane] != out.lights[row, lane]:
                out.lights[row, lane] = signals[row, lane]
                into = out.signals[row, out.used[row, SIGNAL_ROWS]]
                into[0], into[1], into[2] = step[row], lane, signals[row, lane]
                out.used[row, SIGNAL_ROWS] += 1
        is_busy |= out.used[row, NEWCOMERS] > 0 or _is_full(row, agents.state.shape[1], out)
    return is_busy


@kernel
def _is_full(row: int, agents: int, out: Buffers) -> bool:
    """Return whether a buffer has no room for another frame."""
    used = out.used[row]
    return (
        used[VEHICLE_ROWS] + out.until.shape[1] > out.vehicles.shape[1]
        or used[AGENT_ROWS] + agents > out.agent_states.shape[1]
        or used[DECISION_ROWS] + agents > out.decisions.shape[1]
        or used[SIGNAL_ROWS] + out.lights.shape[1] > out.signals.shape[1]
    )


@kernel
def _take_vehicles(
    step: int, row: int, vehicles: VehicleStates, agents: AgentStates, keep: int, near: float, out: Buffers
) -> None:
    alive = 0
    for slot in range(vehicles.alive.shape[1]):
        if not vehicles.alive[row, slot]:
            continue
        alive += 1
        generation = vehicles.generation[row, slot]
        if near == np.inf or _is_near(row, slot, vehicles, agents, near):
            out.until[row, slot] = step + keep
            out.known[row, slot] = generation
        elif out.known[row, slot] != generation or step > out.until[row, slot]:
            continue
        if out.named[row, slot] != generation:
            out.named[row, slot] = generation
            out.newcomers[row, out.used[row, NEWCOMERS]] = slot
            out.used[row, NEWCOMERS] += 1
        _take_vehicle(step, row, slot, vehicles, out.vehicles[row, out.used[row, VEHICLE_ROWS]])
        out.used[row, VEHICLE_ROWS] += 1
    out.most[row] = max(out.most[row], alive)


@kernel
def _is_near(row: int, slot: int, vehicles: VehicleStates, agents: AgentStates, near: float) -> bool:
    """Return whether a vehicle is near one that an agent has."""
    for agent_id in range(agents.state.shape[1]):
        other = agents.slot[row, agent_id]
        if other < 0 or agents.state[row, agent_id] not in (_SHADOWING, _ACTIVE, _DONE, _LEAVING):
            continue
        dx = vehicles.position[row, other, 0] - vehicles.position[row, slot, 0]
        dy = vehicles.position[row, other, 1] - vehicles.position[row, slot, 1]
        if dx * dx + dy * dy <= near * near:
            return True
    return False


@kernel
def _take_vehicle(step: int, row: int, slot: int, vehicles: VehicleStates, into: Floats) -> None:
    """Copy one vehicle into a row of the table `vehicles`."""
    into[0], into[1], into[2] = step, slot, vehicles.generation[row, slot]
    into[3], into[4] = vehicles.owner[row, slot], vehicles.kind[row, slot]
    into[5], into[6] = vehicles.position[row, slot, 0], vehicles.position[row, slot, 1]
    into[7] = vehicles.heading[row, slot]
    into[8], into[9] = vehicles.speed[row, slot], vehicles.lateral_speed[row, slot]
    into[10], into[11] = vehicles.acceleration[row, slot], vehicles.lateral_acceleration[row, slot]
    into[12] = vehicles.yaw_rate[row, slot]
    into[13], into[14] = vehicles.length[row, slot], vehicles.width[row, slot]
    into[15], into[16] = vehicles.lane[row, slot], vehicles.lane_position[row, slot]
    into[17], into[18] = vehicles.lane_offset[row, slot], vehicles.route[row, slot]
    into[19] = vehicles.desired_speed[row, slot]


@kernel
def _take_agent(
    step: int, row: int, agent_id: int, agents: AgentStates, events: Events, contacts: Contacts, into: Floats
) -> None:
    """Copy one agent into a row of the table `agent_states`."""
    into[0], into[1], into[2] = step, agent_id, agents.state[row, agent_id]
    into[3], into[4] = agents.slot[row, agent_id], agents.generation[row, agent_id]
    into[5] = events.bits[row, agent_id]
    into[6], into[7] = contacts.partner[row, agent_id], contacts.partner_generation[row, agent_id]
    into[8], into[9] = agents.throttle[row, agent_id], agents.brake[row, agent_id]
    into[10] = agents.steering[row, agent_id]
    into[11], into[12] = agents.route_progress[row, agent_id], agents.remaining[row, agent_id]
    into[13], into[14] = agents.distance_travelled[row, agent_id], agents.lap[row, agent_id]
    into[15], into[16] = agents.target_lane[row, agent_id], agents.change_phase[row, agent_id]
    into[17], into[18] = _bits(agents.action_mask[row, agent_id]), agents.arrival_number[row, agent_id]
    into[19] = agents.release_step[row, agent_id]


@kernel
def _take_decision(
    step: int, row: int, agent_id: int, agents: AgentStates, actions: Actions, into: Floats
) -> None:
    """Copy one agent's action into a row of the table `decisions`."""
    into[0], into[1], into[2] = step, agent_id, actions.kind[row, agent_id]
    for number in range(8):
        into[3 + number] = actions.values[row, agent_id, number]
    into[11], into[12] = _bits(actions.action_mask[row, agent_id]), agents.effective[row, agent_id]


@kernel
def _bits(flags: Bools) -> int:
    bits = 0
    for number in range(len(flags)):
        if flags[number]:
            bits |= 1 << number
    return bits
