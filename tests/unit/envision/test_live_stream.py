"""Running simulations on their way to viewers: real servers and sockets, the publisher's messages by hand."""

import json
import random
import re
import socket
from pathlib import Path

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from smarts.envision import live, viewers
from smarts.envision import server as server_module
from smarts.sim import outlet
from smarts.stream.container import pack, unpack
from smarts.stream.motion import motion_of
from smarts.stream.road_map import map_message, origin_of
from smarts.stream.tables import LIVE, columns_of, values_of
from smarts.types.episode_schema import AGENT_STATES, DECISIONS, VEHICLES
from tests.maps import straight
from tests.viewers import ask, publisher, serving, viewer

LIMIT = 20.0


@pytest.fixture
def server():
    with serving(live=True) as running:
        yield running


def the_map(number=0):
    graph = straight()
    return {
        "type": "map",
        "map": number,
        "origin": list(origin_of(graph)),
        "message": map_message(graph, "d"),
    }


def begin(source="a", serial=1, **facts):
    facts = {"scenario": "s", "traffic": "", "episode": 3, "seed": 1, "world": 0, "dt": 0.1} | facts
    address = {"source": source, "serial": serial}
    return {"type": "begin", "facts": facts, "map": 0, "host": "h", "pid": 1, "world": 0, **address}


def frame(step, source="a", serial=1, vehicles=3, **more):
    """Return a frame of vehicles that drive 1 m a step, the first one by agent 0."""
    rows = np.zeros((vehicles, len(VEHICLES.columns)))
    rows[:, 0], rows[:, 1], rows[:, 2] = step, np.arange(vehicles), 1
    rows[:, VEHICLES.names.index("x")] = step
    states = np.zeros((1, len(AGENT_STATES.columns)))
    states[:, 0], states[:, AGENT_STATES.names.index("generation")], states[:, 2] = step, 1, 3
    names = [(slot, 1, f"car-{slot}") for slot in range(vehicles)] if step == 0 else []
    blocks = [rows.tobytes(), states.tobytes(), np.zeros((0, len(DECISIONS.columns))).tobytes()]
    message = {"type": "frame", "step": step, "rows": blocks, "agent": [0], "names": names, "source": source}
    return {**message, "serial": serial, "signals": [], "bubbles": [], "extras": [], **more}


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


def test_a_late_viewer_gets_what_lasts_and_the_newest_frame(server):
    with publisher(server) as simulation, viewer(server) as browser:
        for message in (the_map(), begin(), *(frame(step) for step in range(50))):
            simulation.send(pack(message))
        until(browser, is_listed(id="a", step=49, running=True))
        watch(browser, "a")
        found = until(browser, is_steps(49))
        kinds = [message["type"] for message in found if message["type"] not in ("sources", "table")]
        assert kinds == ["episode", "map", "vehicles", "steps"]
        assert {message["serial"] for message in found if "serial" in message} == {1}
        assert values_of(found[-2], "name") == ["car-0", "car-1", "car-2"]
        assert motion_of(found[-1]).x.tolist() == [4900] * 3
        simulation.send(pack(frame(50)))
        (*_, moved) = until(browser, is_steps(50))
        assert motion_of(moved).number.tolist() == motion_of(found[-1]).number.tolist()


