import contextlib
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smarts.errors import RecordError
from smarts.stream.arrays import MOST_ARRAY_BYTES, packed_array, unpacked_array
from smarts.stream.container import MAGIC, MOST_BYTES, framed, messages_in, pack, unpack
from smarts.stream.tables import columns_of, table_messages
from smarts.types.episode_schema import EXTRAS, SIGNALS

MESSAGES = [{"type": "a", "n": 1}, {"type": "b", "text": "é<script>"}, {"type": "c", "d": b"\0" * 40}]


def test_a_file_that_is_cut_at_any_byte_has_what_is_before_the_cut():
    data = b"".join(framed(MESSAGES))
    ends = np.cumsum([len(part) for part in framed(MESSAGES)]).tolist()
    for cut in range(len(MAGIC), len(data) + 1):
        whole = sum(end <= cut for end in ends) - 1
        assert list(messages_in(data[:cut])) == MESSAGES[:whole]


@pytest.mark.parametrize("data", [b"PAR1" * 9, MAGIC + b"\xff\xff\xff\xff", MAGIC + b"\1\0\0\0\xc1"])
def test_other_bytes_are_refused(data):
    with pytest.raises(RecordError):
        list(messages_in(data))


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


@pytest.mark.parametrize("length", [100, MOST_ARRAY_BYTES + 1])
def test_data_that_becomes_larger_than_it_says_is_refused(length):
    with pytest.raises(RecordError):
        unpacked_array({"t": "u1", "d": zlib.compress(bytes(MOST_ARRAY_BYTES + 1)), "z": True, "n": length})


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


def test_columns_of_different_lengths_are_refused():
    (message,) = table_messages(SIGNALS, {"step": [1, 2], "lane": [1, 2], "signal": [0, 0]})
    message["columns"]["lane"] = packed_array(np.zeros(1, np.int32))
    with pytest.raises(RecordError):
        columns_of(message)
