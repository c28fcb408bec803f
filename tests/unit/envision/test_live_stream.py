"""Running simulations on their way to viewers: real servers and sockets, the publisher's messages by hand."""

import json
import random
import re
import struct
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from smarts.envision import live, viewers
from smarts.envision import server as server_module
from smarts.envision.viewers import MOST_REQUEST, Request
from smarts.stream.container import pack, unpack
from smarts.stream.road_map import map_message, origin_of
from smarts.stream.tables import LIVE, OUTCOMES
from smarts.types.episode_schema import AGENT_STATES, DECISIONS, VEHICLES
from tests.compact_reading import columns_of, motion_of, values_of
from tests.maps import straight
from tests.viewers import publisher, serving, viewer

LIMIT = 20.0


@pytest.fixture
def server():
    with serving(live=True) as running:
        yield running


def the_map(number=0, **size):
    graph = straight(**size)
    origin, message = list(origin_of(graph)), map_message(graph, "d")
    return {"type": "map", "map": number, "origin": origin, "message": message}


def begin(source="a", serial=1, **facts):
    facts = {"scenario": "s", "traffic": "", "episode": 3, "seed": 1, "world": 0, "dt": 0.1} | facts
    address = {"source": source, "serial": serial}
    return {"type": "begin", "facts": facts, "map": 0, "host": "h", "pid": 1, "world": 0, **address}


def frame(step, source="a", serial=1, vehicles=3, first=0, **tables):
    """Return a frame of vehicles that drive 1 m a step, the first one by agent 0, from slot `first` on."""
    slots = range(first, vehicles)
    rows = np.zeros((len(slots), len(VEHICLES.columns)))
    rows[:, 0], rows[:, 1], rows[:, 2] = step, slots, 1
    rows[:, VEHICLES.names.index("x")] = step
    states = np.zeros((1, len(AGENT_STATES.columns)))
    states[:, 0], states[:, AGENT_STATES.names.index("generation")], states[:, 2] = step, 1, 3
    tables |= {"vehicles": rows.tobytes(), "agent_states": states.tobytes()}
    if step == 0:
        texts = [f"car-{slot}" for slot in slots]
        tables["names"] = {"slot": [*slots], "generation": [1] * len(slots), "name": texts}
    return {"type": "frame", "step": step, "source": source, "serial": serial, "tables": tables}


def send(connection, *messages):
    for message in messages:
        connection.send(pack(message))


def until(browser, wanted):
    """Return the messages that a viewer gets, up to one for which `wanted` holds."""
    found = []
    while True:
        found.append(unpack(browser.recv(timeout=LIMIT)))
        if wanted(found[-1]):
            return found


def is_steps(number):
    return lambda message: message["type"] == "steps" and motion_of(message).step.tolist()[:1] == [number]


def is_listed(**columns):
    return lambda m: m["type"] == "sources" and any(columns.items() <= row.items() for row in m["sources"])


def watch(browser, *ids):
    browser.send(json.dumps({"watch": ids}))


@contextmanager
def watching(server, **first):
    """Provide a simulation's process, a viewer of it, and what the viewer got up to the first frame.

    Args:
        server: Their server.
        first: Of the first frame.
    """
    with publisher(server) as simulation, viewer(server) as browser:
        send(simulation, the_map(), begin(), frame(0, **first))
        until(browser, is_listed(id="a"))
        watch(browser, "a")
        yield simulation, browser, until(browser, is_steps(0))


def test_a_late_viewer_gets_what_lasts_and_the_newest_frame(server):
    with publisher(server) as simulation, viewer(server) as browser:
        send(simulation, the_map(), begin(), *(frame(step) for step in range(50)))
        send(simulation, begin("b"), frame(0, "b"), {"type": "unsent", "count": 5})
        (*_, listed) = until(browser, is_listed(id="a", step=49, running=True))
        if not listed["hidden"]:
            until(browser, lambda m: m["type"] == "sources" and m["hidden"] == 5)
        watch(browser, "a")
        found = until(browser, is_steps(49))
        kinds = [message["type"] for message in found if message["type"] not in ("sources", "table")]
        assert kinds == ["episode", "map", "vehicles", "steps"]
        assert {message["serial"] for message in found if "serial" in message} == {1}
        assert {message.get("source") for message in found} <= {"a", None}
        assert values_of(found[-2], "name") == ["car-0", "car-1", "car-2"]
        assert motion_of(found[-1]).x.tolist() == [4900] * 3
        send(simulation, frame(50))
        (*_, moved) = until(browser, is_steps(50))
        assert motion_of(moved).number.tolist() == motion_of(found[-1]).number.tolist()


