import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smarts.errors import RecordError
from smarts.stream.arrays import packed_array, unpacked_array
from smarts.stream.container import MOST_BYTES, framed, pack, unpack
from smarts.stream.tables import table_messages
from smarts.types.episode_schema import EXTRAS
from tests.compact_reading import columns_of, messages_in

MESSAGES = [{"type": "a", "n": 1}, {"type": "b", "text": "é<script>"}, {"type": "c", "d": b"\0" * 40}]


def test_messages_come_back():
    assert list(messages_in(b"".join(framed(MESSAGES)))) == MESSAGES


@given(st.binary(max_size=200))
def test_any_bytes_are_a_message_or_refused(data):
    with contextlib.suppress(RecordError):
        assert isinstance(unpack(data)["type"], str)


@given(
    st.sampled_from(["bool", "int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"]),
    st.integers(0, 300),
)
def test_arrays_come_back(kind, length):
    values = (np.arange(length) * 7 % 120).astype(kind)
    found = unpacked_array(unpack(pack({"type": "x", "a": packed_array(values)}))["a"])
    np.testing.assert_array_equal(found, values)


def test_a_message_that_is_too_large_is_refused():
    with pytest.raises(RecordError, match="large"):
        pack({"type": "large", "d": bytes(MOST_BYTES)})


def test_tables_come_back_with_texts_and_lists():
    rows = {"step": [1, 2, 3], "agent_id": [0, 1, 0], "name": ["a", "", "ü"], "values": [[1.5], [], [2, 3]]}
    (message,) = table_messages(EXTRAS, rows)
    found = columns_of(unpack(pack(message)))
    assert found["name"] == rows["name"]
    assert found["step"].dtype == np.int32
    assert [each.tolist() for each in found["values"]] == rows["values"]
