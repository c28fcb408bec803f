"""Tables as messages that viewers take, whatever their size."""

import numpy as np
import pytest

from smarts.stream import tables
from smarts.stream.container import pack, unpack
from smarts.stream.encoder import turn_indicators
from smarts.stream.motion import LEFT, RIGHT
from smarts.stream.road_map import map_message
from smarts.stream.tables import STEPPED, table_messages
from tests.compact_reading import columns_of
from tests.maps import crossing

(OBSERVATIONS,) = (table for table in STEPPED if table.name == "observations")


def joined(messages):
    """Return the columns that a reader has after all messages."""
    found = {}
    for message in messages:
        columns = columns_of(unpack(pack(message)))
        found = {
            name: [*(found.get(name, ()) if message["append"] else ()), *column]
            for name, column in columns.items()
        }
    return found


@pytest.mark.parametrize(("rows", "shape", "parts"), [(9, (64, 64, 3), 5), (3, (200, 200, 3), 3)])
def test_large_grids_arrive_in_several_messages(monkeypatch, rows, shape, parts):
    # Of 49 kB, two fit into a message; those of 480 kB go alone.
    monkeypatch.setattr(tables, "MOST_LISTED", 100_000)
    draws = np.random.default_rng(3)
    values = [draws.random(np.prod(shape), np.float32) for _ in range(rows)]
    columns = {
        "step": [*range(rows)],
        "agent_id": [0] * rows,
        "name": ["rgb:top_down"] * rows,
        "values": values,
        "agent": [0] * rows,
    }
    messages = table_messages(OBSERVATIONS, columns)
    assert [message["append"] for message in messages] == [False] + [True] * (parts - 1)
    found = joined(messages)
    assert found["step"] == columns["step"]
    for got, given in zip(found["values"], values, strict=True):
        np.testing.assert_array_equal(got, given)


def test_vehicles_show_indicators_where_they_turn():
    graph = crossing()
    inside, headings = np.flatnonzero(graph.is_internal), graph.point_heading
    bend = np.array([headings[graph.point_start[i + 1] - 1] - headings[graph.point_start[i]] for i in inside])
    bend = (bend + np.pi) % (2 * np.pi) - np.pi
    expected = np.select([bend > 0.4, bend < -0.4], [LEFT, RIGHT], 0)
    assert {*expected.tolist()} == {0, LEFT, RIGHT}
    found = turn_indicators(map_message(graph, "")["lanes"])
    assert found[inside].tolist() == expected.tolist()
    assert not found[:-1][~graph.is_internal].any()
    assert not found[-1]
