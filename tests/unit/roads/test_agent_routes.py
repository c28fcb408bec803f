"""Agents' routes: the table grows in mid-episode, and says of each route what a new table says."""

from itertools import pairwise

import numpy as np
import pytest

from smarts.roads.agent_routes import AgentRoutes
from smarts.roads.atlas import RoadAtlas
from smarts.roads.routes import random_route
from smarts.types.streams import Purpose, stream
from tests import maps

WORLDS, AGENTS = 2, 5


@pytest.fixture(scope="module")
def atlas():
    return RoadAtlas([maps.straight(lanes=3), maps.crossing()])


def corridor(table, number):
    """Return what a table says of one route, with numbers relative to the route's first row."""
    begin, end = table.start[table.free + number], table.start[table.free + number + 1]
    rows = slice(begin, end)
    onward = [
        (table.onward[table.onward_start[row] : table.onward_start[row + 1]] - begin).tolist()
        for row in range(begin, end)
    ]
    last = int(np.flatnonzero(table.changes[rows].any(axis=0)).max(initial=0)) + 1
    before = table.before[rows]
    return (
        table.lane[rows].tolist(),
        (table.group[rows] - table.group[begin]).tolist(),
        table.begin[rows].tolist(),
        table.end[rows].tolist(),
        onward,
        np.where(before < 0, -1, before - begin).tolist(),
        (table.by_lane[rows] - begin).tolist(),
        table.changes[rows, :last].tolist(),
    )


def check(routes, atlas, given):
    """Compare every agent's route with a table of this route alone; groups of different routes differ."""
    table = routes.table
    for (row, agent_id), (map_number, route) in given.items():
        number = routes.number[row, agent_id]
        assert (number >= 0) == bool(route)
        assert routes.route(row, agent_id) == route
        if route:
            alone = atlas.route_table([(map_number, route)])
            assert corridor(table, number) == corridor(alone, 0)
    used = table.group[: table.start[table.free + routes.number.max() + 1]]
    starts = [*table.start[: table.free + routes.number.max() + 2]]
    groups = [set(used[a:b].tolist()) for a, b in pairwise(starts)]
    assert sum(map(len, groups)) == len(set().union(*groups))


def test_a_table_that_grows_is_as_a_new_one(atlas):
    generator = stream(5, Purpose.STARTS, world=0, episode=0)
    routes = AgentRoutes(atlas, WORLDS, AGENTS)
    graph = atlas.graphs[1]
    given = {(row, agent_id): (row, ()) for row in range(WORLDS) for agent_id in range(AGENTS)}
    for row in range(WORLDS):
        routes.assign(row, row, [])
    for step in range(40):
        row, agent_id = int(generator.integers(WORLDS)), int(generator.integers(AGENTS))
        if step % 20 == 19:
            routes.assign(row, row, [])
            given.update({(row, each): (row, ()) for each in range(AGENTS)})
        if row == 0:
            route = ("road",) if generator.random() < 0.7 else ()
        else:
            route = random_route(graph, generator, max_edges=int(generator.integers(1, 4)))
        routes.assign_agent(row, agent_id, route)
        given[row, agent_id] = row, route
        check(routes, atlas, given)
