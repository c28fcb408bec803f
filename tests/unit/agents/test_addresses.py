"""Agents at addresses, and egos that they drive."""

import os
import socket
import struct
import threading
import time
from contextlib import ExitStack, closing

import numpy as np
import pytest

from smarts.agents.acting import Late, Request
from smarts.agents.hosting import links
from smarts.agents.hosting.facts import check_observation, facts_of, interface_from
from smarts.agents.hosting.hosts import Hosts
from smarts.agents.hosting.links import AtAddress
from smarts.agents.hosting.options import HostError, HostOptions
from smarts.agents.hosting.remote import RemoteAgent
from smarts.agents.interface import AgentInterface, DoneCriteria
from smarts.agents.options import Waypoints
from smarts.agents.social import SocialPolicy
from smarts.agents.spec import AgentSpec
from smarts.errors import SmartsError
from smarts.types.actions import ActionSpaceType
from smarts.zoo import make_agent, make_spec
from smarts_agent_kit import ActionBatch
from smarts_agent_kit.channel import Channel
from smarts_agent_kit.handshake import SECRET, BusyError, RefusedError, admit, greet
from smarts_agent_kit.server import AddressError, parse_address, secret_for
from smarts_agent_kit.wire import VERSION, Message, WireError, encode
from tests.raising import raises
from tests.served_agents import kit_agent, served
from tests.unit.agents.test_wire import fuzzed

pytestmark = pytest.mark.usefixtures("nothing_is_left")


def soon():
    return time.monotonic() + 10.0


def batch(count=3, step=5):
    return ActionBatch(
        {"observation": np.ones((count, 1))},
        np.ones((count, 4), bool),
        np.zeros(count, np.int32),
        np.arange(count, dtype=np.int32),
        np.arange(count, dtype=np.int64),
        np.zeros(count, np.int32),
        np.full(count, step, np.int32),
        np.ones(count, bool),
        np.arange(count, dtype=np.uint64),
        np.ones(count, bool),
    )


def test_each_connection_has_an_agent_of_its_own_that_acts_as_in_process(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(tmp_path))
    with kit_agent(tmp_path) as address:
        agents = [make_agent(address)[0] for _ in range(3)]
        spec = make_spec(address)
        assert spec.interface == AgentInterface(
            action=ActionSpaceType.Lane,
            vehicle_model="kinematic",
            done_criteria=DoneCriteria(off_route=False),
        )
        from drawing import Drawing

        for step in range(5):
            expected = Drawing().act(batch(step=step))
            for agent in agents:
                assert np.array_equal(agent.act(batch(step=step)), expected)
        for agent in agents:
            agent.close()


SEEING = """
import os
import numpy as np
from smarts_agent_kit import BatchAgent

class Seeing(BatchAgent):
    interface = {"action": "Lane"}
    observation = ["speed"]

    def act(self, batch):
        kept = [name in os.environ for name in ("PATH", "OMP_FOR_A_TEST", "MY_TOKEN")]
        kept += [name in os.environ for name in ("SMARTS_AGENT_SECRET", "SMARTS_ENVISION")]
        return np.tile(kept, (len(batch.env_id), 1))
"""


def test_a_served_agent_sees_the_same_few_environment_variables(tmp_path, monkeypatch):
    given = {SECRET: "0123456789abcdef", "OMP_FOR_A_TEST": "1", "MY_TOKEN": "mine"}
    given["SMARTS_ENVISION"] = "token@localhost:1"
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    (tmp_path / "seeing.py").write_text(SEEING)
    command = ("-m", "smarts_agent_kit", "seeing:Seeing", "--address", "127.0.0.1:0")
    with served(*command, PYTHONPATH=str(tmp_path)) as address:
        agent = make_agent(address)[0]
        assert agent.act(batch(1)).tolist() == [[True, True, False, False, False]]
        agent.close()


def test_what_simulators_send_to_an_address_names_no_code(tmp_path):
    with kit_agent(tmp_path) as address:
        with closing(AtAddress(address).open()) as link:
            assert link.wait(soon()).kind == "about"
            link.send(Message("make", {"agent": "os:system", "options": {"command": "touch /tmp/x"}}))
            answer = link.wait(soon())
            assert answer.values["observation"] == ["speed"]
        with pytest.raises(SmartsError):
            make_spec(address, command="touch /tmp/x")


