"""What viewers ask a server for: maps once, observations, room for simulations; and malformed requests."""

import json
import random
import struct

import pytest
from websockets.exceptions import ConnectionClosed

from smarts.envision.viewers import MOST_MAPS, MOST_REQUEST, MOST_WATCHED, Request
from smarts.stream.container import MOST_BYTES, pack
from smarts.stream.road_map import map_message, origin_of
from tests.maps import straight
from tests.unit.envision.test_live_stream import (
    LIMIT,
    begin,
    frame,
    is_listed,
    is_steps,
    the_map,
    until,
    watch,
)
from tests.viewers import ask, publisher, serving, viewer


@pytest.fixture
def server():
    with serving(live=True) as running:
        yield running


def send(connection, *messages):
    for message in messages:
        connection.send(pack(message))


def of_maps(messages):
    return [(m["type"], m["digest"]) for m in messages if m["type"] in ("map", "known_map")]


def test_a_viewer_gets_each_map_once(server):
    with publisher(server) as one, publisher(server) as other, viewer(server) as browser:
        send(one, the_map(), begin("a"), frame(0, "a"))
        until(browser, is_listed(id="a"))
        watch(browser, "a")
        found = until(browser, is_steps(0))
        for serial in range(2, 5):
            send(one, begin("a", serial), frame(serial, "a", serial))
            found += until(browser, is_steps(serial))
        # Another process on the same roads, and a third simulation on others, with the same digest.
        graph = straight(length=321.0)
        larger = {
            "type": "map",
            "map": 1,
            "origin": list(origin_of(graph)),
            "message": map_message(graph, "d"),
        }
        send(other, the_map(), larger, begin("b"), frame(10, "b"), {**begin("c"), "map": 1}, frame(20, "c"))
        until(browser, is_listed(id="c"))
        watch(browser, "a", "b")
        found += until(browser, is_steps(10))
        watch(browser, "a", "b", "c")
        found += until(browser, is_steps(20))
        kinds, digests = zip(*of_maps(found), strict=True)
        assert kinds == ("map", *["known_map"] * 4, "map")
        assert len(set(digests[:-1])) == 1
        assert digests[-1] != digests[0]
        # One that comes late has none.
        with viewer(server) as late:
            watch(late, "a")
            assert of_maps(until(late, is_steps(4))) == [("map", digests[0])]


def test_maps_that_a_viewer_has_forgotten_are_sent_again(server):
    lengths = [100.0 + number for number in range(MOST_MAPS + 1)]
    with publisher(server) as simulation, viewer(server) as browser:
        for number, length in enumerate(lengths):
            graph = straight(length=length)
            origin, message = list(origin_of(graph)), map_message(graph, "")
            send(simulation, {"type": "map", "map": number, "origin": origin, "message": message})
        send(simulation, begin(), frame(0))
        until(browser, is_listed(id="a"))
        watch(browser, "a")
        found = until(browser, is_steps(0))
        for serial, number in enumerate([*range(1, MOST_MAPS + 1), 0], 2):
            send(simulation, {**begin(serial=serial), "map": number}, frame(serial, serial=serial))
            found += until(browser, is_steps(serial))
        kinds = [kind for kind, _ in of_maps(found)]
        assert kinds == ["map"] * (MOST_MAPS + 2)


def asked(simulation):
    return json.loads(simulation.recv(timeout=LIMIT))["observe"]


def test_a_process_is_asked_for_the_observations_that_are_looked_at(server):
    with publisher(server) as simulation, publisher(server) as other:
        send(simulation, the_map(), begin("a"), frame(0, "a"), begin("b"), frame(0, "b"))
        send(other, the_map(), begin("c"), frame(0, "c"))
        with viewer(server) as browser:
            until(browser, is_listed(id="c"))
            browser.send(json.dumps({"watch": ["a", "c"], "observe": {"a": 2}}))
            assert asked(simulation) == {"a": [2]}
            with viewer(server) as second:
                second.send(json.dumps({"watch": ["a", "b"], "observe": {"a": 1, "b": 7}}))
                assert asked(simulation) == {"a": [1, 2], "b": [7]}
            assert asked(simulation) == {"a": [2]}
            observed = [(0, 0, "speed", struct.pack("<f", 7.5))]
            send(simulation, frame(1, "a", observations=observed))
            found = until(browser, is_steps(1))
            (table,) = [m for m in found if m["type"] == "table" and m["name"] == "observations"]
            assert table["columns"]["name"] == ["speed"]
        assert asked(simulation) == {}
        with pytest.raises(TimeoutError):
            other.recv(timeout=0)


