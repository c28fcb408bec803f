"""The reward kernel, batched over simulations and agents.

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
from smarts.types.agent_states import AgentStatus
from smarts.types.events import Events, Outcome
from smarts.types.mission import GoalKind
from smarts.types.vehicles import VehicleStates
from smarts.types.world import State

FAST = 60.0 / 3.6
"""Speed above which hard steering is penalised [m/s]."""
_FAST_BY = 20.0 / 3.6
_HARD = 4.0
_ENDLESS_UNIT = 100.0
"""Metres for which an agent without a goal gets what a mission of this length is worth."""
_ACTIVE, _ENDLESS, _GOAL = int(AgentStatus.ACTIVE), int(GoalKind.ENDLESS), int(Outcome.GOAL)


class Terms(NamedTuple):
    """Weights as the kernel takes them; see `RewardWeights`."""

    discount: float
    progress: float
    lane_change: float
    time: float
    """Weight of one decision."""
    each_step: float
    metres: float
    goal_distance: float
    approach: float
    centring: float
    neighbour_distance: float
    time_to_collision: float
    hard_steering: float
    by_outcome: Floats
    """Weight of each `Outcome`, shape (outcomes,)."""
    event: Ints
    """Bits of events that count where they do not end the episode, shape (E,)."""
    by_event: Floats
    """Their weights, shape (E,)."""
    always: Ints
    """Bits of the events that count even in the decision that ends the episode."""


class Memory(NamedTuple):
    """Each agent's values at its last decision, shape (B, G)."""

    initial: Floats
    """The larger of the route's length and the remaining distance at entry [m]; 0 before entry."""
    potential: Floats
    remaining: Floats
    """Distance to the goal along the route that was not driven on the road yet [m]; without a goal, minus the
    distance driven along the lanes."""
    goal_distance: Floats
    """Straight-line distance to the goal [m]."""
    centring: Floats
    """Distance to the lane's centre [m]."""
    neighbour_distance: Floats
    """Mean over the neighbors [m]."""
    time_to_collision: Floats
    """Mean over the neighbors [s]."""
    events: Ints
    """Bits of the events since the last decision."""
    steps: Ints
    """Steps since the last decision."""

    @classmethod
    def allocate(cls, worlds: int, agents: int) -> Memory:
        """Allocate zeroed reward state."""
        shape = (worlds, agents)
        floats = (np.zeros(shape) for _ in range(len(cls._fields) - 2))
        return cls(*floats, events=np.zeros(shape, np.int32), steps=np.zeros(shape, np.int32))


@kernel
def _event_reward(terms: Terms, happened: int, outcome: int) -> float:
    """Return the weights of a decision's events, and of the outcome unless it is -1."""
    reward = 0.0
    if outcome >= 0:
        reward += terms.by_outcome[outcome]
        happened &= terms.always[0]
    for event in range(len(terms.event)):
        if happened & terms.event[event]:
            reward += terms.by_event[event]
    return reward


@kernel
def near_traffic(
    vehicles: VehicleStates, b: int, own: int, found: Ints, squares: Floats
) -> tuple[float, float]:
    """Return mean distance [m] and mean time to collision [s] of the eight vehicles nearest to a vehicle.

    Missing neighbors count as at the radius with the longest time to collision, so the means are continuous
    when a vehicle enters or leaves the radius.

    Args:
        vehicles: All vehicles.
        b: The simulation.
        own: The vehicle's slot.
        found: Room for eight slots.
        squares: Room for eight numbers.
    """
    count = neighbors_within(vehicles, b, own, RADIUS, found, squares)
    mean_distance, mean_time = 0.0, 0.0
    for place in range(NEIGHBORS):
        distance, time = RADIUS, LONGEST_TIME
        if place < count:
            distance, time = distance_and_time(vehicles, b, own, found[place])
        mean_distance += distance / NEIGHBORS
        mean_time += time / NEIGHBORS
    return mean_distance, mean_time


@kernel
def _hard_steering(speed: float, steering: float) -> float:
    """Return the term of hard steering: 0 up to 60 km/h, then growing with speed and steering angle."""
    excess = max(0.0, speed - FAST) / _FAST_BY
    return (excess * steering / _HARD) ** 2


