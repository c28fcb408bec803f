"""A real environment, a real server, a real viewer."""

import json
import os
import signal
import socket
import time
from pathlib import Path

import numpy as np
import pytest

from smarts.agents.benchmark import benchmark_interface
from smarts.env import HiWayEnv
from smarts.env.vector import VectorHiWayEnv
from smarts.errors import SmartsError
from smarts.sim import outlet, publisher, publisher_pace
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.sim.options import ENVISION, Options
from smarts.sim.outlet import Address
from smarts.stream.container import unpack
from smarts.stream.motion import OWNER_BITS, motion_of
from smarts.stream.tables import columns_of
from smarts.types.vehicles import Owner
from tests.viewers import serving, viewer

KEEP = [np.zeros((2, 4), np.int64)]
LIMIT = 60
ROOT = Path(__file__).parents[3]


@pytest.fixture
def server():
    with serving(live=True) as running:
        yield running


@pytest.fixture
def env(server, monkeypatch):
    monkeypatch.setenv(ENVISION, f"127.0.0.1:{server.port}")
    made = VectorHiWayEnv(2, ["intersection"], 4, seed=1)
    yield made
    made.close()


def messages(server, agent=None):
    """Yield what a viewer of all simulations gets, which looks at one agent of each."""
    with viewer(server) as browser:
        while True:
            message = unpack(browser.recv(timeout=LIMIT))
            if message["type"] == "sources" and message["sources"]:
                ids = [row["id"] for row in message["sources"]]
                observe = {} if agent is None else dict.fromkeys(ids, agent)
                browser.send(json.dumps({"watch": ids, "observe": observe}))
            yield message


def test_an_environment_is_shown(server, env):
    env.reset()
    found, shown = {}, set()
    for message in messages(server):
        env.step(KEEP)
        if message["type"] == "steps":
            motion = motion_of(message)
            shown.add((message["source"], message["serial"], int(motion.step[0])))
            egos = motion.flags & OWNER_BITS == Owner.AGENT
            assert 1 <= egos.sum() <= 4
        elif message["type"] == "table":
            found.setdefault(message["name"], []).append(columns_of(message))
        if len(shown) >= 10 and "extras" in found:
            break
    assert len({source for source, _, _ in shown}) == 2
    agents = found["agents"][0]
    assert agents["name"] == ["agent-0", "agent-1", "agent-2", "agent-3"]
    assert set(agents["interface"]) == {-1}
    states = found["agent_states"][-1]
    assert set(states["agent"]) <= {0, 1, 2, 3}
    assert "reward" in {name for extras in found["extras"] for name in extras["name"]}


def test_decisions_between_two_frames_come_with_the_next_one(server, env, monkeypatch):
    monkeypatch.setattr(publisher_pace, "SHORTEST", 0.2)
    env.reset()
    newest, checked, interval = {}, 0, 5
    for message in messages(server):
        env.step(KEEP)
        key = message.get("source"), message.get("serial")
        if message["type"] == "table" and message["name"] == "decisions":
            newest[key] = max(columns_of(message)["step"])
        elif message["type"] == "steps" and key in newest:
            checked += 1
            assert newest[key] == (int(motion_of(message).step[0]) - 1) // interval * interval
        if checked == 6:
            break
    assert checked == 6


def test_terms_of_rewards_are_shown_and_observations_where_one_looks(server, env):
    env.reset()
    found, tables = [], set()
    for message in messages(server):
        env.step(KEEP)
        if message["type"] == "table":
            tables.add(message["name"])
            found += columns_of(message)["name"] if message["name"] == "extras" else []
        if len(found) >= 10:
            break
    assert set(found) == {"reward"}
    assert "agent_states" in tables
    assert "observations" not in tables
    sums = {}
    for message in messages(server, agent=0):
        env.step(KEEP)
        if message["type"] == "table" and message["name"] == "extras":
            table = columns_of(message)
            place = message["source"], message["serial"]
            for name, step, agent, (value,) in zip(
                table["name"], table["step"], table["agent"], table["values"], strict=True
            ):
                sums.setdefault((*place, int(step), int(agent)), {})[name] = float(value)
        whole = [terms for terms in sums.values() if "reward" in terms and len(terms) > 2]
        # Terms come from the beginning of the next episode on.
        if len(whole) >= 2:
            break
    for terms in whole:
        assert sum(terms.values()) == pytest.approx(2 * terms["reward"], abs=1e-4)


def observed_live(server, step, agent, count):
    """Return what an agent is shown to observe, (serial, step, name) -> values; call `step` until then."""
    found = {}
    for message in messages(server, agent):
        step()
        if message["type"] == "table" and message["name"] == "observations":
            table = columns_of(message)
            assert set(table["agent"]) == {agent}
            rows = zip(table["step"].tolist(), table["name"], table["values"], strict=True)
            found |= {(message["serial"], step, name): values for step, name, values in rows}
        if len(found) >= count:
            return found


def recorded_observations(folder, agent_id):
    """Return the same of recordings, by the number of the episode."""
    rows = {}
    for path in episodes_in(folder):
        episode = RecordedEpisode(path)
        table = episode.table("observations")
        for step, agent, name, values in zip(
            table["step"].tolist(), table["agent_id"].tolist(), table["name"], table["values"], strict=True
        ):
            if agent == agent_id:
                rows[int(episode.facts["episode"]) + 1, step, name] = np.asarray(values, np.float32)
    return rows


