"""Agents at addresses, and egos that they drive."""

import socket
import struct
import threading
import time
from contextlib import ExitStack, closing

import numpy as np
import pytest

from smarts.agents.acting import Late, Request
from smarts.agents.hosting import links
from smarts.agents.hosting.facts import facts_from, facts_of, interface_from
from smarts.agents.hosting.hosts import Hosts
from smarts.agents.hosting.links import AtAddress
from smarts.agents.hosting.options import HostError, HostOptions
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
from smarts_agent_kit.server import AddressError, parse_address, secret_for, serve_address
from smarts_agent_kit.wire import Message, WireError, encode
from tests.raising import raises
from tests.served_agents import kit_agent, served

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
import os, signal
import numpy as np
from smarts_agent_kit import BatchAgent

class Seeing(BatchAgent):
    interface = {"action": "Lane"}
    observation = ["speed"]

    def act(self, batch):
        if batch.step[0] == 12:
            os.kill(os.getpid(), signal.SIGKILL)
        kept = [name in os.environ for name in ("PATH", "OMP_FOR_A_TEST", "MY_TOKEN")]
        kept += [name in os.environ for name in ("SMARTS_AGENT_SECRET", "SMARTS_ENVISION")]
        return np.tile(kept, (len(batch.env_id), 1))
"""


def test_a_served_agent_sees_few_environment_variables_and_its_end_is_named(tmp_path, monkeypatch):
    given = {SECRET: "0123456789abcdef", "OMP_FOR_A_TEST": "1", "MY_TOKEN": "mine"}
    given["SMARTS_ENVISION"] = "localhost:1"
    for name, value in given.items():
        monkeypatch.setenv(name, value)
    (tmp_path / "seeing.py").write_text(SEEING)
    command = ("-m", "smarts_agent_kit", "seeing:Seeing", "--address", "127.0.0.1:0")
    with served(*command, PYTHONPATH=str(tmp_path)) as address:
        agent = make_agent(address)[0]
        assert agent.act(batch(1)).tolist() == [[True, True, False, False, False]]
        with raises(HostError, "step 12", values=["the connection has ended"]):
            agent.act(batch(step=12))


def test_what_simulators_send_to_an_address_names_no_code(tmp_path):
    with kit_agent(tmp_path) as address:
        with closing(AtAddress(address).open()) as link:
            assert link.wait(soon()).kind == "about"
            link.send(Message("make", {"agent": "os:system", "options": {"command": "touch /tmp/x"}}))
            answer = link.wait(soon())
            assert answer.values["observation"] == ["speed"]
        with pytest.raises(SmartsError):
            make_spec(address, command="touch /tmp/x")


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


def test_a_server_without_room_says_so_to_clients_that_know_the_secret():
    full = {"has_room": lambda: False}
    assert handshake("a" * 16, "a" * 16, **full) == {"client": BusyError, "server": BusyError}
    assert handshake("a" * 16, "b" * 16, **full) == {"client": RefusedError, "server": RefusedError}


def test_before_the_proof_messages_are_short():
    near, far = socket.socketpair()
    with closing(near), closing(Channel(far)) as channel:
        near.sendall(b"\xc6" + struct.pack(">I", 2**20) + bytes(2**17))  # the first of so many bytes
        with pytest.raises(WireError):
            admit(channel, "")


def test_a_served_secret_is_needed(tmp_path, monkeypatch):
    with kit_agent(tmp_path, **{SECRET: "0123456789abcdef"}) as address:
        with pytest.raises(HostError):
            make_agent(address)
        monkeypatch.setenv(SECRET, "0123456789abcdef")
        make_agent(address)[0].close()


def test_addresses_that_cannot_be_used_are_errors():
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
    for address in ("tcp://somewhere", "tcp://192.0.2.1:7007", f"tcp://127.0.0.1:{port}"):
        with raises(HostError, values=[address]):
            make_spec(address)


def test_silent_addresses_keep_no_step_waiting(monkeypatch):
    monkeypatch.setattr(links, "CONNECT_TIME", 1000.0)
    with ExitStack() as stack:
        silent = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(3)]
        starts = [AtAddress(f"tcp://127.0.0.1:{each.getsockname()[1]}") for each in silent]
        spec, options = AgentSpec(AgentInterface()), HostOptions(deadline_ms=9_000.0)
        # Hosts whose connections have ended.
        hosts = Hosts(
            [SocialPolicy("away", each.locator, spec, 0, start=each, host=options) for each in starts]
        )
        hosts._has_begun = True
        stack.callback(hosts.close)
        with monkeypatch.context() as waiting:
            waiting.setattr(threading.Thread, "join", lambda *_: pytest.fail("the step waits"))
            for _ in range(2):
                hosts.dispatch({number: Request(batch()) for number in range(3)})
                assert [[*answer.actions] for answer in hosts.gather()] == [[Late()] * 3] * 3


def test_secrets_are_needed_beyond_this_machine(monkeypatch):
    monkeypatch.delenv(SECRET, raising=False)
    assert secret_for("localhost") == secret_for("::1") == ""
    for host in ("0.0.0.0", "192.0.2.1"):
        with pytest.raises(AddressError):
            secret_for(host)
    monkeypatch.setenv(SECRET, "short")
    with pytest.raises(AddressError):
        secret_for("localhost")


def test_a_port_that_is_taken_is_named_with_a_remedy():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(AddressError, match=f"'{address}'.*already in use.*free port"):
            serve_address(address, "smarts.zoo.serving", {}, paths=())


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
        {"interface": ["Lane"]},
        {"interface": {"action": "Fly"}},
        {"interface": {"further_sensors": [["os:system", True]]}},
        {"interface": {"done_criteria": {"wings": True}}},
        {"observation": "os:system"},
        {"observation": {"features": [{"name": "os:system"}]}},
        {"period": 0},
    ],
)
def test_what_an_agent_elsewhere_may_not_say_of_itself(facts):
    about = {"interface": {"action": "Lane"}, "observation": ["speed"], "period": 1}
    assert facts_from(about, "there").period == 1
    with raises(SmartsError, "there"):
        facts_from(about | facts, "there")


def test_a_misspelt_field_of_an_agent_elsewhere_is_named_with_the_nearest():
    with raises(SmartsError, "there", values=["'actoin'", "did you mean 'action'"]):
        interface_from({"actoin": "Lane"}, "there")


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
