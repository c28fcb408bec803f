"""The tables of an episode that are made when it has ended, out of what was noted while it went on."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.arrays import Floats, Ints
from smarts.types.agent_states import UNSET
from smarts.types.episode import AgentStart, EpisodeStart
from smarts.types.episode_schema import AGENT_STATES, AGENTS, DECISIONS
from smarts.types.events import Outcome

Rows = Mapping[str, Sequence[Any] | NDArray]


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
    start: EpisodeStart,
    endings: Mapping[int, Ending],
    tables: Mapping[str, Mapping[str, Floats]],
    routes: Mapping[tuple[str, ...], int],
) -> Rows:
    """Return a row for each agent that was to take part.

    Args:
        start: Of the episode.
        endings: By agent; who is not in it had not ended.
        tables: Columns of `agents` and `decisions`.
        routes: Number of each route.
    """
    rows = []
    for agent_id, begin in enumerate(start.agents):
        ending = endings.get(agent_id, Ending())
        row = {"agent_id": agent_id, **_of_start(begin, routes), **dataclasses.asdict(ending)}
        rows.append(row | _of_drive(agent_id, tables[AGENT_STATES.name], tables[DECISIONS.name]))
    return {name: [row[name] for row in rows] for name in AGENTS.names}


def _of_start(start: AgentStart, routes: Mapping[tuple[str, ...], int]) -> dict[str, Any]:
    mission = start.mission
    return {
        "name": start.name,
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


def _of_drive(agent_id: int, agents: Mapping[str, Floats], decisions: Mapping[str, Floats]) -> dict[str, Any]:
    """Return what an agent's rows tell of its drive, from the first to the last."""
    own = np.flatnonzero(agents["agent_id"] == agent_id)
    first_decision = np.flatnonzero(decisions["agent_id"] == agent_id)[:1]
    drive: dict[str, Any] = {
        "action": int(decisions["action"][first_decision[0]]) if len(first_decision) else -1
    }
    columns = {"slot": -1.0, "generation": 0.0, "remaining": np.nan, "distance_travelled": 0.0}
    for name, without in columns.items():
        drive[name] = agents[name][own[-1]] if len(own) else without
    drive["entry_step"], drive["end_step"] = agents["step"][own[[0, -1]]] if len(own) else (-1, -1)
    return drive


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