def test_fuzzed_messages_leave_the_server_as_it_was(tmp_path):
    with kit_agent(tmp_path) as address:
        frames = [*fuzzed(2, 2_000)]
        for part in range(0, len(frames), 500):
            with socket.create_connection(parse_address(address)) as connection:
                connection.settimeout(5.0)
                for frame in frames[part : part + 500]:
                    try:
                        connection.sendall(frame)
                    except OSError:
                        break
        agent = make_agent(address)[0]
        assert len(agent.act(batch())) == 3
        agent.close()


def handshake(server_secret, client_secret, **more):
    """Return what client and server raise."""
    near, far = socket.socketpair()
    raised = {}

    def run(side, function, *arguments, **more):
        try:
            function(*arguments, **more)
        except Exception as error:
            raised[side] = type(error)

    with closing(Channel(near)) as client, closing(Channel(far)) as server:
        thread = threading.Thread(target=run, args=("server", admit, server, server_secret), kwargs=more)
        thread.start()
        run("client", greet, client, client_secret, soon())
        client.close()
        thread.join()
    return raised


def test_both_sides_need_the_same_secret():
    assert handshake("a" * 16, "a" * 16) == {}
    assert handshake("a" * 16, "b" * 16) == {"client": RefusedError, "server": RefusedError}
    assert handshake("a" * 16, "") == {"client": RefusedError, "server": RefusedError}


@pytest.mark.parametrize(
    "hello",
    [
        Message("hello", {"version": VERSION + 1, "nonce": "0" * 64}),
        Message("hello", {"version": VERSION}),
        Message("hello", {"version": VERSION, "nonce": "0" * 64, "proof": "0"}),
    ],
)
def test_a_wrong_greeting_is_refused_by_both_sides(hello):
    near, far = socket.socketpair()
    with closing(Channel(near)) as one, closing(Channel(far)) as two:
        one.send(hello)
        with pytest.raises(RefusedError):
            admit(two, "")
    near, far = socket.socketpair()
    with closing(Channel(near)) as one, closing(Channel(far)) as two:
        one.send(hello)
        two.send(Message("proof", {"proof": "0"}))
        one.send(Message("proof", {"proof": "0"}))
        with pytest.raises(RefusedError):
            greet(two, "", soon())


def test_a_server_without_room_says_so_to_clients_that_know_the_secret():
    full = {"has_room": lambda: False}
    assert handshake("a" * 16, "a" * 16, **full) == {"client": BusyError, "server": BusyError}
    assert handshake("a" * 16, "b" * 16, **full) == {"client": RefusedError, "server": RefusedError}


def test_before_the_proof_messages_are_short():
    near, far = socket.socketpair()
    with closing(near), closing(Channel(far)) as channel:
        near.sendall(struct.pack("<I", 2**20))
        with pytest.raises(WireError):
            admit(channel, "")


def test_a_served_secret_is_needed(tmp_path, monkeypatch):
    with kit_agent(tmp_path, **{SECRET: "0123456789abcdef"}) as address:
        with pytest.raises(HostError):
            make_agent(address)
        monkeypatch.setenv(SECRET, "0123456789abcdef")
        make_agent(address)[0].close()


@pytest.mark.parametrize(
    "address",
    ["tcp://somewhere", "tcp://127.0.0.1:99999", "tcp://192.0.2.1:7007"],
)
def test_wrong_addresses_are_errors(address):
    with pytest.raises(HostError) as raised:
        make_spec(address)
    assert address in raised.value.place


def test_an_address_where_nobody_answers_is_an_error():
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
    with pytest.raises(HostError):
        make_spec(f"tcp://127.0.0.1:{port}")


def hosts_at(*addresses):
    """Return hosts with deadlines whose connections have ended."""
    starts = [AtAddress(address) for address in addresses]
    options = HostOptions(deadline_ms=9_000.0)
    hosts = Hosts(
        [
            SocialPolicy(
                f"away-{k}", start.locator, AgentSpec(AgentInterface()), 0, start=start, host=options
            )
            for k, start in enumerate(starts)
        ]
    )
    hosts._owner = os.getpid()
    return hosts


def test_vehicles_that_a_new_process_does_not_know_begin_with_is_first():
    away = hosts_at("tcp://127.0.0.1:7007")._away[0]
    later = batch()._replace(is_first=np.zeros(3, bool))
    found = []
    for _ in range(2):
        away._use(None)  # of another process
        found += [away._with_first(later).is_first.tolist() for _ in range(2)]
    assert found == 2 * [[True] * 3, [False] * 3]


