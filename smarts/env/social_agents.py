"""Social agents: they are asked for actions while the user's agents compute theirs.

Axis letters: B simulations, A agents, C columns of an interface, N agents of a request.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.agents.acting import Answer, Failed, Late, Request
from smarts.agents.hosting.hosts import Hosts
from smarts.agents.policy import ActionBatch
from smarts.agents.social import SocialPolicy, interface_of
from smarts.arrays import Bools
from smarts.controllers import action_format, action_space
from smarts.controllers.action_formats import Rejected
from smarts.env.actions import ActionEncoder, Parsed
from smarts.env.groups import context_of
from smarts.errors import ActionError, shown
from smarts.observations.arrays import ArrayObservation
from smarts.sensors.observation import ObservationMaker
from smarts.sim.assembly import Assembly
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.frame import Frame
from smarts.types.streams import hold_seed
from smarts.types.vehicles import Owner

# Numbers: to compare an array with a member of an enumeration takes three times as long.
_ACTIVE, _SHADOWING = int(AgentStatus.ACTIVE), int(AgentStatus.SHADOWING)


Places = NDArray[np.intp]
"""Simulations, or columns, of N agents, shape (N,)."""


class SocialAgentRequests:
    """Asks social agents for their decisions, and writes their answers.

    An answer counts for the hold that it was asked for, by (simulation, column, hold). An agent whose answer
    is no action fails: it is not asked again, the fallback controller drives its vehicle from the same step
    on, and the vehicle goes back to traffic as soon as it can if it came from there.

    Args:
        assembly: The simulations, their pool and their social policies.

    Raises:
        Exception: Whatever an agent raises when it is made.
    """

    def __init__(self, assembly: Assembly) -> None:
        self._world, self._pool = assembly.simulation.world, assembly.pool
        self._actions = assembly.actions
        self._encoder = ActionEncoder(self._actions, self._world)
        self._policies = assembly.policies
        self._host = Hosts(self._policies)
        self._observers = [
            _Observer(assembly, number, policy) for number, policy in enumerate(self._policies)
        ]
        shape = self._world.agents.slot.shape
        self._asked = np.zeros(shape, np.int64)  # the last hold of each column that was asked
        self._failed = np.zeros(shape, np.int64)  # the last that failed
        self._seed = np.zeros(shape, np.uint64)
        self._events = np.zeros(shape, np.int32)
        self._collects = any(policy.observation is None for policy in self._policies)
        assembly.pool.clear_with([self._events])
        self._make = ObservationMaker(assembly.scene)
        self._delayed: list[Answer] = []
        self._late = np.zeros((len(self._policies), shape[0]), np.int64)  # decisions, in the present episode

    def collect(self, frame: Frame) -> None:
        """Take in a step's or a reset's events, for agents that observe what happened since they decided."""
        if self._collects:
            np.bitwise_or(self._events, frame.events.bits, out=self._events)

    def dispatch(self, frame: Frame, due: Bools) -> None:
        """Ask the agents whose decision is due for their actions.

        Args:
            frame: The last one.
            due: Which simulations run and which agents have readings of now, shape (B, A).
        """
        world, agents, pool = self._world, self._world.agents, self._pool
        acts = ((agents.state == _ACTIVE) | (agents.state == _SHADOWING)) & (pool.policy != UNSET)
        acts &= self._failed != pool.serial
        due = due & acts & (agents.next_due <= world.step[:, None])
        if not due.any():
            return
        requests = {}
        for number in np.unique(pool.policy[due]).tolist():
            rows, columns = np.nonzero(due & (pool.policy == number))
            requests[number] = self._request(number, frame, rows, columns, acts)
        np.copyto(agents.next_due, world.step[:, None] + agents.period, where=due)
        self._asked[due] = pool.serial[due]
        self._events[due] = 0
        self._host.dispatch(requests)

    def gather(self) -> dict[tuple[int, int], str]:
        """Write the answers; return the agents that have failed, by (row, number of the agent), and why."""
        failures: dict[tuple[int, int], str] = {}
        answers, self._delayed = [*self._delayed, *self._host.gather()], []
        for answer in answers:
            batch, delay = answer.request.batch, self._policies[answer.policy].host.delay_steps
            is_due = self._world.step[batch.env_id] >= batch.step + delay
            if not is_due.all():
                self._delayed.append(answer.at(~is_due))
                answer = answer.at(is_due)
            self._take(answer, failures)
        return failures

    def begin(self, rows: Collection[int]) -> None:
        """Drop the requests of simulations in which other episodes begin; before the first, start the hosts.

        Raises:
            HostError: A host does not start.
        """
        self._host.begin()
        self._host.forget(rows)
        self._delayed = [each.at(~np.isin(each.request.batch.env_id, [*rows])) for each in self._delayed]
        self._late[:, [*rows]] = 0

    def late_decisions(self, row: int) -> dict[str, int]:
        """Return how many decisions of agents were late in a simulation's episode, by policy; no zeros.

        Policies with one name and different options are counted together.
        """
        counts = Counter()
        for policy, count in zip(self._policies, self._late[:, row].tolist(), strict=True):
            counts[policy.name] += count
        return dict(+counts)

    def close(self) -> None:
        """End the policies; may be called again."""
        self._host.close()

    def _request(self, number: int, frame: Frame, rows: Places, columns: Places, acts: Bools) -> Request:
        world, policy = self._world, self._policies[number]
        hold = self._pool.serial[rows, columns]
        is_first = self._asked[rows, columns] != hold
        for row, column in zip(rows[is_first].tolist(), columns[is_first].tolist(), strict=True):
            self._seed[row, column] = self._seed_of(row, column)
        batch = ActionBatch(
            observations=self._observers[number].observe(rows, columns, is_first),
            action_mask=world.agents.action_mask[rows, columns],
            env_id=rows.astype(np.int32),
            agent_id=columns.astype(np.int32),
            hold=hold,
            episode=world.episode[rows].astype(np.int32),
            step=world.step[rows].astype(np.int32),
            is_first=is_first,
            seed=self._seed[rows, columns],
            drives=world.agents.state[rows, columns] == _ACTIVE,
        )
        if policy.observation is not None:
            return Request(batch)
        places = [*zip(rows.tolist(), columns.tolist(), strict=True)]
        seen = [self._make(frame, *place, events=int(self._events[place])) for place in places]
        slots = world.agents.slot[rows, columns].tolist()
        names = [world.registry.name(row, slot) for (row, _), slot in zip(places, slots, strict=True)]
        others = np.nonzero(acts & (self._pool.policy == number))
        held = {*zip(others[0].tolist(), self._pool.serial[others].tolist(), strict=True)}
        return Request(batch, seen, names, held)

    def _seed_of(self, row: int, column: int) -> int:
        episode = self._pool.episodes[row]
        assert episode is not None
        name = self._pool.name(row, column)
        return hold_seed(episode.seed, name, world=episode.world, episode=episode.episode)

    def _take(self, answer: Answer, failures: dict[tuple[int, int], str]) -> None:
        """Write the actions of the holds that still are, and let those fail that have none."""
        agents, batch = self._world.agents, answer.request.batch
        rows, columns = batch.env_id, batch.agent_id
        state = agents.state[rows, columns]
        is_there = (self._pool.serial[rows, columns] == batch.hold) & (
            (state == _ACTIVE) | (state == _SHADOWING)
        )
        if not is_there.any():
            return
        age = self._world.step[rows] - batch.step
        kind = int(self._actions.kind[rows[0], columns[0]])
        if isinstance(answer.actions, np.ndarray) and _is_of(answer.actions, kind):
            found, places = action_format(kind), (rows[is_there], columns[is_there])
            numbers = found.parse_batch(answer.actions[is_there])
            if not isinstance(numbers, Rejected):
                decided = batch.action_mask[is_there], age[is_there]
                self._encoder.write([Parsed(found, numbers, places, *decided)])
                return
        for place in np.flatnonzero(is_there).tolist():
            where = int(rows[place]), int(columns[place])
            if isinstance(answer.actions[place], Late):
                self._late[answer.policy, where[0]] += 1
                continue
            decided = batch.action_mask[place], int(age[place])
            problem = self._write_one(*where, answer.actions[place], *decided)
            if problem:
                self._fail(*where, problem, failures)

    def _write_one(self, row: int, column: int, action: Any, action_mask: Bools, age: int) -> str:
        """Write one agent's action; return what is wrong with it, "" if nothing is.

        Args:
            row: Its simulation.
            column: The agent's.
            action: The action.
            action_mask: Which lane actions were allowed at the decision, shape (4,).
            age: Steps since then.
        """
        if isinstance(action, Failed):
            return action.problem
        numbers = np.asarray(action) if isinstance(action, np.ndarray | float) else np.empty(0)
        if numbers.dtype.kind == "f" and numbers.size and np.isnan(numbers).all():
            return "answered nan: it cannot act for its vehicle"
        try:
            parsed = self._encoder.parse(self._pool.name(row, column), action, row, column)
            self._encoder.write([parsed._replace(action_mask=action_mask, age=age)])
        except ActionError as error:
            return error.problem
        except Exception as error:
            return f"answered {shown(action, 100)}: {error}"
        return ""

    def _fail(self, row: int, column: int, problem: str, failures: dict[tuple[int, int], str]) -> None:
        world, agents = self._world, self._world.agents
        self._failed[row, column] = self._pool.serial[row, column]
        self._actions.given[row, column] = self._actions.fresh[row, column] = False
        slot = agents.slot[row, column]
        is_from_traffic = world.vehicles.home[row, slot] not in (Owner.NOBODY, Owner.AGENT)
        if is_from_traffic and agents.release_step[row, column] == UNSET:
            agents.release_step[row, column] = world.step[row]
        failures[row, int(agents.agent[row, column])] = problem


def _is_of(actions: Any, kind: int) -> bool:
    """Return whether an array holds numbers of the shape of an action type's space."""
    return actions.dtype.kind in "iuf" and actions.shape[1:] == _shape_of(kind)