def test_simulations_that_are_not_sent_are_counted(server):
    with publisher(server) as simulation, viewer(server) as browser:
        send(simulation, the_map(), begin("a"), frame(0, "a"), {"type": "unsent", "count": 5})
        (*_, listed) = until(browser, lambda m: m["type"] == "sources" and m["hidden"] == 5)
        assert [row["id"] for row in listed["sources"]] == ["a"]


def junk(fuzz):
    """Return a value of JSON, or a text that is nearly one."""
    leaf = [None, True, 0, -1, 2**70, 0.5, "", "a", "x" * 300, "\ud800", [], {}, [[]], ["a", 1], {"a": {}}]
    keys = ["watch", "observe", "Watch", "", "a"]
    if fuzz.random() < 0.3:
        return {
            "watch": [fuzz.choice("abcdefghijkl") for _ in range(fuzz.randrange(12))],
            "observe": {fuzz.choice("abc"): fuzz.choice([0, 7, 2**31, -1, True, 1.0, "1", None])},
        }
    return {fuzz.choice(keys): fuzz.choice(leaf) for _ in range(fuzz.randrange(4))} or fuzz.choice(leaf)


def damaged(fuzz):
    """Return the text of a request that is probably none."""
    text = list(json.dumps(junk(fuzz)))
    for _ in range(fuzz.randrange(4)):
        place = fuzz.randrange(len(text) + 1)
        text[place : place + fuzz.randrange(3)] = fuzz.choice('{}[]":,0\\u\0e-"é ')
    return "".join(text)


def is_request(text):
    """Return whether a text is a request, by the words of docs/guide/envision.md."""
    try:
        given = json.loads(text)
    except (ValueError, RecursionError):
        return False
    if not isinstance(given, dict) or not isinstance(given.get("watch"), list):
        return False
    observe = given.get("observe", {})
    return (
        len(given["watch"]) <= 9
        and {type(each) for each in given["watch"]} <= {str}
        and isinstance(observe, dict)
        and len(observe) <= 9
        and all(type(agent) is int and 0 <= agent < 2**31 for agent in observe.values())
    )


def test_malformed_requests_are_told_from_requests():
    fuzz, good = random.Random(20), 0
    for _ in range(2_000):
        text = damaged(fuzz)
        request = Request.parse(text)
        assert (request is not None) == is_request(text), text
        if request is not None:
            good += 1
            assert len(request.watched) <= MOST_WATCHED
            assert {*request.watched} == {*json.loads(text)["watch"]}
    assert 20 < good < 1800
    for text in (
        "[" * 100_000,
        "9" * 5000,
        "",
    ):
        assert Request.parse(text) is None


def malformed(fuzz):
    """Return messages of which the last one is no request."""
    text = damaged(fuzz)
    return text.encode() if fuzz.random() < 0.2 else text, "no request"


def refused(server, *messages):
    """Send a viewer's messages; return the code with which the server closes, None if it was not read."""
    with viewer(server, compression=None) as bad:
        try:
            for message in messages:
                bad.send(message)
            until(bad, lambda message: False)
        except ConnectionClosed as closed:
            return closed.rcvd and closed.rcvd.code


def test_the_server_survives_malformed_and_huge_requests(server):
    fuzz = random.Random(21)
    with publisher(server) as simulation, viewer(server) as browser:
        send(simulation, the_map(), begin(), frame(0))
        until(browser, is_listed(id="a"))
        watch(browser, "a")
        until(browser, is_steps(0))
        codes = [refused(server, *malformed(fuzz)) for _ in range(20)]
        assert {*codes} == {1008}
        assert [refused(server, "x" * size) for size in (MOST_REQUEST + 1, 1 << 20)] == [1009] * 2
        # Refused before it has come: the sender may not read why.
        assert refused(server, "x" * (MOST_BYTES + 1)) in (1009, None)
        send(simulation, frame(1))
        until(browser, is_steps(1))
        assert ask(server, "/")[0] == 200
