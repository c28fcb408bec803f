"""Builds an episode's tables from the recorded steps when the episode has ended."""

from __future__ import annotations

import dataclasses
from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Floats, Ints, Longs
from smarts.sim.agent_pool import Hold
from smarts.types.agent_states import UNSET, AgentStatus
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.episode_schema import AGENT_STATES, AGENTS, DECISIONS, EXTRAS, TABLE
from smarts.types.events import Outcome
from smarts.types.frame import Frame

Rows = Mapping[str, Sequence[Any] | NDArray]

NEVER = 2**31 - 1
"""A step later than every step of an episode."""


@dataclass
class Ending:
    """How an agent's episode ended: columns of the table `agents`, which explains them."""

    end_step: int = UNSET
    outcome: int = Outcome.NONE
    terminated: bool = False
    truncated: bool = False
    partner_slot: int = UNSET
    partner_generation: int = 0
    partner: str = ""
    partner_owner: int = 0
    partner_agent_id: int = UNSET
    side: int = 0
    closing_speed: float = 0.0
    substep: int = 0


def agents_table(
    starts: Sequence[AgentStart],
    holds: Sequence[Hold],
    endings: Mapping[int, Ending],
    tables: Mapping[str, Mapping[str, Floats]],
    routes: Mapping[tuple[str, ...], int],
) -> Rows:
    """Return one row per agent of the episode.

    Args:
        starts: How the agents enter, by number.
        holds: The columns that they held, in order.
        endings: How the agents ended, by number; agents that have not ended are missing.
        tables: Columns of `agent_states` and `decisions`.
        routes: Number of each route.
    """
    none = Ending()
    rows = [
        start_columns(start, routes) | dataclasses.asdict(endings.get(number, none))
        for number, start in enumerate(starts)
    ]
    drives = _drive_columns(len(starts), holds, tables[AGENT_STATES.name], tables[DECISIONS.name])
    return {name: drives[name] if name in drives else [row[name] for row in rows] for name in AGENTS.names}


def rows_of_holds(table: Mapping[str, Floats], holds: Sequence[Hold]) -> tuple[Longs, Longs]:
    """Return the first and the last row of each hold's agent in a table, -1 for none, both of shape (H,).

    Args:
        table: Has columns `step` and `agent_id`.
        holds: Holds in order; one lasts until the next of its column.
    """
    ends, next_step = np.empty(len(holds), np.int64), dict[int, int]()
    for place, hold in reversed([*enumerate(holds)]):
        ends[place] = next_step.get(hold.agent_id, NEVER)
        next_step[hold.agent_id] = hold.step
    agent_id, step = np.array([hold[1:] for hold in holds], np.int64).reshape(-1, 2).T
    keys = _key(table["agent_id"], table["step"])
    order = np.argsort(keys, kind="stable")
    first, behind = (np.searchsorted(keys[order], _key(agent_id, each)) for each in (step, ends))
    ordered, is_there = np.append(order, UNSET), first < behind
    return np.where(is_there, ordered[first], UNSET), np.where(is_there, ordered[behind - 1], UNSET)


def _key(agent_id: NDArray, step: NDArray) -> Longs:
    """Return numbers that are in order of column, then step."""
    return agent_id.astype(np.int64) << 32 | step.astype(np.int64)


def start_facts(start: EpisodeStart, dt: float) -> dict[str, Any]:
    """Return what an episode is, as columns of the table `episode`; `dt` is the length of a step [s]."""
    return {
        "scenario": start.scenario,
        "traffic": start.traffic_name or "",
        "seed": start.seed,
        "world": start.world,
        "episode": start.episode,
        "traffic_engine": start.engine,
        "traffic_seed": start.traffic_seed,
        "dt": dt,
    }


def start_columns(start: AgentStart, routes: Mapping[tuple[str, ...], int]) -> dict[str, Any]:
    """Return the columns of an agent's start and mission."""
    mission = start.mission
    return {
        "name": start.name,
        "interface": start.interface,
        "kind": start.kind,
        "length": start.length,
        "width": start.width,
        "entry_time": start.entry_time,
        "start_x": start.pose[0],
        "start_y": start.pose[1],
        "start_heading": start.pose[2],
        "start_speed": start.speed,
        "goal": mission.goal,
        "goal_x": mission.goal_position[0],
        "goal_y": mission.goal_position[1],
        "goal_radius": mission.goal_radius,
        "goal_lane": mission.goal_lane,
        "goal_s": mission.goal_s,
        "laps": mission.laps,
        "route": routes.get(mission.route, UNSET),
        "route_length": mission.route_length,
        "free_flow_time": mission.free_flow_time,
    }