@cache
def _shape_of(kind: int) -> tuple[int, ...]:
    return action_space(kind).shape or ()


class _Observer:
    """Makes the observations of one policy's agents as arrays; none for a policy that gets objects."""

    def __init__(self, assembly: Assembly, number: int, policy: SocialPolicy) -> None:
        columns = assembly.pool.columns(policy.interface)
        self._first, self._array = columns.start, None
        if policy.observation is None:
            return
        interface = interface_of(policy.spec)
        members = {f"{policy.name}:{agent_id}": interface for agent_id in range(columns.start, columns.stop)}
        context = context_of(assembly.scene, members, columns.start, policy.period)
        self._array = ArrayObservation(context, policy.observation)
        self._mask = np.zeros((assembly.simulation.world.worlds, len(members)), np.bool_)

    def observe(self, rows: Places, columns: Places, is_first: Bools) -> dict[str, Any]:
        """Return copies of the observations of some agents by field, shape (N, *shape).

        Args:
            rows: Their simulations, shape (N,).
            columns: Their columns, shape (N,).
            is_first: Which of them begin a hold, shape (N,).
        """
        if self._array is None:
            return {}
        places = columns - self._first
        self._mask[rows[is_first], places[is_first]] = True
        if is_first.any():
            self._array.reset(self._mask)
        self._mask[rows, places] = True
        arrays = self._array.observe(self._mask)
        self._mask[:] = False
        return {name: array[rows, places] for name, array in arrays.items()}
