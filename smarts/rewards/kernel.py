"""What decisions are worth, for many agents at once.

Axis letters: B simulations, G agents that are rewarded together, A agents, V vehicle slots.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Floats, Ints, Singles
from smarts.geometry.compiling import kernel
from smarts.observations.neighbor_sectors import distance_and_time
from smarts.observations.neighbors import NEIGHBORS, neighbors_within
from smarts.observations.scales import LONGEST_TIME, MOST_LANE_CHANGES, RADIUS
from smarts.types.agent_states import AgentStates, AgentStatus
from smarts.types.events import Events
from smarts.types.mission import Missions
from smarts.types.vehicles import VehicleStates

FAST = 60.0 / 3.6
"""Speed above which hard steering is penalised [m/s]."""
_FAST_BY = 20.0 / 3.6
_HARD = 4.0
_ACTIVE = int(AgentStatus.ACTIVE)


class Terms(NamedTuple):
    """Weights as the kernel takes them."""

    by_outcome: Floats
    """Of each `Outcome`, shape (outcomes,)."""
    event: Ints
    """Bits of events that count where they do not end the episode, shape (E,)."""
    by_event: Floats
    """Their weights, shape (E,)."""
    always: Ints
    """Bits of those events that count even in the decision that ends the episode."""
    shares: Floats
    """discount, progress, lane_change, time of one decision, each_step, metres, goal_distance, approach,
    centring, neighbour_distance, time_to_collision, hard_steering."""


class Memory(NamedTuple):
    """What the reward remembers of each agent from one decision to the next, shape (B, G)."""

    initial: Floats
    """Length of the agent's route, or what was left of it at entry if that is more [m]; 0 before."""
    potential: Floats
    """At the last decision."""
    remaining: Floats
    """Of the route at the last decision [m]."""
    goal_distance: Floats
    """At the last decision [m]."""
    centring: Floats
    """Distance to the lane's centre at the last decision [m]."""
    neighbour_distance: Floats
    """Mean over the neighbors at the last decision [m]."""
    time_to_collision: Floats
    """Mean over the neighbors at the last decision [s]."""
    events: Ints
    """Bits of what has happened since then."""
    steps: Ints
    """Since then."""

    @classmethod
    def allocate(cls, worlds: int, agents: int) -> Memory:
        """Allocate zeroed reward state."""
        shape = (worlds, agents)
        floats = (np.zeros(shape) for _ in range(len(cls._fields) - 2))
        return cls(*floats, events=np.zeros(shape, np.int32), steps=np.zeros(shape, np.int32))


@kernel
def _worth_of_events(terms: Terms, happened: int, outcome: int) -> float:
    """Return the weights of a decision's events, and of the outcome unless it is -1."""
    worth = 0.0
    if outcome >= 0:
        worth += terms.by_outcome[outcome]
        happened &= terms.always[0]
    for event in range(len(terms.event)):
        if happened & terms.event[event]:
            worth += terms.by_event[event]
    return worth


@kernel
def near_traffic(
    vehicles: VehicleStates, b: int, own: int, found: Ints, squares: Floats
) -> tuple[float, float]:
    """Return mean distance [m] and mean time to collision [s] of the eight vehicles nearest to one.

    Where there are fewer within the radius, the others count as at the radius, and as never met: so nothing
    jumps when a vehicle enters or leaves the radius.

    Args:
        vehicles: All vehicles.
        b: The simulation.
        own: The vehicle's slot.
        found: Room for eight slots.
        squares: Room for eight numbers.
    """
    count = neighbors_within(vehicles, b, own, found, squares)
    mean_distance, mean_time = 0.0, 0.0
    for place in range(NEIGHBORS):
        distance, time = RADIUS, LONGEST_TIME
        if place < count:
            distance, time = distance_and_time(vehicles, b, own, found[place])
        mean_distance += distance / NEIGHBORS
        mean_time += time / NEIGHBORS
    return mean_distance, mean_time


@kernel
def _hardness(speed: float, steering: float) -> float:
    """Return how hard a vehicle steers at speed: 0 up to 60 km/h, then growing with both."""
    excess = max(0.0, speed - FAST) / _FAST_BY
    return (excess * steering / _HARD) ** 2