def test_silent_addresses_keep_no_step_waiting(monkeypatch):
    monkeypatch.setattr(links, "CONNECT_TIME", 1000.0)
    with ExitStack() as stack:
        silent = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(3)]
        hosts = hosts_at(*(f"tcp://127.0.0.1:{each.getsockname()[1]}" for each in silent))
        stack.callback(hosts.close)
        with monkeypatch.context() as waiting:
            waiting.setattr(threading.Thread, "join", lambda *_: pytest.fail("the step waits"))
            for _ in range(2):
                hosts.dispatch({number: Request(batch()) for number in range(3)})
                answers = hosts.gather()
                assert [[*answer.actions] for answer in answers] == [[Late()] * 3] * 3


def test_secrets_are_needed_beyond_this_machine(monkeypatch):
    monkeypatch.delenv(SECRET, raising=False)
    assert secret_for("localhost") == secret_for("::1") == ""
    for host in ("0.0.0.0", "192.0.2.1"):
        with pytest.raises(AddressError):
            secret_for(host)
    monkeypatch.setenv(SECRET, "short")
    with pytest.raises(AddressError):
        secret_for("localhost")


def test_interfaces_survive_the_way_over_plain_values():
    for interface in (
        AgentInterface(action=ActionSpaceType.Lane),
        AgentInterface(
            action=ActionSpaceType.Continuous,
            waypoint_paths=Waypoints(lookahead=20),
            signals=True,
            done_criteria=DoneCriteria(off_route=False, not_moving=True),
            max_episode_steps=100,
            flat_tyres=(1, 2),
            vehicle_class="truck",
        ),
    ):
        facts = facts_of(interface)
        encode(Message("about", {"interface": facts}))
        assert interface_from(facts, "here") == interface


@pytest.mark.parametrize(
    "facts",
    [
        ["Lane"],
        {"action": "Fly"},
        {"further_sensors": [["os:system", True]]},
        {"os:system": True},
        {"done_criteria": {"wings": True}},
    ],
)
def test_interfaces_that_are_none_are_errors(facts):
    with pytest.raises(SmartsError) as raised:
        interface_from(facts, "there")
    assert raised.value.place


@pytest.mark.parametrize(
    "observation",
    ["os:system", {"features": [{"name": "os:system"}]}],
)
def test_an_agent_elsewhere_names_no_code_of_this_machine(observation):
    with pytest.raises(HostError):
        check_observation(observation, "there")


def ask_for_ever(agent):
    while True:
        agent.act(batch())


def test_an_agent_ends_with_its_server(tmp_path):
    with kit_agent(tmp_path) as address:
        agent = RemoteAgent(AtAddress(address))
    with pytest.raises(HostError):
        ask_for_ever(agent)  # its process ends soon after that of the server


HARMING = """
import os, signal
from smarts_agent_kit import BatchAgent

class Harming(BatchAgent):
    interface = {"action": "Lane"}
    observation = ["speed"]
    asked = 0

    def act(self, batch):
        self.asked += 1
        if self.asked == 3:
            os.kill(os.getpid(), signal.SIGKILL)
        return batch.agent_id
"""


def test_a_served_agent_that_is_killed_names_signal_and_step(tmp_path):
    (tmp_path / "harming.py").write_text(HARMING)
    command = ("-m", "smarts_agent_kit", "harming:Harming", "--address", "127.0.0.1:0")
    with served(*command, PYTHONPATH=str(tmp_path)) as address:
        agent = RemoteAgent(AtAddress(address))
        for step in (10, 11):
            agent.act(batch(step=step))
        with raises(HostError, "step 12", values=["killed by SIGKILL"]):
            agent.act(batch(step=12))


def test_more_simulators_than_a_server_has_room_for_are_turned_away(tmp_path, monkeypatch):
    (tmp_path / "sitecustomize.py").write_text(
        "import smarts_agent_kit.server\nsmarts_agent_kit.server.MOST_CONNECTIONS = 1\n"
    )
    with kit_agent(tmp_path) as address:
        with closing(AtAddress(address).open()) as link:
            assert link.wait(soon()).kind == "about"
            with pytest.raises(HostError) as raised:
                make_agent(address)
            assert address in raised.value.place
            assert isinstance(raised.value.__cause__, BusyError)
        until = soon()
        while True:
            try:
                return make_agent(address)[0].close()
            except HostError:
                assert time.monotonic() < until, "there is no room after the first has left"
                time.sleep(0.05)


def test_connections_that_say_nothing_keep_no_simulator_out(tmp_path):
    with kit_agent(tmp_path) as address, ExitStack() as idle:
        for _ in range(100):
            idle.enter_context(socket.create_connection(parse_address(address)))
        agent = make_agent(address)[0]
        assert len(agent.act(batch())) == 3
        agent.close()