@pytest.mark.parametrize("features", [True, False])
def test_what_an_agent_observes_is_shown_as_it_is_recorded(server, monkeypatch, tmp_path, features):
    monkeypatch.setenv(ENVISION, f"127.0.0.1:{server.port}")
    options = Options(record=tmp_path, record_observations=["agent-1"])
    interface = benchmark_interface(waypoints=True, neighborhood_vehicles=True)
    agents = {f"agent-{number}": interface for number in range(2)}
    if features:
        made = VectorHiWayEnv(1, ["intersection"], agents, seed=1, simulation=options)
        made.reset()

        def step():
            made.step([np.zeros((1, 2), np.int64)])

    else:
        made = HiWayEnv(["intersection"], agents, decision_interval=5, seed=1, simulation=options)
        active = [*made.reset()[0]]

        def step():
            terminated = made.step(dict.fromkeys(active, "keep_lane"))[2]
            active[:] = [name for name in active if not terminated.get(name, True)]
            active[:] = active if active else [*made.reset()[0]]

    found = observed_live(server, step, agent=1, count=6)
    made.close()
    recorded = recorded_observations(tmp_path, 1)
    policy = {"observation", "action_mask"} if features else set()
    assert {name for *_, name in found} == {"waypoints", "neighbors"} | policy
    assert any(len(values) for values in found.values())
    for key, values in found.items():
        np.testing.assert_array_equal(values, recorded[key])


def test_simulations_that_a_process_does_not_send_are_counted(server, monkeypatch):
    monkeypatch.setattr(publisher, "MOST_SHOWN", 1)
    monkeypatch.setenv(ENVISION, f"127.0.0.1:{server.port}")
    env = VectorHiWayEnv(2, ["intersection"], 4, seed=1)
    env.reset()
    with viewer(server) as browser:
        while True:
            env.step(KEEP)
            message = unpack(browser.recv(timeout=LIMIT))
            if message["type"] == "sources" and message["sources"] and message["hidden"]:
                break
    assert (len(message["sources"]), message["hidden"]) == (1, 1)
    env.close()


def test_steps_are_the_same_with_and_without_a_viewer(server, env, monkeypatch):
    monkeypatch.delenv(ENVISION)
    alone = VectorHiWayEnv(2, ["intersection"], 4, seed=1)
    env.reset()
    alone.reset()
    for _ in range(20):
        shown, hidden = env.step(KEEP), alone.step(KEEP)
        np.testing.assert_array_equal(shown.rewards, hidden.rewards)
    alone.close()


@pytest.mark.parametrize("text", ["8081", "host:99999", "http://host:1/"])
def test_other_texts_are_no_addresses(text):
    with pytest.raises(SmartsError, match="envision"):
        Options(envision=text)


def test_a_refusal_is_named_once(caplog, monkeypatch):
    # Simulations of a process have an outlet each, and each tries again and again.
    monkeypatch.setattr(outlet, "_RETRY", 0.01)
    monkeypatch.setattr(outlet, "_warned", set())
    tries = []
    shaken = outlet._shaken
    monkeypatch.setattr(outlet, "_shaken", lambda *given: tries.append(1) or shaken(*given))
    with serving(live=True, host="0.0.0.0", token="secret") as server:
        address = f"bad@127.0.0.1:{server.port}"
        outlets = [outlet.Outlet(Address.parse(address, "x")) for _ in range(2)]
        until = time.monotonic() + LIMIT
        while len(tries) < 6 and time.monotonic() < until:
            time.sleep(0.01)
        for each in outlets:
            each.close()
    (warning,) = [record.getMessage() for record in caplog.records if record.name == "smarts"]
    assert f"127.0.0.1:{server.port}" in warning
    assert "TOKEN@" in warning
    assert "secret" not in warning
    assert "bad@" not in warning


def listed(server, wanted, step):
    """Return the list of simulations for which `wanted` holds; `step` is called until then."""
    with viewer(server) as browser:
        while True:
            message = unpack(browser.recv(timeout=LIMIT))
            step()
            if message["type"] == "sources" and wanted(message["sources"]):
                return message["sources"]


def test_a_server_that_comes_late_and_goes_shows_what_runs_then(monkeypatch):
    monkeypatch.setattr(outlet, "_RETRY", 0.05)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    env = VectorHiWayEnv(2, ["intersection"], 4, seed=1, simulation=Options(envision=f"127.0.0.1:{port}"))
    env.reset()
    for _ in range(2):
        env.step(KEEP)
        with serving(live=True, port=port) as server:
            found = listed(
                server, lambda rows: len(rows) == 2 and rows[0]["step"] > 0, lambda: env.step(KEEP)
            )
            assert {row["episode"] for row in found} <= {0, 1, 2, 3}
    env.close()


def test_a_process_that_was_forked_off_is_shown_beside_its_parent(server, env):
    env.reset()
    listed(server, lambda rows: len(rows) == 2, lambda: env.step(KEEP))
    child = os.fork()
    if not child:
        while True:
            env.step(KEEP)
            time.sleep(0.02)
    try:
        # Between two episodes a simulation does not run.
        found = listed(server, lambda rows: sum(row["running"] for row in rows) == 4, lambda: env.step(KEEP))
        assert {row["pid"] for row in found} == {os.getpid(), child}
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    listed(server, lambda rows: sum(row["running"] for row in rows) == 2, lambda: env.step(KEEP))