def test_vehicles_keep_their_numbers_when_a_process_begins_an_episode_again(server):
    with watching(server) as (simulation, browser, found):
        assert motion_of(found[-1]).number.tolist() == [0, 1, 2]
        # What a publisher sends that has dropped messages; the first vehicle has gone meanwhile.
        send(simulation, begin(), frame(1, first=1))
        assert motion_of(until(browser, is_steps(1))[-1]).number.tolist() == [1, 2]


LASTING = {
    "agents": {"agent_id": [0], "name": ["ego"]},
    "holds": {"agent": [0], "agent_id": [0], "name": ["ego"], "policy": [""], "first_step": [0]},
    "routes": {"route": [0], "edges": [[0]]},
}


def test_tables_that_last_are_sent_when_they_come_and_to_late_viewers(server):
    def names(found):
        return {m["name"] for m in found if m["type"] == "table" and m["name"] != "agent_states"}

    with watching(server, **LASTING) as (simulation, browser, found):
        assert names(found) == {*LASTING}
        outcomes = {name: [0] for name in OUTCOMES.names}
        for step, (more, expected) in enumerate((({}, set()), ({"outcomes": outcomes}, {"outcomes"})), 1):
            send(simulation, frame(step, **more))
            assert names(until(browser, is_steps(step))) == expected
        with viewer(server) as late:
            watch(late, "a")
            assert names(until(late, is_steps(2))) == {*LASTING, "outcomes"}


def test_a_late_viewer_gets_the_newest_of_each_light(server):
    def lights(*rows):
        return np.array(rows, float).tobytes()

    with watching(server, signals=lights((0, 1, 3))) as (simulation, browser, _):
        send(simulation, frame(1), frame(2, signals=lights((2, 1, 1), (2, 2, 3))), frame(3))
        until(browser, is_steps(3))
        with viewer(server) as late:
            watch(late, "a")
            found = until(late, is_steps(3))
        (rows,) = [columns_of(m) for m in found if m["type"] == "table" and m["name"] == "signals"]
        assert [*zip(*map(list, rows.values()), strict=True)] == [(3, 1, 1), (3, 2, 3)]


def test_the_next_episode_has_the_next_serial_and_a_lost_process_ends_it(server):
    with watching(server) as (simulation, browser, _):
        send(simulation, begin(serial=2, episode=4), frame(9, serial=1), frame(0, serial=2))
        found = until(browser, is_steps(0))
        # The frame of the episode before is not among them.
        assert {message["serial"] for message in found if "serial" in message} == {2}
        simulation.close()
        (*_, end) = until(browser, lambda message: message["type"] == "end")
        assert (end["is_complete"], end["serial"]) == (False, 2)
        until(browser, is_listed(id="a", running=False))


@pytest.mark.parametrize(
    "damage",
    [
        lambda m: {**m, "tables": {**m["tables"], "vehicles": b"1234567"}},
        lambda m: {**m, "tables": {}},
    ],
)
def test_a_publisher_that_sends_damage_is_refused_and_the_others_stay(server, damage):
    with watching(server) as (good, browser, _), publisher(server) as bad:
        send(bad, the_map(), begin("bad"), frame(0, "bad"), damage(frame(1, "bad")))
        with pytest.raises(ConnectionClosed) as closed:
            bad.recv(timeout=LIMIT)
        assert closed.value.rcvd.code == 1008
        send(good, frame(1))
        until(browser, is_steps(1))


def mutated(draws, message):
    """Return a message with some bytes changed or left out."""
    data = bytearray(pack(message))
    for _ in range(draws.randint(1, 6)):
        place = draws.randrange(len(data))
        data[place : place + draws.randrange(3)] = draws.randbytes(1)
    return bytes(data)


def test_the_server_survives_damaged_messages(server):
    draws = random.Random(17)
    end = {"type": "end", "source": "a", "serial": 1, "is_complete": 1, "remark": ""}
    valid = [the_map(), begin(), frame(0), end]
    for _ in range(40):
        with publisher(server) as bad:
            try:
                send(bad, *valid[: draws.randint(0, 3)])
                for _ in range(200):
                    bad.send(mutated(draws, draws.choice(valid)))
            except ConnectionClosed:
                pass
    with publisher(server) as simulation, viewer(server) as browser:
        send(simulation, the_map(), begin("new"), frame(0, "new"))
        until(browser, is_listed(id="new", running=True))


@pytest.mark.parametrize(
    "text",
    [
        *("", "no json", "[" * 100_000, "9" * 5000, "[]", "{}", '{"watch": "a"}', '{"watch": [1]}'),
        json.dumps({"watch": ["x"] * 10}),
        *(json.dumps({"watch": [], "observe": {"a": agent}}) for agent in (-1, 2**31, True, 1.0, "1", None)),
        '{"watch": [], "observe": []}',
    ],
)
def test_what_is_no_request(text):
    assert Request.parse(text) is None


