"""Builds an episode's tables from the recorded steps when the episode has ended."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Floats, Ints
from smarts.sim.agent_pool import Hold
from smarts.types.agent_states import UNSET
from smarts.types.episode import AgentStart
from smarts.types.episode_schema import AGENT_STATES, AGENTS, DECISIONS
from smarts.types.events import Outcome

Rows = Mapping[str, Sequence[Any] | NDArray]

NEVER = 2**31 - 1
"""Later than every step."""


@dataclass
class Ending:
    """How an agent's episode ended: columns of the table `agents`, which explains them."""

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
    spans = {hold.number: _span(holds, place) for place, hold in enumerate(holds)}
    rows = []
    for number, start in enumerate(starts):
        agent_id, steps = spans.get(number, (UNSET, range(0)))
        ending = endings.get(number, Ending())
        row = {"agent_id": agent_id, **_start_columns(start, routes), **dataclasses.asdict(ending)}
        rows.append(row | _drive_columns(agent_id, steps, tables[AGENT_STATES.name], tables[DECISIONS.name]))
    return {name: [row[name] for row in rows] for name in AGENTS.names}


def _span(holds: Sequence[Hold], place: int) -> tuple[int, range]:
    """Return the column of a hold, and its steps: those until the next hold of the same column."""
    hold = holds[place]
    later = (each.step for each in holds[place + 1 :] if each.agent_id == hold.agent_id)
    return hold.agent_id, range(hold.step, next(later, NEVER))


def _start_columns(start: AgentStart, routes: Mapping[tuple[str, ...], int]) -> dict[str, Any]:
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
    agent_id: int, steps: range, agents: Mapping[str, Floats], decisions: Mapping[str, Floats]
) -> dict[str, Any]:
    """Return the columns of an agent's drive: first action, vehicle, distances, first and last step."""
    own = _rows_of(agents, agent_id, steps)
    first_decision = _rows_of(decisions, agent_id, steps)[:1]
    drive: dict[str, Any] = {
        "action": int(decisions["action"][first_decision[0]]) if len(first_decision) else -1
    }
    columns = {"slot": -1.0, "generation": 0.0, "remaining": np.nan, "distance_travelled": 0.0}
    for name, without in columns.items():
        drive[name] = agents[name][own[-1]] if len(own) else without
    drive["entry_step"], drive["end_step"] = agents["step"][own[[0, -1]]] if len(own) else (-1, -1)
    return drive


def _rows_of(table: Mapping[str, Floats], agent_id: int, steps: range) -> NDArray[np.intp]:
    """Return the rows of a column's agent in some steps."""
    is_then = (table["step"] >= steps.start) & (table["step"] < steps.stop)
    return np.flatnonzero((table["agent_id"] == agent_id) & is_then)


def routes_table(routes: Sequence[Ints]) -> Rows:
    """Return the routes of an episode, given as numbers of edges, in the order of their numbers."""
    return {"route": np.arange(len(routes)), "edges": [route.tolist() for route in routes]}


def extras_table(extras: Sequence[tuple[str, int, Ints, Floats]]) -> Rows:
    """Return a row for each agent of each annotation: name, step, agents (S,), values (S, ...)."""
    table: dict[str, list[Any]] = {"step": [], "agent_id": [], "name": [], "values": []}
    for name, step, agents, values in extras:
        for agent_id, numbers in zip(agents.tolist(), values, strict=True):
            table["step"].append(step)
            table["agent_id"].append(agent_id)
            table["name"].append(name)
            table["values"].append(np.ravel(numbers).tolist())
    return table
