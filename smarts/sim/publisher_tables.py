"""The tables of an episode that lasts: what the publisher sends when it changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from smarts.roads.lane_graph import LaneGraph
from smarts.sim.agent_pool import Hold
from smarts.sim.episode_tables import columns_of, start_columns
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
        outcomes: Ends by the agent's number: step, outcome, slot and generation of the vehicle collided with.
        policies: Names of the social policies, by number.
        graph: The map.
        bubbles: Bubbles of the episode.
    """
    routes = [*dict.fromkeys(start.mission.route for start in starts if start.mission.route)]
    numbers = {route: number for number, route in enumerate(routes)}
    held = [(starts[hold.number], hold) for hold in holds]
    policy_of = dict(enumerate(policies))
    rows: dict[str, tuple[Sequence[str], Iterable[Sequence[Any]]]] = {
        "holds": (
            ("agent", "agent_id", "name", "policy", "interface", "first_step"),
            [
                (hold.number, hold.agent_id, s.name, policy_of.get(s.policy, ""), s.interface, hold.step)
                for s, hold in held
            ],
        ),
        "routes": (
            ("route", "edges"),
            [(number, [*map(graph.edge_number, route)]) for number, route in enumerate(routes)],
        ),
        "outcomes": (
            ("agent", "step", "outcome", "partner_slot", "partner_generation"),
            sorted(((number, *row) for number, row in outcomes.items()), key=lambda each: each[1]),
        ),
        "bubbles": (
            ("bubble", "id", "actor", "followed"),
            [(number, each.id, each.actor, each.followed) for number, each in enumerate(bubbles)],
        ),
        "bubble_rings": (BUBBLE_RINGS.names, ring_rows(bubbles)),
    }
    agents = _agents(starts, holds, outcomes, numbers)
    return {"agents": agents, **{name: columns_of(*table) for name, table in rows.items()}}


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


def _plain(value: Any) -> Any:
    """Return a number or text that msgpack knows: an enumeration's number, a NumPy number's value."""
    return value if isinstance(value, str) else float(value) if isinstance(value, float) else int(value)