def test_vehicles_keep_their_numbers_when_a_process_begins_an_episode_again(server):
    with publisher(server) as simulation, viewer(server) as browser:
        for message in (the_map(), begin(), frame(0)):
            simulation.send(pack(message))
        until(browser, is_listed(id="a"))
        watch(browser, "a")
        assert motion_of(until(browser, is_steps(0))[-1]).number.tolist() == [0, 1, 2]
        vehicles, *others = frame(1)["rows"]
        # What a publisher sends that has dropped messages; the first vehicle has gone meanwhile.
        for message in (begin(), frame(1, rows=[vehicles[len(vehicles) // 3 :], *others])):
            simulation.send(pack(message))
        assert motion_of(until(browser, is_steps(1))[-1]).number.tolist() == [1, 2]


def test_tables_that_last_are_sent_when_they_change(server):
    def static(**more):
        agents = {"agent_id": [0], "name": ["ego"], "end_step": [-1]}
        holds = {"agent": [0], "agent_id": [0], "name": ["ego"], "policy": [""], "first_step": [0]}
        outcomes = {name: [] for name in ("agent", "step", "outcome", "partner_slot", "partner_generation")}
        tables = {"agents": agents, "holds": holds, "routes": {"route": [0], "edges": [[0]]}, **more}
        message = {"type": "static", "source": "a", "serial": 1}
        return {**message, "tables": {"outcomes": outcomes, **tables}}

    def names(found):
        return {m["name"] for m in found if m["type"] == "table" and m["name"] != "agent_states"}

    with publisher(server) as simulation, viewer(server) as browser:
        for message in (the_map(), begin(), static(), frame(0)):
            simulation.send(pack(message))
        until(browser, is_listed(id="a"))
        watch(browser, "a")
        assert names(until(browser, is_steps(0))) == {"agents", "holds", "routes"}
        two = {"route": [0, 1], "edges": [[0], [0]]}
        ended = {"agents": {"agent_id": [0], "name": ["ego"], "end_step": [3]}}
        for step, more in enumerate(({}, {"routes": two}, {"routes": two} | ended), 1):
            simulation.send(pack(static(**more)))
            simulation.send(pack(frame(step)))
            expected = (set(), {"routes"}, {"agents", "holds"})[step - 1]
            assert names(until(browser, is_steps(step))) == expected
        # One who comes late gets all of them.
        with viewer(server) as late:
            watch(late, "a")
            assert names(until(late, is_steps(3))) == {"agents", "holds", "routes"}


def test_lights_are_sent_when_they_change(server):
    with publisher(server) as simulation, viewer(server) as browser:
        for message in (the_map(), begin(), frame(0, signals=[(1, 3)])):
            simulation.send(pack(message))
        until(browser, is_listed(id="a"))
        watch(browser, "a")
        found = until(browser, is_steps(0))
        for message in (frame(1, signals=[(1, 3)]), frame(2, signals=[(1, 1), (2, 3)]), frame(3)):
            simulation.send(pack(message))
        found += until(browser, is_steps(3))
        rows = [columns_of(m) for m in found if m["type"] == "table" and m["name"] == "signals"]
        shown = [(s, *each) for r in rows for s, *each in zip(r["step"], r["lane"], r["signal"], strict=True)]
        assert shown == [(0, 1, 3), (2, 1, 1), (2, 2, 3), (3, 1, 0), (3, 2, 0)]


def test_the_next_episode_has_the_next_serial_and_a_lost_process_ends_it(server):
    with publisher(server) as simulation, viewer(server) as browser:
        for message in (the_map(), begin(), frame(0)):
            simulation.send(pack(message))
        until(browser, is_listed(id="a"))
        watch(browser, "a")
        until(browser, is_steps(0))
        for message in (begin(serial=2, episode=4), frame(9, serial=1), frame(0, serial=2)):
            simulation.send(pack(message))
        found = until(browser, is_steps(0))
        # The frame of the episode before is not among them.
        assert {message["serial"] for message in found if "serial" in message} == {2}
        simulation.close()
        (*_, end) = until(browser, lambda message: message["type"] == "end")
        assert (end["is_complete"], end["serial"]) == (False, 2)
        until(browser, is_listed(id="a", running=False))


def test_a_publisher_that_is_stopped_is_dropped_and_one_that_only_sends_nothing_stays(monkeypatch):
    monkeypatch.setattr(server_module, "_SILENCE", 0.5)
    with serving(live=True) as server, publisher(server) as quiet, viewer(server) as browser:
        for message in (the_map(), begin("quiet"), frame(0, "quiet")):
            quiet.send(pack(message))
        with socket.create_connection(("127.0.0.1", server.port)) as stopped:
            protocol = outlet._shaken(stopped, outlet.Address("127.0.0.1", server.port))
            for message in (the_map(), begin("stopped")):
                protocol.send_binary(pack(message))
            stopped.sendall(b"".join(protocol.data_to_send()))
            until(browser, is_listed(id="stopped", running=True))
            # From here on it answers nothing, though its connection stays.
            found = until(browser, is_listed(id="stopped", running=False))
        assert is_listed(id="quiet", running=True)(found[-1])


def test_simulations_are_watched_one_by_one(server):
    with publisher(server) as simulation, viewer(server) as browser:
        simulation.send(pack(the_map()))
        for source in "ab":
            simulation.send(pack(begin(source)))
            simulation.send(pack(frame(0, source)))
        until(browser, is_listed(id="b"))
        watch(browser, "b")
        found = until(browser, is_steps(0))
        assert {message.get("source") for message in found} <= {"b", None}


@pytest.mark.parametrize(
    "damage",
    [
        lambda m: {**m, "rows": [b"1234567", b"", b""]},
        lambda m: {**m, "step": 7},
        lambda m: {**m, "agent": []},
        lambda m: {**m, "source": "other"},
        lambda m: {"type": "map", "map": 0, "origin": [0, 0], "message": {"type": "map", "lanes": {}}},
        lambda m: {**begin("b"), "map": 7},
        lambda m: {**begin("b"), "facts": {"scenario": ["<script>"]}},
        lambda m: {**m, "step": 1e300},
    ],
)
def test_a_publisher_that_sends_damage_is_refused_and_the_others_stay(server, damage):
    with publisher(server) as good, publisher(server) as bad, viewer(server) as browser:
        for message in (the_map(), begin("good"), frame(0, "good")):
            good.send(pack(message))
        for message in (the_map(), begin(), frame(0), damage(frame(1))):
            bad.send(pack(message))
        with pytest.raises(ConnectionClosed) as closed:
            bad.recv(timeout=LIMIT)
        assert closed.value.rcvd.code == 1008
        assert closed.value.rcvd.reason
        until(browser, is_listed(id="good", running=True))
        watch(browser, "good")
        good.send(pack(frame(1, "good")))
        until(browser, is_steps(1))


@pytest.mark.parametrize(
    ("sent", "code"),
    [
        ("no json", 1008),
        (json.dumps({"watch": ["x"] * 10}), 1008),
        (json.dumps({"watch": ["x" * 5000]}), 1009),
    ],
)
def test_viewers_that_ask_for_something_else_are_disconnected(server, sent, code):
    with viewer(server) as browser:
        browser.send(sent)
        with pytest.raises(ConnectionClosed) as closed:
            until(browser, lambda message: False)
        assert closed.value.rcvd.code == code
    assert ask(server, "/")[0] == 200


def test_browsers_of_other_sites_are_refused_and_browsers_publish_nothing(server):
    for role, origin in (
        (viewer, "http://evil.example"),
        (viewer, None),
        (publisher, f"http://127.0.0.1:{server.port}"),
    ):
        with pytest.raises(InvalidStatus), role(server, origin=origin):
            pass


def test_elsewhere_publishers_and_viewers_need_the_token():
    bearer = {"Authorization": "Bearer secret"}
    with serving(live=True, host="0.0.0.0", token="secret") as server:
        for role in (publisher, viewer):
            for headers in ({}, {"Authorization": "Bearer wrong"}):
                with pytest.raises(InvalidStatus), role(server, additional_headers=headers):
                    pass
        with publisher(server, additional_headers=bearer) as simulation:
            for message in (the_map(), begin()):
                simulation.send(pack(message))
            with viewer(server, additional_headers=bearer) as browser:
                until(browser, is_listed(id="a"))


def mutated(random_bytes, message):
    """Return a message with some bytes changed, cut or repeated."""
    data = bytearray(pack(message))
    for _ in range(random_bytes.randint(1, 6)):
        place = random_bytes.randrange(len(data))
        match random_bytes.randrange(3):
            case 0:
                data[place] = random_bytes.randrange(256)
            case 1:
                del data[place:][:4]
            case 2:
                data[place:place] = random_bytes.randbytes(random_bytes.randint(1, 8))
    return bytes(data)


def test_the_server_survives_damaged_messages(server):
    fuzz = random.Random(17)
    valid = [
        the_map(),
        begin(),
        frame(0),
        {"type": "end", "source": "a", "serial": 1, "is_complete": 1, "remark": ""},
    ]
    sent = 0
    while sent < 2_000:
        with publisher(server) as bad:
            try:
                for message in valid[: fuzz.randint(0, 3)]:
                    bad.send(pack(message))
                for _ in range(200):
                    bad.send(mutated(fuzz, fuzz.choice(valid)) if fuzz.random() < 0.9 else fuzz.randbytes(50))
                    sent += 1
            except ConnectionClosed:
                sent += 1
    with publisher(server) as simulation, viewer(server) as browser:
        for message in (the_map(), begin("new"), frame(0, "new")):
            simulation.send(pack(message))
        until(browser, is_listed(id="new", running=True))
        watch(browser, "new")
        until(browser, is_steps(0))


def test_a_stalled_viewer_does_not_stop_the_others(monkeypatch):
    # However slow the machine is that tests.
    monkeypatch.setattr(server_module, "_STANDSTILL", 600_000)
    monkeypatch.setattr(viewers, "MOST_WAITING", 1 << 20)
    # One that does not read does not see the answers to its pings either.
    slow = {"max_queue": 1, "compression": None, "ping_interval": None}
    with (
        serving(live=True) as server,
        publisher(server) as simulation,
        viewer(server) as browser,
        viewer(server, **slow) as stalled,
    ):
        for message in (the_map(), begin(), frame(0)):
            simulation.send(pack(message))
        until(browser, is_listed(id="a"))
        for each in (browser, stalled):
            watch(each, "a")
        until(browser, is_steps(0))
        last = 250
        for step in range(1, last + 1):
            # 60 kB each, in all twice what the server and the sockets keep for a viewer.
            simulation.send(pack(frame(step, vehicles=3000)))
            until(browser, is_steps(step))
        # A snapshot makes good what was dropped.
        found = until(stalled, is_steps(last))
        assert sum(message["type"] == "steps" for message in found) < last
        assert sum(message["type"] == "episode" for message in found) == 2


def test_snapshots_that_are_together_larger_than_what_may_wait_all_arrive(server):
    # 9 x 1 MB, above the 8 MB that may wait for one viewer.
    sources, size = "abcdefghi", 1 << 20
    assert len(sources) * size > viewers.MOST_WAITING
    with publisher(server) as simulation, viewer(server) as browser:
        simulation.send(pack(the_map()))
        for source in sources:
            simulation.send(pack(begin(source, remark="x" * size)))
            simulation.send(pack(frame(0, source)))
        until(browser, is_listed(id="i", step=0))
        watch(browser, *sources)
        shown = set()
        while shown != set(sources):
            shown.add(until(browser, is_steps(0))[-1]["source"])
        assert ask(server, "/")[0] == 200
        for source in sources:
            simulation.send(pack(frame(1, source)))
        after = [until(browser, is_steps(1))[-1]["source"] for _ in sources]
        assert sorted(after) == [*sources]


def test_a_viewer_that_asks_for_a_simulation_again_and_again_gets_each_frame_once(server):
    with publisher(server) as simulation, viewer(server) as browser:
        for message in (the_map(), begin(), frame(0)):
            simulation.send(pack(message))
        until(browser, is_listed(id="a"))
        for _ in range(4):
            watch(browser)
            watch(browser, "a")
            until(browser, is_steps(0))
        for step in range(1, 6):
            simulation.send(pack(frame(step)))
        found = until(browser, is_steps(5))
        steps = [int(motion_of(each).step[0]) for each in found if each["type"] == "steps"]
        assert [step for step in steps if step] == [1, 2, 3, 4, 5]


def test_a_viewer_that_takes_nothing_is_forgotten(monkeypatch):
    monkeypatch.setattr(server_module, "_STANDSTILL", 200)
    with (
        serving(live=True) as server,
        publisher(server) as simulation,
        viewer(server, max_queue=1, compression=None, ping_interval=None) as stalled,
    ):
        for message in (the_map(), begin(), frame(0)):
            simulation.send(pack(message))
        until(stalled, is_listed(id="a"))
        watch(stalled, "a")
        step = 0
        while server._hub._viewers:
            step += 1
            simulation.send(pack(frame(step, vehicles=3000)))
        assert ask(server, "/")[0] == 200


def test_live_tables_have_the_columns_that_the_page_reads(server):
    source = (Path(live.__file__).parent / "page/src/agents.ts").read_text()
    bodies = {part.partition("(")[0]: part for part in source.split("export function ")}
    read = {
        AGENT_STATES.name: set(re.findall(r'value\("(\w+)"\)', bodies["stateOf"])),
        DECISIONS.name: set(re.findall(r'table\.numbers\("(\w+)"\)', bodies["decisionOf"])),
    }
    assert read[AGENT_STATES.name] >= {"slot", "throttle", "remaining"}
    assert read[DECISIONS.name] == {"step", "action", "action_mask"}
    for name, columns in read.items():
        assert columns <= {*LIVE[name]}
    decision = np.zeros((1, len(DECISIONS.columns)))
    with publisher(server) as simulation, viewer(server) as browser:
        first = frame(0)
        first["rows"][2] = decision.tobytes()
        for message in (the_map(), begin(), first):
            simulation.send(pack(message))
        until(browser, is_listed(id="a"))
        watch(browser, "a")
        found = {m["name"]: m["columns"] for m in until(browser, is_steps(0)) if m["type"] == "table"}
    assert {*found[AGENT_STATES.name]} == {*LIVE[AGENT_STATES.name]}
    assert {*found[DECISIONS.name]} == {*LIVE[DECISIONS.name]}
