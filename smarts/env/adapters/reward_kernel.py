"""What decisions are worth, for many agents at once.

Axis letters: B simulations, G agents of the adapter, A agents, V vehicle slots.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from smarts.env.adapters.features import NEIGHBOURS, RADIUS
from smarts.env.adapters.situation import MOST_LANE_CHANGES
from smarts.geometry.compiling import kernel
from smarts.types.agent_states import AgentStatus

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]
Bytes = NDArray[np.int8]
Bools = NDArray[np.bool_]

LONGEST_TIME = 5.0
"""Times to collision are cut at this [s]."""
FAST = 60.0 / 3.6
"""Speed above which steering hard costs something [m/s]."""
_FAST_BY = 20.0 / 3.6
_HARD = 4.0
_ACTIVE = int(AgentStatus.ACTIVE)


class Terms(NamedTuple):
    """Weights as the kernel takes them."""

    by_outcome: Floats
    """What each `Outcome` is worth, shape (outcomes,)."""
    event: Ints
    """Bits of events that count where they do not end the episode, shape (E,)."""
    by_event: Floats
    """What they are worth, shape (E,)."""
    always: Ints
    """Bits of those events that count even in the decision that ends the episode."""
    shares: Floats
    """discount, progress, lane_change, time of one decision, each_step, metres, goal_distance, approach,
    centring, neighbour_distance, time_to_collision, hard_steering."""


class Memory(NamedTuple):
    """What the reward remembers of each agent from one decision to the next, shape (B, G)."""

    initial: Floats
    """Length of the agent's route, or what was left of it when it entered if that is more [m]; 0 before."""
    potential: Floats
    """At the last decision."""
    remaining: Floats
    """Of the route at the last decision [m]."""
    goal_distance: Floats
    """At the last decision [m]."""
    centring: Floats
    """Distance to the lane's centre at the last decision [m]."""
    neighbour_distance: Floats
    """Mean over the neighbours at the last decision [m]."""
    time_to_collision: Floats
    """Mean over the neighbours at the last decision [s]."""
    events: Ints
    """Bits of what has happened since then."""
    steps: Ints
    """Since then."""

    @classmethod
    def allocate(cls, worlds: int, agents: int) -> Memory:
        """Return memories of nobody."""
        shape = (worlds, agents)
        return cls(
            initial=np.zeros(shape),
            potential=np.zeros(shape),
            remaining=np.zeros(shape),
            goal_distance=np.zeros(shape),
            centring=np.zeros(shape),
            neighbour_distance=np.zeros(shape),
            time_to_collision=np.zeros(shape),
            events=np.zeros(shape, np.int32),
            steps=np.zeros(shape, np.int32),
        )


class EgoColumns(NamedTuple):
    """Columns of `AgentStates`, shape (B, A)."""

    slot: Ints
    state: Bytes
    outcome: Bytes
    remaining: Floats
    lane_changes: Bytes
    steering: Floats


class Missions(NamedTuple):
    """Columns of the agents' missions, shape (B, A)."""

    goal: Bytes
    goal_position: Floats
    route_length: Floats


class Driving(NamedTuple):
    """Columns of `VehicleStates`, shape (B, V)."""

    alive: Bools
    position: Floats
    heading: Floats
    speed: Floats
    lateral_speed: Floats
    lane_offset: Floats


class Happened(NamedTuple):
    """Columns of a step's `Events`, shape (B, A)."""

    bits: Ints
    just_done: Bools
    terminated: Bools


@kernel
def _worth_of_events(terms: Terms, happened: int, outcome: int) -> float:
    """Return what a decision's events are worth, and the outcome unless it is -1."""
    worth = 0.0
    if outcome >= 0:
        worth += terms.by_outcome[outcome]
        happened &= terms.always[0]
    for event in range(len(terms.event)):
        if happened & terms.event[event]:
            worth += terms.by_event[event]
    return worth


@kernel
def _speed_along(driving: Driving, b: int, slot: int, dx: float, dy: float) -> float:
    """Return the part of a vehicle's velocity along a vector, times the vector's length [m^2/s]."""
    cosine, sine = math.cos(driving.heading[b, slot]), math.sin(driving.heading[b, slot])
    ahead, aside = driving.speed[b, slot], driving.lateral_speed[b, slot]
    return (ahead * cosine - aside * sine) * dx + (ahead * sine + aside * cosine) * dy


@kernel
def _distance_and_time(driving: Driving, b: int, own: int, other: int) -> tuple[float, float]:
    """Return how far a vehicle is away, and when they meet if they go on closing in like this."""
    dx = driving.position[b, other, 0] - driving.position[b, own, 0]
    dy = driving.position[b, other, 1] - driving.position[b, own, 1]
    distance = math.sqrt(dx * dx + dy * dy)
    closing = _speed_along(driving, b, own, dx, dy) - _speed_along(driving, b, other, dx, dy)
    closing /= max(distance, 1e-6)
    time = distance / closing if closing > 0.0 else LONGEST_TIME
    return distance, min(time, LONGEST_TIME)