def _drive_columns(
    count: int, holds: Sequence[Hold], agents: Mapping[str, Floats], decisions: Mapping[str, Floats]
) -> dict[str, Floats]:
    """Return the columns of the drives of `count` agents: vehicle, distances, steps, first action."""
    is_judged = agents["state"] != AgentStatus.LEAVING
    judged = {name: column[is_judged] for name, column in agents.items()}
    first, last = rows_of_holds(judged, holds)
    decided, _ = rows_of_holds(decisions, holds)
    numbers = np.array([hold.number for hold in holds], np.int64)
    agent_id = np.full(count, UNSET)
    agent_id[numbers] = [hold.agent_id for hold in holds]

    def of_agents(column: Floats, rows: Longs, without: float) -> Floats:
        """Return each agent's value, given the row of each hold."""
        found = np.full(count, without, np.float64)
        found[numbers[rows >= 0]] = column[rows[rows >= 0]]
        return found

    return {
        "agent_id": agent_id,
        "entry_step": of_agents(judged["step"], first, UNSET),
        "end_step": of_agents(judged["step"], last, UNSET),
        "slot": of_agents(judged["slot"], last, UNSET),
        "generation": of_agents(judged["generation"], last, 0),
        "remaining": of_agents(judged["remaining"], last, np.nan),
        "distance_travelled": of_agents(judged["distance_travelled"], last, 0.0),
        "action": of_agents(decisions["action"], decided, UNSET),
    }


def columns_of(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> dict[str, list[Any]]:
    """Return rows as columns by name."""
    columns = [*zip(*rows, strict=True)] or [()] * len(names)
    return {name: [*column] for name, column in zip(names, columns, strict=True)}


def routes_table(routes: Sequence[Ints]) -> Rows:
    """Return the routes of an episode, given as numbers of edges, in the order of their numbers."""
    return {"route": np.arange(len(routes)), "edges": [route.tolist() for route in routes]}


def extras_table(extras: Sequence[tuple[str, int, Ints, Floats]]) -> Rows:
    """Return a row for each agent of each annotation: name, step, agents (S,), values (S, ...)."""
    rows = (
        (step, agent_id, name, np.ravel(numbers).tolist())
        for name, step, agents, values in extras
        for agent_id, numbers in zip(agents.tolist(), values, strict=True)
    )
    return columns_of(EXTRAS.names, rows)


def rows_by_name(table: str, rows: Floats) -> dict[str, Floats]:
    """Return the columns of rows of a table, shape (N, C), by name."""
    return {name: rows[:, number] for number, name in enumerate(TABLE[table].names)}


def new_endings(frame: Frame, row: int, known: Container[int]) -> dict[int, Ending]:
    """Return how agents ended by their number, leaving out `known` ones; the vehicles still exist."""
    agents = frame.world.agents
    ended = np.flatnonzero(agents.outcome[row] != Outcome.NONE).tolist()
    numbers = zip(agents.agent[row, ended].tolist(), ended, strict=True)
    return {number: _ending(frame, row, agent_id) for number, agent_id in numbers if number not in known}


def _ending(frame: Frame, row: int, agent_id: int) -> Ending:
    world, contacts, events = frame.world, frame.contacts, frame.events
    ending = Ending(
        end_step=int(world.step[row]),
        outcome=int(world.agents.outcome[row, agent_id]),
        terminated=bool(events.terminated[row, agent_id]),
        truncated=bool(events.truncated[row, agent_id]),
    )
    slot = int(contacts.partner[row, agent_id])
    if ending.outcome != Outcome.COLLISION or slot == UNSET:
        return ending
    holders = np.flatnonzero(world.agents.slot[row] == slot)
    ending.partner_slot = slot
    ending.partner_generation = int(contacts.partner_generation[row, agent_id])
    ending.partner = world.registry.name(row, slot)
    ending.partner_owner = int(world.vehicles.owner[row, slot])
    ending.partner_agent_id = int(holders[0]) if len(holders) else UNSET
    ending.side = int(contacts.side[row, agent_id])
    ending.closing_speed = float(contacts.closing_speed[row, agent_id])
    ending.substep = int(contacts.substep[row, agent_id])
    return ending
