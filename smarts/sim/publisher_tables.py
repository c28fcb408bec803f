"""The tables of an episode that lasts: what the publisher sends when it changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from smarts.roads.lane_graph import LaneGraph
from smarts.sim.agent_pool import Hold
from smarts.sim.episode_tables import start_columns
from smarts.sim.recorder_handovers import ring_rows
from smarts.types.agent_states import UNSET
from smarts.types.bubbles import PlacedBubble
from smarts.types.episode import AgentStart
from smarts.types.episode_schema import BUBBLE_RINGS
from smarts.types.events import Outcome


def static_tables(
    starts: Sequence[AgentStart],
    holds: Sequence[Hold],
    outcomes: Mapping[int, tuple[int, ...]],
    policies: Sequence[str],
    graph: LaneGraph,
    bubbles: Sequence[PlacedBubble],
) -> dict[str, dict[str, list[Any]]]:
    """Return the tables agents, holds, routes, outcomes, bubbles and bubble_rings as far as they are known.

    Args:
        starts: How the agents enter, by number.
        holds: The columns that they held, in order.
        outcomes: Of agents, by number: step, outcome, slot and generation of the vehicle collided with.
        policies: Names of the social policies, by number.
        graph: The map.
        bubbles: Of the episode.
    """
    routes = [*dict.fromkeys(start.mission.route for start in starts if start.mission.route)]
    numbers = {route: number for number, route in enumerate(routes)}
    ended = sorted(outcomes.items(), key=lambda each: each[1][0])
    rings = [*zip(*ring_rows(bubbles), strict=True)] or [()] * 4
    return {
        "agents": _agents(starts, holds, outcomes, numbers),
        "holds": _holds(starts, holds, policies),
        "routes": {
            "route": [*range(len(routes))],
            "edges": [[graph.edge_number(edge) for edge in route] for route in routes],
        },
        "outcomes": {
            "agent": [number for number, _ in ended],
            **{
                name: [row[column] for _, row in ended]
                for column, name in enumerate(("step", "outcome", "partner_slot", "partner_generation"))
            },
        },
        "bubbles": {
            "bubble": [*range(len(bubbles))],
            **{name: [getattr(each, name) for each in bubbles] for name in ("id", "actor", "followed")},
        },
        "bubble_rings": {name: [*column] for name, column in zip(BUBBLE_RINGS.names, rings, strict=True)},
    }


def _agents(
    starts: Sequence[AgentStart],
    holds: Sequence[Hold],
    outcomes: Mapping[int, tuple[int, ...]],
    routes: Mapping[Any, int],
) -> dict[str, list[Any]]:
    """Return the table of agents; `routes` numbers their routes."""
    first = {hold.number: hold for hold in reversed(holds)}
    agents = [
        {
            **start_columns(start, routes),
            "agent_id": first[number].agent_id if number in first else UNSET,
            "entry_step": first[number].step if number in first else UNSET,
            "end_step": outcomes[number][0] if number in outcomes else UNSET,
            "outcome": outcomes[number][1] if number in outcomes else int(Outcome.NONE),
        }
        for number, start in enumerate(starts)
    ]
    return {name: [_plain(row[name]) for row in agents] for name in (agents[0] if agents else ())}


def _holds(
    starts: Sequence[AgentStart], holds: Sequence[Hold], policies: Sequence[str]
) -> dict[str, list[Any]]:
    """Return the table of the columns that agents held."""
    held = [(starts[hold.number], hold) for hold in holds]
    return {
        "agent": [hold.number for _, hold in held],
        "agent_id": [hold.agent_id for _, hold in held],
        "name": [start.name for start, _ in held],
        "policy": [policies[s.policy] if 0 <= s.policy < len(policies) else "" for s, _ in held],
        "interface": [start.interface for start, _ in held],
        "first_step": [hold.step for _, hold in held],
    }


def _plain(value: Any) -> Any:
    """Return a number or text that msgpack knows: an enumeration's number, a NumPy number's value."""
    return value if isinstance(value, str) else float(value) if isinstance(value, float) else int(value)
