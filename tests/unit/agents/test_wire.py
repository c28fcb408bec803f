"""Messages between the simulator and agents: what arrives is what was sent, or one error."""

import socket
from contextlib import suppress

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from smarts_agent_kit.channel import Channel, ClosedError
from smarts_agent_kit.wire import DTYPES, Message, WireError, decode, encode

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)
ARRAYS = st.sampled_from([*DTYPES]).flatmap(
    lambda name: hnp.arrays(np.dtype(name), hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4))
)
FUZZED = 3_000


@settings(deadline=None)
@given(st.dictionaries(st.text(), PLAIN, max_size=4), st.dictionaries(st.text(), ARRAYS, max_size=4))
def test_what_is_decoded_is_what_was_encoded(values, arrays):
    found = decode(encode(Message("act", values, arrays)))
    assert found.kind == "act"
    assert found.values == values
    assert [*found.arrays] == [*arrays]
    for name, array in arrays.items():
        got = found.arrays[name]
        assert (got.dtype, got.shape) == (array.dtype, array.shape)
        assert got.tobytes() == array.tobytes()
        assert got.flags.writeable
        assert got.flags.aligned


@pytest.mark.parametrize(
    "packed",
    [
        b"",
        b"\xc1",
        b"\x91" * 900 + b"\x90",
        msgpack.packb(7),
        msgpack.packb(["run", 0, {}, []]),
        msgpack.packb(["act", 0, [], []]),
        msgpack.packb(["act", 0, {1: 2}, []]),
        msgpack.packb(["act", 0, {}, [["a", "|O", [1], b"12345678"]]]),
        msgpack.packb(["act", 0, {}, [["a", "<f8", [2], b"12345678"]]]),
        msgpack.packb(["act", 0, {}, [["a", "<f8", [-1, -1], b"12345678"]]]),
    ],
)
def test_what_is_no_message_is_an_error(packed):
    with pytest.raises(WireError):
        decode(packed)


def test_fuzzed_frames_are_messages_or_errors():
    draws, messages = np.random.default_rng(1), 0
    whole = encode(
        Message("act", {"more": [1.5, "text", None]}, {"a": np.arange(12.0), "b": np.ones(3, bool)})
    )
    for _ in range(FUZZED):
        frame = bytearray(whole[: draws.integers(len(whole) // 2, 2 * len(whole))])
        for place in draws.integers(0, len(frame), draws.integers(0, 6)):
            frame[place] = draws.integers(256)
        with suppress(WireError):
            message = decode(frame)
            assert sum(array.nbytes for array in message.arrays.values()) <= len(frame)
            messages += 1
    assert 0 < messages < FUZZED


def test_messages_of_any_size_cross_a_socket_in_parts():
    one, two = socket.socketpair()
    near, far = Channel(one), Channel(two)
    large = Message("act", {}, {"a": np.arange(900_000.0)}, 1)
    for _ in range(5):
        near.send(large)
    near.send(Message("act", {}, {}, 2))
    assert near.has_outgoing
    found = []
    while len(found) < 6:
        near.flush()
        message = far.receive()
        if message is not None:
            found.append(message)
    assert [each.number for each in found] == [1, 1, 1, 1, 1, 2]
    assert np.array_equal(found[0].arrays["a"], large.arrays["a"])
    near.close()
    with pytest.raises(ClosedError):
        far.receive()
    far.close()


def test_values_are_the_receivers_own():
    frame = encode(Message("make", {"options": {"lanes": [1]}}))
    decode(frame).values["options"]["lanes"].append(2)
    assert decode(frame).values == {"options": {"lanes": [1]}}
