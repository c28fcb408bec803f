"""A real environment, a real server, a real viewer."""

import json
import socket
from contextlib import closing

import numpy as np
import pytest

from smarts.agents.benchmark import benchmark_interface
from smarts.env import HiWayEnv
from smarts.env.vector import VectorHiWayEnv
from smarts.errors import SmartsError, TrafficError
from smarts.providers.sumo_traffic import SumoTraffic
from smarts.sim import outlet
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.sim.options import ENVISION, Options
from smarts.stream.container import unpack
from smarts.stream.motion import OWNER_BITS
from smarts.types.vehicles import Owner
from tests.compact_reading import columns_of, motion_of
from tests.viewers import serving, viewer

KEEP = [np.zeros((2, 4), np.int64)]
LIMIT = 60


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


def test_an_episode_whose_traffic_fails_is_said_to_be_invalid(server, monkeypatch):
    def fail(traffic):
        raise TrafficError("SUMO is gone")

    monkeypatch.setenv(ENVISION, f"127.0.0.1:{server.port}")
    with closing(VectorHiWayEnv(1, ["intersection"], 4, traffic=["random_social_vehicles"])) as env:
        env.reset(1)
        for message in messages(server):
            if message["type"] == "steps":
                monkeypatch.setattr(SumoTraffic, "step", fail)
            env.step([KEEP[0][:1]])
            if message["type"] == "end":
                break
    assert (bool(message["is_complete"]), message["remark"]) == (False, "invalid: SUMO is gone")


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