@kernel
def near_traffic(driving: Driving, b: int, own: int, distances: Floats, times: Floats) -> tuple[float, float]:
    """Return mean distance [m] and mean time to collision [s] of the eight vehicles nearest to one.

    Where there are fewer within the radius, the others count as at the radius, and as never met: so nothing
    leaps when a vehicle comes into sight or leaves.

    Args:
        driving: All vehicles.
        b: The simulation.
        own: The vehicle's slot.
        distances: Room for those of eight.
        times: Room for those of eight.
    """
    distances[:], times[:] = RADIUS, LONGEST_TIME
    for slot in range(driving.alive.shape[1]):
        if slot == own or not driving.alive[b, slot]:
            continue
        distance, time = _distance_and_time(driving, b, own, slot)
        place = NEIGHBOURS
        while place > 0 and distance < distances[place - 1]:
            place -= 1
        for later in range(NEIGHBOURS - 1, place, -1):
            distances[later], times[later] = distances[later - 1], times[later - 1]
        if place < NEIGHBOURS:
            distances[place], times[place] = distance, time
    distance, time = 0.0, 0.0
    for place in range(NEIGHBOURS):
        distance += distances[place] / NEIGHBOURS
        time += times[place] / NEIGHBOURS
    return distance, time


@kernel
def _hardness(speed: float, steering: float) -> float:
    """Return how hard a vehicle steers at speed: 0 up to 60 km/h, then growing with both."""
    excess = max(0.0, speed - FAST) / _FAST_BY
    return (excess * steering / _HARD) ** 2


@kernel
def _standing(
    terms: Terms,
    memory: Memory,
    egos_now: EgoColumns,
    missions: Missions,
    driving: Driving,
    b: int,
    g: int,
    agent_id: int,
) -> tuple[float, float, float, float]:
    """Return where an agent stands: remaining metres, potential, distance to the goal, and to the centre."""
    own = egos_now.slot[b, agent_id]
    left, potential, distance = egos_now.remaining[b, agent_id], 0.0, 0.0
    if missions.goal[b, agent_id] != 0:
        progress, lane_change = terms.shares[1], terms.shares[2]
        potential = -progress * min(1.0, max(0.0, left / memory.initial[b, g]))
        potential += lane_change * min(MOST_LANE_CHANGES, abs(egos_now.lane_changes[b, agent_id]))
        dx = missions.goal_position[b, agent_id, 0] - driving.position[b, own, 0]
        dy = missions.goal_position[b, agent_id, 1] - driving.position[b, own, 1]
        distance = math.sqrt(dx * dx + dy * dy)
    return left, potential, distance, abs(driving.lane_offset[b, own])


@kernel
def _settle(
    terms: Terms,
    memory: Memory,
    egos_now: EgoColumns,
    missions: Missions,
    driving: Driving,
    happened: Happened,
    b: int,
    g: int,
    agent_id: int,
    distances: Floats,
    times: Floats,
) -> float:
    """Return what the decision that ends here is worth, 0 if there was none; remember the rest."""
    discount, _, _, time, each_step, metres, far, approach, centring, apart, meeting, hard = terms.shares
    own, is_first = egos_now.slot[b, agent_id], memory.initial[b, g] == 0.0
    if is_first:
        # Nothing remains for who begins off its route; the potential must not leap when it gets there.
        length = max(egos_now.remaining[b, agent_id], missions.route_length[b, agent_id])
        memory.initial[b, g] = max(length, 1.0)
    left, potential, distance, aside = _standing(terms, memory, egos_now, missions, driving, b, g, agent_id)
    near, soon = 0.0, 0.0
    if apart != 0.0 or meeting != 0.0:
        near, soon = near_traffic(driving, b, own, distances, times)
    reward = 0.0
    if not is_first:
        after = 0.0 if happened.terminated[b, agent_id] else potential
        reward = discount * after - memory.potential[b, g] + time
        reward += metres * (memory.remaining[b, g] - left)
        reward += far * distance * memory.steps[b, g]
        reward += approach * (memory.goal_distance[b, g] - distance)
        reward += centring * (memory.centring[b, g] - aside)
        reward += apart * (near - memory.neighbour_distance[b, g])
        reward += meeting * (soon - memory.time_to_collision[b, g])
        reward += hard * _hardness(driving.speed[b, own], egos_now.steering[b, agent_id]) * memory.steps[b, g]
        reward += each_step * memory.steps[b, g]
        ending = egos_now.outcome[b, agent_id] if happened.just_done[b, agent_id] else -1
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
    egos_now: EgoColumns,
    missions: Missions,
    driving: Driving,
    happened: Happened,
    settled: Bools,
    rewards: Singles,
    env_mask: Bools,
    is_last: bool,
) -> None:
    """Take one step in, and write the reward of the decision for those with whom it ends.

    It ends for all who are there with its last step, and before for those whose episode ends. Who is met for
    the first time is only remembered: nothing was decided so far.

    Args:
        terms: The weights.
        memory: Of the last decision.
        agent_ids: The adapter's agents, shape (G,).
        egos_now: Of all agents.
        missions: Of all agents.
        driving: All vehicles.
        happened: In this step.
        settled: Whose decision ends with this step; written, shape (B, G).
        rewards: Written, shape (B, G).
        env_mask: Which simulations made the step, shape (B,).
        is_last: Whether it is the last of the decision.
    """
    distances, times = np.empty(NEIGHBOURS), np.empty(NEIGHBOURS)
    for b in range(len(env_mask)):
        for g in range(len(agent_ids)):
            agent_id, is_first = agent_ids[g], memory.initial[b, g] == 0.0
            ends = happened.just_done[b, agent_id]
            is_here = ends or (env_mask[b] and egos_now.state[b, agent_id] == _ACTIVE)
            settled[b, g] = ends or (is_here and is_last)
            if not is_here:
                continue
            memory.events[b, g] |= happened.bits[b, agent_id]
            memory.steps[b, g] += 1
            if settled[b, g] or is_first:
                reward = _settle(
                    terms, memory, egos_now, missions, driving, happened, b, g, agent_id, distances, times
                )
                if not is_first:
                    rewards[b, g] = reward