def test_viewers_that_send_no_request_are_disconnected_and_the_others_stay(server):
    assert Request.parse('{"watch": ["a"], "observe": {"a": 3}}') == Request(watch=["a"], observe={"a": 3})
    with watching(server) as (simulation, browser, _):
        for sent, code in (("no json", 1008), (b"{}", 1008), ("x" * (MOST_REQUEST + 1), 1009)):
            with viewer(server) as bad:
                bad.send(sent)
                with pytest.raises(ConnectionClosed) as closed:
                    until(bad, lambda message: False)
                assert closed.value.rcvd.code == code
        send(simulation, frame(1))
        until(browser, is_steps(1))


def test_browsers_of_other_sites_are_refused_and_browsers_publish_nothing(server):
    for role, origin in (
        (viewer, "http://evil.example"),
        (viewer, None),
        (publisher, f"http://127.0.0.1:{server.port}"),
    ):
        with pytest.raises(InvalidStatus), role(server, origin=origin):
            pass


def test_a_stalled_viewer_does_not_stop_the_others(monkeypatch):
    # However slow the machine is that tests.
    monkeypatch.setattr(server_module, "_STANDSTILL", 600_000)
    monkeypatch.setattr(viewers, "MOST_WAITING", 1 << 20)
    # One that does not read does not see the answers to its pings either.
    slow = {"max_queue": 1, "compression": None, "ping_interval": None}
    with (
        serving(live=True) as server,
        watching(server) as (simulation, browser, _),
        viewer(server, **slow) as stalled,
    ):
        watch(stalled, "a")
        last = 250
        for step in range(1, last + 1):
            # 60 kB each, in all twice what the server and the sockets keep for a viewer.
            send(simulation, frame(step, vehicles=3000))
            until(browser, is_steps(step))
        # A snapshot makes good what was dropped.
        found = until(stalled, is_steps(last))
        assert sum(message["type"] == "steps" for message in found) < last
        assert sum(message["type"] == "episode" for message in found) == 2


def test_snapshots_that_are_together_larger_than_what_may_wait_all_arrive(server):
    sources, size = "abcdefghi", 1 << 20
    assert len(sources) * size > viewers.MOST_WAITING
    with publisher(server) as simulation, viewer(server) as browser:
        send(simulation, the_map())
        for source in sources:
            send(simulation, begin(source, remark="x" * size), frame(0, source))
        until(browser, is_listed(id="i", step=0))
        watch(browser, *sources)
        assert {until(browser, is_steps(0))[-1]["source"] for _ in sources} == {*sources}


def test_a_viewer_gets_each_map_once(server):
    def maps(messages):
        return [(m["type"], m["digest"]) for m in messages if m["type"] in ("map", "known_map")]

    with watching(server) as (one, browser, found), publisher(server) as other:
        send(one, begin("a", 2), frame(2, "a", 2))
        found += until(browser, is_steps(2))
        # Another process on the same roads, and a third simulation on others, with the same digest.
        send(other, the_map(), the_map(1, length=321.0), begin("b"), frame(10, "b"))
        send(other, {**begin("c"), "map": 1}, frame(20, "c"))
        until(browser, is_listed(id="c"))
        for watched, step in (("ab", 10), ("abc", 20)):
            watch(browser, *watched)
            found += until(browser, is_steps(step))
        kinds, digests = zip(*maps(found), strict=True)
        assert kinds == ("map", "known_map", "known_map", "map")
        assert len({*digests[:-1]}) == 1
        assert digests[-1] != digests[0]
        with viewer(server) as late:
            watch(late, "a")
            assert maps(until(late, is_steps(2))) == [("map", digests[0])]


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
            rows = (("step", 0), ("agent_id", 0), ("name", "speed"), ("values", struct.pack("<f", 7.5)))
            observed = {name: [value] for name, value in rows}
            send(simulation, frame(1, "a", observations=observed))
            found = until(browser, is_steps(1))
            (table,) = [m for m in found if m["type"] == "table" and m["name"] == "observations"]
            assert table["columns"]["name"] == ["speed"]
        assert asked(simulation) == {}
        with pytest.raises(TimeoutError):
            other.recv(timeout=0)


def test_live_tables_have_the_columns_that_the_page_reads():
    source = (Path(live.__file__).parent / "page/src/agents.ts").read_text()
    bodies = {part.partition("(")[0]: part for part in source.split("export function ")}
    assert {*re.findall(r'value\("(\w+)"\)', bodies["stateOf"])} <= {*LIVE[AGENT_STATES.name]}
    assert {*re.findall(r'table\.numbers\("(\w+)"\)', bodies["decisionOf"])} <= {*LIVE[DECISIONS.name]}