@kernel
def _potential_terms(
    terms: Terms, memory: Memory, state: State, b: int, g: int, a: int
) -> tuple[float, float, float, float]:
    """Return an agent's remaining distance, potential, distance to the goal, and to the lane's centre."""
    agents, vehicles, missions = state.agents, state.vehicles, state.missions
    own = agents.slot[b, a]
    left, potential, distance = agents.remaining[b, a] + agents.skipped[b, a], 0.0, 0.0
    if missions.goal[b, a] == _ENDLESS:
        left = agents.skipped[b, a] - agents.route_progress[b, a]
    else:
        potential = -terms.progress * min(1.0, max(0.0, left / memory.initial[b, g]))
        potential += terms.lane_change * min(MOST_LANE_CHANGES, abs(agents.lane_changes[b, a]))
        dx = missions.goal_position[b, a, 0] - vehicles.position[b, own, 0]
        dy = missions.goal_position[b, a, 1] - vehicles.position[b, own, 1]
        distance = math.sqrt(dx * dx + dy * dy)
    return left, potential, distance, abs(vehicles.lane_offset[b, own])


@kernel
def _reward(
    terms: Terms,
    memory: Memory,
    state: State,
    happened: Events,
    b: int,
    g: int,
    a: int,
    found: Ints,
    squares: Floats,
) -> float:
    """Return the reward of the decision that ends with this step, 0 at entry; write `memory`."""
    agents, vehicles, missions = state.agents, state.vehicles, state.missions
    own, is_first = agents.slot[b, a], memory.initial[b, g] == 0.0
    if is_first:
        # `remaining` is 0 for an agent that begins off its route; the potential must not jump on the route.
        length = max(agents.remaining[b, a], missions.route_length[b, a])
        memory.initial[b, g] = max(length, 1.0)
    left, potential, distance, aside = _potential_terms(terms, memory, state, b, g, a)
    near, soon = 0.0, 0.0
    if terms.neighbour_distance != 0.0 or terms.time_to_collision != 0.0:
        near, soon = near_traffic(vehicles, b, own, found, squares)
    reward = 0.0
    if not is_first:
        after = 0.0 if happened.terminated[b, a] else potential
        reward = terms.discount * after - memory.potential[b, g] + terms.time
        gain = memory.remaining[b, g] - left
        reward += terms.metres * gain
        if missions.goal[b, a] == _ENDLESS:
            reward += (terms.progress + terms.by_outcome[_GOAL]) * gain / _ENDLESS_UNIT
        reward += terms.goal_distance * distance * memory.steps[b, g]
        reward += terms.approach * (memory.goal_distance[b, g] - distance)
        reward += terms.centring * (memory.centring[b, g] - aside)
        reward += terms.neighbour_distance * (near - memory.neighbour_distance[b, g])
        reward += terms.time_to_collision * (soon - memory.time_to_collision[b, g])
        hard = _hard_steering(vehicles.speed[b, own], agents.steering[b, a])
        reward += terms.hard_steering * hard * memory.steps[b, g]
        reward += terms.each_step * memory.steps[b, g]
        ending = agents.outcome[b, a] if happened.just_done[b, a] else -1
        reward += _event_reward(terms, memory.events[b, g], ending)
    memory.potential[b, g], memory.remaining[b, g] = potential, left
    memory.goal_distance[b, g], memory.centring[b, g] = distance, aside
    memory.neighbour_distance[b, g], memory.time_to_collision[b, g] = near, soon
    memory.events[b, g], memory.steps[b, g] = 0, 0
    return reward


@kernel
def add_rewards(
    terms: Terms,
    memory: Memory,
    state: State,
    agent_ids: Ints,
    happened: Events,
    has_decided: Bools,
    rewards: Singles,
    env_mask: Bools,
    is_last: bool,
) -> None:
    """Accumulate one step, and write the reward of each agent whose decision ends with it.

    A decision ends with its last step, or with the agent's episode. An agent's first step ends no decision:
    only `memory` is written.

    Args:
        terms: The weights.
        memory: Values of the last decision; written.
        state: All simulations.
        agent_ids: The agents that are rewarded, shape (G,).
        happened: The events of this step.
        has_decided: Whether the agent's decision ends with this step; written, shape (B, G).
        rewards: Written, shape (B, G).
        env_mask: The simulations that made the step, shape (B,).
        is_last: Whether it is the last step of the decision.
    """
    agents = state.agents
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
                reward = _reward(terms, memory, state, happened, b, g, a, found, squares)
                if not is_first:
                    rewards[b, g] = reward
