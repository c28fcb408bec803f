"""Tables as messages that viewers take, whatever their size."""

import numpy as np
import pytest

from smarts.stream import tables
from smarts.stream.container import pack, unpack
from smarts.stream.tables import MOST_ROWS, STEPPED, columns_of, table_messages
from smarts.types.episode_schema import SIGNALS

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


@pytest.mark.parametrize("rows", [0, MOST_ROWS, MOST_ROWS + 1])
def test_rows_are_split_by_their_number(rows):
    columns = {name: np.arange(rows) for name in SIGNALS.names}
    columns["signal"] = np.zeros(rows)
    messages = table_messages(SIGNALS, columns, append=True)
    assert len(messages) == max(1, -(-rows // MOST_ROWS))
    assert all(message["append"] for message in messages)
    assert joined(messages)["step"] == [*range(rows)]