@kernel
def _standing(
    terms: Terms,
    memory: Memory,
    agents: AgentStates,
    vehicles: VehicleStates,
    missions: Missions,
    b: int,
    g: int,
    a: int,
) -> tuple[float, float, float, float]:
    """Return an agent's remaining metres, potential, distance to the goal, and to the lane's centre."""
    own = agents.slot[b, a]
    left, potential, distance = agents.remaining[b, a], 0.0, 0.0
    if missions.goal[b, a] != 0:
        progress, lane_change = terms.shares[1], terms.shares[2]
        potential = -progress * min(1.0, max(0.0, left / memory.initial[b, g]))
        potential += lane_change * min(MOST_LANE_CHANGES, abs(agents.lane_changes[b, a]))
        dx = missions.goal_position[b, a, 0] - vehicles.position[b, own, 0]
        dy = missions.goal_position[b, a, 1] - vehicles.position[b, own, 1]
        distance = math.sqrt(dx * dx + dy * dy)
    return left, potential, distance, abs(vehicles.lane_offset[b, own])


@kernel
def _reward(
    terms: Terms,
    memory: Memory,
    agents: AgentStates,
    vehicles: VehicleStates,
    missions: Missions,
    happened: Events,
    b: int,
    g: int,
    a: int,
    found: Ints,
    squares: Floats,
) -> float:
    """Return the reward of the decision that ends here, 0 if there was none; remember the rest."""
    discount, _, _, time, each_step, metres, far, approach, centring, apart, meeting, hard = terms.shares
    own, is_first = agents.slot[b, a], memory.initial[b, g] == 0.0
    if is_first:
        # Nothing remains for an agent that begins off its route; the potential must not jump on the route.
        length = max(agents.remaining[b, a], missions.route_length[b, a])
        memory.initial[b, g] = max(length, 1.0)
    left, potential, distance, aside = _standing(terms, memory, agents, vehicles, missions, b, g, a)
    near, soon = 0.0, 0.0
    if apart != 0.0 or meeting != 0.0:
        near, soon = near_traffic(vehicles, b, own, found, squares)
    reward = 0.0
    if not is_first:
        after = 0.0 if happened.terminated[b, a] else potential
        reward = discount * after - memory.potential[b, g] + time
        reward += metres * (memory.remaining[b, g] - left)
        reward += far * distance * memory.steps[b, g]
        reward += approach * (memory.goal_distance[b, g] - distance)
        reward += centring * (memory.centring[b, g] - aside)
        reward += apart * (near - memory.neighbour_distance[b, g])
        reward += meeting * (soon - memory.time_to_collision[b, g])
        reward += hard * _hardness(vehicles.speed[b, own], agents.steering[b, a]) * memory.steps[b, g]
        reward += each_step * memory.steps[b, g]
        ending = agents.outcome[b, a] if happened.just_done[b, a] else -1
        reward += _worth_of_events(terms, memory.events[b, g], ending)
    memory.potential[b, g], memory.remaining[b, g] = potential, left
    memory.goal_distance[b, g], memory.centring[b, g] = distance, aside
    memory.neighbour_distance[b, g], memory.time_to_collision[b, g] = near, soon
    memory.events[b, g], memory.steps[b, g] = 0, 0
    return reward


@kernel
def add_rewards(
    terms: Terms,
    memory: Memory,
    agent_ids: Ints,
    agents: AgentStates,
    vehicles: VehicleStates,
    missions: Missions,
    happened: Events,
    has_decided: Bools,
    rewards: Singles,
    env_mask: Bools,
    is_last: bool,
) -> None:
    """Accumulate one step, and write the reward of each agent whose decision ends with it.

    A decision ends with its last step, and before with the agent's episode. In an agent's first step nothing
    has been decided: its state is only remembered.

    Args:
        terms: The weights.
        memory: Since the last decision.
        agent_ids: The agents that are rewarded, shape (G,).
        agents: Of all agents.
        vehicles: All vehicles.
        missions: Of all agents.
        happened: In this step.
        has_decided: Whether the agent's decision ends with this step; written, shape (B, G).
        rewards: Written, shape (B, G).
        env_mask: The simulations that made the step, shape (B,).
        is_last: Whether it is the last step of the decision.
    """
    found, squares = np.empty(NEIGHBORS, np.int32), np.empty(NEIGHBORS)
    for b in range(len(env_mask)):
        for g in range(len(agent_ids)):
            a, is_first = agent_ids[g], memory.initial[b, g] == 0.0
            ends = happened.just_done[b, a]
            is_here = ends or (env_mask[b] and agents.state[b, a] == _ACTIVE)
            has_decided[b, g] = ends or (is_here and is_last)
            if not is_here:
                continue
            memory.events[b, g] |= happened.bits[b, a]
            memory.steps[b, g] += 1
            if has_decided[b, g] or is_first:
                reward = _reward(terms, memory, agents, vehicles, missions, happened, b, g, a, found, squares)
                if not is_first:
                    rewards[b, g] = reward
