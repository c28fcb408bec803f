"""The tables of an episode that lasts: what the publisher sends when it changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from smarts.roads.lane_graph import LaneGraph
from smarts.sim.agent_pool import Hold
from smarts.sim.episode_tables import Ending, columns_of, start_columns
from smarts.sim.recorder_handovers import ring_rows
from smarts.types.agent_states import UNSET
from smarts.types.bubbles import PlacedBubble
from smarts.types.episode import AgentStart
from smarts.types.episode_schema import BUBBLE_RINGS, ROUTES

Tables = dict[str, dict[str, list[Any]]]


def agent_tables(
    starts: Sequence[AgentStart], holds: Sequence[Hold], policies: Sequence[str], graph: LaneGraph
) -> Tables:
    """Return the tables agents, holds and routes as far as they are known.

    Args:
        starts: How the agents enter, by number.
        holds: The columns that they held, in order.
        policies: Names of the social policies, by number.
        graph: The map.
    """
    routes = [*dict.fromkeys(start.mission.route for start in starts if start.mission.route)]
    numbers = {route: number for number, route in enumerate(routes)}
    first = {hold.number: hold for hold in reversed(holds)}
    none = Hold(UNSET, UNSET, UNSET)
    agents = [
        start_columns(start, numbers)
        | {"agent_id": first.get(number, none).agent_id, "entry_step": first.get(number, none).step}
        for number, start in enumerate(starts)
    ]
    policy_of = dict(enumerate(policies))
    held = [
        (hold.number, hold.agent_id, start.name, policy_of.get(start.policy, ""), start.interface, hold.step)
        for hold in holds
        for start in [starts[hold.number]]
    ]
    edges = [(number, [*map(graph.edge_number, route)]) for number, route in enumerate(routes)]
    return {
        "agents": {name: [_plain(row[name]) for row in agents] for name in (agents[0] if agents else ())},
        "holds": columns_of(("agent", "agent_id", "name", "policy", "interface", "first_step"), held),
        "routes": columns_of(ROUTES.names, edges),
    }


def outcomes_table(endings: Mapping[int, Ending]) -> dict[str, list[Any]]:
    """Return the table outcomes of agents that have ended, by number."""
    names = "end_step", "outcome", "partner_slot", "partner_generation"
    rows = [(number, *(int(getattr(each, name)) for name in names)) for number, each in endings.items()]
    return columns_of(("agent", "step", *names[1:]), rows)


def bubble_tables(bubbles: Sequence[PlacedBubble]) -> Tables:
    """Return the tables bubbles and bubble_rings."""
    facts = [(number, each.id, each.actor, each.followed) for number, each in enumerate(bubbles)]
    return {
        "bubbles": columns_of(("bubble", "id", "actor", "followed"), facts),
        "bubble_rings": columns_of(BUBBLE_RINGS.names, ring_rows(bubbles)),
    }


def _plain(value: Any) -> Any:
    """Return a number or text that msgpack knows: an enumeration's number, a NumPy number's value."""
    return value if isinstance(value, str) else float(value) if isinstance(value, float) else int(value)
