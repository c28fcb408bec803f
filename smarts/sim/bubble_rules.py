"""Bubbles in the step: which vehicles agents observe, drive and give back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np

from smarts.arrays import Bools, Bytes, Ints
from smarts.bubbles.conditions import ConditionRunner
from smarts.bubbles.field import BubbleField
from smarts.bubbles.phases import Phase
from smarts.roads.agent_routes import AgentRoutes
from smarts.sim.agent_pool import AgentPool
from smarts.sim.hold_missions import HoldMissions
from smarts.types.agent_states import UNSET
from smarts.types.bubbles import BubbleStates, PlacedBubble
from smarts.types.condition_state import ConditionState
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.events import Events
from smarts.types.transfers import Reason, Refusal, Transfer
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World

Key = tuple[int, int, int]
"""Number of a bubble in its simulation, slot and generation of a vehicle."""
Sought = tuple[int, str, bool]
"""Number of a bubble, name that it looks for, and whether it may be an agent's too."""


class BubbleRules:
    """Lets agents observe the vehicles in a bubble's margin and drive those in its zone.

    An agent is announced once for each vehicle that a bubble may take, and begins to observe it as soon as a
    column is free. When the vehicle's front comes into the zone, the agent is asked for an action, and takes
    the vehicle over as soon as that is possible. Outside of the zone, or when the bubble is no longer active,
    `agents.release_step` says that the vehicle is to go back; `HandoverRules` proposes that.

    Args:
        world: The state; `release_step` and `next_due` of agents are written.
        routes: Knows the maps.
        pool: Announces the agents.
        can_take: `can_accept` of the provider of agents' vehicles.
    """

    def __init__(
        self, world: World, routes: AgentRoutes, pool: AgentPool, can_take: Callable[[Ints, Ints], Bytes]
    ) -> None:
        self._world, self._pool, self._atlas = world, pool, routes.atlas
        self._can_take = can_take
        self._missions, self._conditions = HoldMissions(world, routes), ConditionRunner(world)
        self._field = BubbleField(world)
        # By simulation, of agents that have been announced: numbers of those without a column; of all, what
        # each is for; those that have found no free column.
        self._waiting: list[dict[Key, int]] = [{} for _ in range(world.worlds)]
        self._announced: list[dict[int, Key]] = [{} for _ in range(world.worlds)]
        self._without_column: list[set[int]] = [set() for _ in range(world.worlds)]
        self._special: dict[int, list[tuple[int, PlacedBubble]]] = {}
        """Bubbles that follow a vehicle, have a condition or look for names, by simulation."""
        self._has_bubbles = self._is_busy = False
        self._noted = [0] * world.worlds
        """How many of the pool's holds have been looked at."""
        self._missing: list[list[Sought]] = [[] for _ in range(world.worlds)]
        """What bubbles look for and has not appeared in the present episode."""

    @property
    def left(self) -> Bools:
        """Learning agents whose vehicles have left their bubble, shape (B, A)."""
        return self._field.holds.left

    @property
    def states(self) -> BubbleStates:
        """Places of the bubbles, and what has happened in them; other arrays after a `begin`."""
        return self._field.states

    def begin(self, row: int, start: EpisodeStart) -> None:
        """Begin an episode of one simulation."""
        if not (start.bubbles or self._field.bubbles[row]):
            return
        self._field.begin(row, start.bubbles)
        self._has_bubbles = any(self._field.bubbles)
        special = [
            (number, bubble)
            for number, bubble in enumerate(start.bubbles)
            if bubble.followed or bubble.active_condition is not None or bubble.names
        ]
        self._special.pop(row, None)
        if special:
            self._special[row] = special
        for known in (self._waiting, self._announced, self._without_column):
            known[row].clear()
        self._missing[row] = [
            (number, bubble.followed, True) for number, bubble in enumerate(start.bubbles) if bubble.followed
        ] + [(number, name, False) for number, bubble in enumerate(start.bubbles) for name in bubble.names]
        self._noted[row] = 0
        self._conditions.clear(row)

    def place(self, env_mask: Bools) -> None:
        """Move the bubbles, find the vehicles in them, and write which of those are to change hands."""
        self._is_busy = False
        if not self._has_bubbles:
            return
        self._note_holds(env_mask)
        for row, special in self._special.items():
            if env_mask[row]:
                for number, bubble in special:
                    self._field.states.is_active[row, number] = self._is_active(row, number, bubble)
                if self._missing[row]:
                    self._look_for(row)
        self._is_busy = self._field.update(env_mask)

    def propose(self, events: Events, env_mask: Bools) -> list[Transfer]:
        """Return the vehicles that agents are to observe, to drive, or to observe no longer."""
        if not self._is_busy:
            return []
        is_busy = env_mask & (self._field.found + self._field.wishes > 0)
        proposed: list[Transfer] = []
        for row in np.flatnonzero(is_busy).tolist():
            proposed += self._drops(row)
            proposed += self._takes(row)
            proposed += self._shadows(row)
        return proposed

    def _note_holds(self, env_mask: Bools) -> None:
        """Note the vehicles that agents announced for bubbles have begun to observe."""
        new = [
            (row, hold)
            for row, holds in enumerate(self._pool.holds)
            if len(holds) > self._noted[row]
            for hold in holds[self._noted[row] :]
        ]
        if not new:
            return
        # Another agent may have had the column until now.
        self._field.end_holds(env_mask)
        agents, holds = self._world.agents, self._field.holds
        for row, hold in new:
            self._noted[row] = len(self._pool.holds[row])
            key, column = self._announced[row].get(hold.number), hold.agent_id
            if key is None:
                continue
            self._waiting[row].pop(key, None)
            if agents.slot[row, column] != UNSET:
                holds.clear(row, column)
                holds.bubble[row, column], holds.number[row, column] = key[0], hold.number
                holds.slot[row, column], holds.generation[row, column] = key[1], key[2]

    def _is_active(self, row: int, number: int, bubble: PlacedBubble) -> bool:
        """Return whether a bubble takes vehicles; find the vehicle that it follows."""
        is_there = True
        if bubble.followed:
            rows, slot = self._field.rows, self._slot_of(row, bubble.followed)
            is_there = slot != UNSET
            rows.followed[row, number] = slot
            if is_there:
                rows.followed_generation[row, number] = self._world.vehicles.generation[row, slot]
        condition = bubble.active_condition
        # In every step, also without the vehicle: clocks run from the first evaluation on.
        holds = condition is None or self._conditions.is_active(row, number, condition)
        return is_there and holds

    def _slot_of(self, row: int, name: str) -> int:
        """Return the slot of the vehicle of an agent, or else of a vehicle, of this name; -1 without one."""
        numbers = (number for number, start in enumerate(self._pool.starts[row]) if start.name == name)
        column = self._pool.column(row, next(numbers, UNSET))
        held = int(self._world.agents.slot[row, column]) if column != UNSET else UNSET
        return held if held != UNSET else self._world.registry.slot(row, name)

    def _look_for(self, row: int) -> None:
        """Count the names that have not appeared, by bubble."""
        find, counts = self._world.registry.slot, self._field.states.never_appeared[row]
        self._missing[row] = [
            sought
            for sought in self._missing[row]
            if (self._slot_of if sought[2] else find)(row, sought[1]) == UNSET
        ]
        counts[:] = 0
        for number, *_ in self._missing[row]:
            counts[number] += 1

    def _drops(self, row: int) -> Iterator[Transfer]:
        """Yield the transfers of agents that are to stop to observe."""
        for agent_id in np.flatnonzero(self._field.holds.wants_drop[row]).tolist():
            yield self._transfer(row, agent_id, Reason.RELEASE)

    def _takes(self, row: int) -> Iterator[Transfer]:
        """Yield as many transfers of agents that are to drive as the limits allow, longest waiting first."""
        holds, agents, step = self._field.holds, self._world.agents, int(self._world.step[row])
        in_hand = (holds.phase[row] == Phase.DRIVEN) | (holds.phase[row] == Phase.RELEASING)
        driven = Counter(holds.bubble[row, in_hand].tolist())
        wanting = np.flatnonzero(holds.wants_take[row]).tolist()
        for agent_id in sorted(wanting, key=lambda a: (holds.waits_since[row, a], holds.slot[row, a])):
            number = int(holds.bubble[row, agent_id])
            bubble = self._field.bubbles[row][number]
            if driven[number] >= bubble.hijack_limit:
                continue
            driven[number] += 1
            # If it is refused, the others are tried before.
            holds.waits_since[row, agent_id] = step + 1
            if bubble.policy != UNSET:
                agents.next_due[row, agent_id] = step
            yield self._transfer(row, agent_id, Reason.TAKE)

    def _transfer(self, row: int, agent_id: int, reason: Reason) -> Transfer:
        """Return the transfer of a vehicle that an agent observes: to the agent, or away from it."""
        holds, vehicles = self._field.holds, self._world.vehicles
        slot, generation = int(holds.slot[row, agent_id]), int(holds.generation[row, agent_id])
        owner, is_take = int(vehicles.owner[row, slot]), reason == Reason.TAKE
        to_owner, to_agent = (int(Owner.AGENT), agent_id) if is_take else (owner, UNSET)
        return Transfer(row, slot, generation, owner, agent_id, to_owner, to_agent, reason)

    def _shadows(self, row: int) -> Iterator[Transfer]:
        """Yield the transfers of vehicles that agents are to begin to observe: the first bubble wins."""
        field, vehicles = self._field, self._world.vehicles
        if not field.found[row]:
            return
        stays = ~field.holds.wants_drop[row] & (field.holds.bubble[row] != UNSET)
        observed = Counter(field.holds.bubble[row, stays].tolist())
        taken = set[int]()
        for slot, number in np.argwhere(field.membranes.is_candidate[row].T).tolist():
            if slot in taken or not self._admits(row, number, slot, observed[number]):
                continue
            taken.add(slot)
            observed[number] += 1
            owner, generation = int(vehicles.owner[row, slot]), int(vehicles.generation[row, slot])
            agent = self._announce(row, (number, slot, generation))
            yield Transfer(row, slot, generation, owner, UNSET, owner, UNSET, Reason.SHADOW, agent)

    def _admits(self, row: int, number: int, slot: int, observed: int) -> bool:
        """Return whether a bubble takes a vehicle; else mark the vehicle as refused.

        Args:
            row: The simulation.
            number: Number of the bubble.
            slot: The vehicle's.
            observed: How many vehicles the bubble has.
        """
        bubble, states = self._field.bubbles[row][number], self._field.states
        name = self._world.registry.name(row, slot)
        is_refused = name.startswith(bubble.spared or ("\0",))
        if not is_refused and self._is_undrivable(row, slot):
            is_refused = True
            states.not_drivable[row, number] += 1
        if not is_refused and bubble.airlock_condition is not None:
            roads = self._atlas.graphs[self._world.map[row]]
            state = self._conditions.admits(row, number, slot, bubble.airlock_condition, roads)
            if not state and ConditionState.BEFORE in state:
                return False
            is_refused = not state
        if not is_refused and observed >= bubble.shadow_limit:
            is_refused = True
            states.at_limit[row, number] += 1
        self._field.membranes.refused[row, number, slot] = is_refused
        return not is_refused

    def _is_undrivable(self, row: int, slot: int) -> bool:
        answer = self._can_take(np.array([row], np.int32), np.array([slot], np.int32))
        return int(answer[0]) == Refusal.KIND

    def _announce(self, row: int, key: Key) -> int:
        """Return the number of the agent for a vehicle, a new one if there is none that waits.

        An agent that waits for a column starts where the vehicle is now.
        """
        start = self._start(row, self._field.bubbles[row][key[0]], key[1])
        if key in self._waiting[row]:
            number = self._waiting[row][key]
            self._pool.renew(row, number, start)
            if number not in self._without_column[row]:
                self._without_column[row].add(number)
                self._field.states.without_column[row, key[0]] += 1
            return number
        number = self._pool.announce(row, start)
        self._waiting[row][key], self._announced[row][number] = number, key
        return number

    def _start(self, row: int, bubble: PlacedBubble, slot: int) -> AgentStart:
        """Return how an agent takes a vehicle over."""
        world, vehicles = self._world, self._world.vehicles
        x, y = vehicles.position[row, slot].tolist()
        return AgentStart(
            name=f"{bubble.actor}-{world.registry.name(row, slot)}",
            pose=(x, y, float(vehicles.heading[row, slot])),
            height=float(vehicles.height[row, slot]),
            speed=float(vehicles.speed[row, slot]),
            mission=self._missions.mission(row, slot),
            kind=VehicleKind(int(vehicles.kind[row, slot])),
            length=float(vehicles.length[row, slot]),
            width=float(vehicles.width[row, slot]),
            interface=bubble.interface,
            policy=bubble.policy,
            period=bubble.period,
            collision_time=bubble.collision_time,
        )
