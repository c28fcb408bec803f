"""Social agents in processes of their own: the same trajectories, and failures that stay theirs."""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from smarts.agents.acting import Failed, Request
from smarts.agents.hosting.links import SocketLink
from smarts.agents.hosting.log import DecisionLog, Replayed, messages_of
from smarts.agents.hosting.options import HostError, HostOptions, about
from smarts.agents.options import InterfaceError
from smarts.agents.policy import ActionBatch
from smarts.env.vector import VectorHiWayEnv
from smarts_agent_kit.channel import Channel
from smarts_agent_kit.service import LONGEST_PROBLEM
from smarts_agent_kit.wire import Message

DRAWING, MISBEHAVING = "tests.hosted_agents:drawing-v0", "tests.hosted_agents:misbehaving-v0"
MIXED = [{"agent": "idm-v0", "count": 1}, {"agent": DRAWING, "count": 1}]


def environment(social, hosts, num_envs=1, scenario="intersection", **more):
    return VectorHiWayEnv(
        num_envs, [scenario], 1, social_agents=social, hosts=hosts, decision_interval=1, traffic=None, **more
    )


def state(env):
    vehicles = env._runner.world.vehicles
    return vehicles.position.tobytes(), vehicles.speed.tobytes(), vehicles.alive.tobytes()


def steps(env, count):
    """Yield the results of steps in which the egos keep their lanes."""
    for _ in range(count):
        actions = [
            np.zeros((env.num_envs, len(block.agents), *block.action.shape), block.action.dtype)
            for block in env.spaces.blocks
        ]
        yield env.step(actions)


def played(social, hosts, count=60, **more):
    """Return the states after each step, and the failures."""
    with closing(environment(social, hosts, **more)) as env:
        first, failures = env.reset(), {}
        states = [state(env)]
        failures.update(first.social_failures)
        for result in steps(env, count):
            states.append(state(env))
            for row, named in result.social_failures.items():
                failures.setdefault(row, {}).update(named)
        return states, failures


def descendants():
    """Return the numbers of all processes below this one that still run."""
    parents = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            try:
                text = (folder / "stat").read_text()
            except OSError:
                continue
            status, parent = text.rpartition(")")[2].split()[:2]
            if status != "Z":
                parents[int(folder.name)] = int(parent)
    below = {os.getpid()}
    while True:
        more = {pid for pid, parent in parents.items() if parent in below} - below
        if not more:
            return below - {os.getpid()}
        below |= more


def resources():
    """Return what a host may leave behind: processes, files of its own, open sockets."""
    sockets = sum(Path(f"/proc/self/fd/{fd}").is_socket() for fd in os.listdir("/proc/self/fd"))
    return descendants(), {each.name for each in Path(tempfile.gettempdir()).iterdir()}, sockets


@pytest.fixture(autouse=True)
def nothing_is_left(tmp_path_factory, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path_factory.mktemp("temporary")))
    before = resources()
    yield
    until = time.monotonic() + 5.0
    while resources() != before and time.monotonic() < until:
        time.sleep(0.05)
    assert resources() == before


def test_agents_in_processes_drive_as_in_this_one_bit_by_bit():
    here = played(MIXED, {}, num_envs=2)
    assert played(MIXED, {"*": "process"}, num_envs=2) == here
    assert played(MIXED, {DRAWING: HostOptions("process")}, num_envs=2) == here


def test_a_reset_in_mid_episode_changes_nothing():
    found = []
    for hosts in ({}, {"*": "process"}):
        with closing(environment(MIXED, hosts)) as env:
            states = []
            for _ in range(3):
                env.reset()
                states += [state(env) for _ in steps(env, 7)]
            found.append(states)
    assert found[0] == found[1]


def hosted(how, **host):
    """Return one agent that misbehaves at its third request, and where it acts."""
    social = [{"agent": MISBEHAVING, "count": 2, "options": {"how": how}}, {"agent": DRAWING, "count": 1}]
    return social, {MISBEHAVING: {"where": "process", "patience": 30.0, **host}}


@pytest.mark.parametrize(
    "how",
    [
        *("loop", "leave", "raise_error", "fill_the_disk", "fill_the_memory"),
        *("answer_texts", "answer_too_few", "answer_too_much", "answer_objects"),
    ],
)
def test_an_agent_that_misbehaves_fails_alone(how):
    social, hosts = hosted(how, memory=1.0, patience=2.0 if how == "loop" else 60.0)
    _, failures = played(social, hosts, count=12)
    (named,) = failures.values()
    assert len(named) == 2


@pytest.mark.parametrize("how", ["fork", "print_much", "read_input"])
def test_an_agent_may_do_what_changes_nothing(how, capfd):
    social, hosts = hosted(how)
    _, failures = played(social, hosts, count=8)
    assert failures == {}
    assert "x" * 100 not in capfd.readouterr().out


def test_what_an_agent_prints_in_its_process_is_seen(capfd):
    social, hosts = hosted("print_once")
    played(social, hosts, count=4)
    assert "a line that an agent prints" in capfd.readouterr().err


@pytest.mark.parametrize("how", ["raise_error", "raise_lines"])
def test_what_an_agent_raises_is_said_in_the_same_words_everywhere(how):
    social, hosts = hosted(how)
    states, failures = played(social, hosts, count=6)
    assert (states, failures) == played(social, {}, count=6)
    (named,) = failures.values()
    assert all(each.isprintable() and len(each) <= LONGEST_PROBLEM for each in named.values())
    assert all("ValueError: not today" in each for each in named.values())


def test_a_failure_that_an_address_sends_is_one_line():
    near, far = socket.socketpair()
    with closing(Channel(far)) as agent, closing(SocketLink(Channel(near))) as link:
        agent.send(Message("failed", {"problem": "no\nagent \x1b[31m"}))
        with pytest.raises(HostError) as raised:
            about(link, "there")
    assert raised.value.problem.isprintable()
    assert "no agent" in raised.value.problem


def workers_of(link):
    """Return the process of an agent, below its supervisor, if it is there."""
    return [int(pid) for pid in Path(f"/proc/{link.pid}/task/{link.pid}/children").read_text().split()]


def host_of(env):
    return env._runner._requests._host


def test_a_host_that_is_stopped_is_ended_and_started_again(monkeypatch):
    social, hosts = [{"agent": DRAWING, "count": 2}], {DRAWING: {"where": "process", "patience": 0.5}}
    with closing(environment(social, hosts)) as env:
        env.reset()
        [*steps(env, 3)]
        (link,) = host_of(env).links.values()
        os.kill(workers_of(link)[0], signal.SIGSTOP)
        failures = {}
        for result in steps(env, 2):
            failures |= result.social_failures.get(0, {})
        assert len(failures) == 2
        env.reset()
        assert not any(result.social_failures for result in steps(env, 5))
        (again,) = host_of(env).links.values()
        assert again is not link


def test_a_supervisor_that_is_stopped_is_ended_too(monkeypatch):
    monkeypatch.setattr("smarts.agents.hosting.links.END_TIME", 0.2)
    with closing(environment([{"agent": DRAWING}], {"*": "process"})) as env:
        env.reset()
        (link,) = host_of(env).links.values()
        os.kill(link.pid, signal.SIGSTOP)


def test_every_step_completes_whatever_is_killed():
    draws = np.random.default_rng(3)
    social = [{"agent": DRAWING, "count": 1}, {"agent": "random-v0", "count": 1}]
    with closing(environment(social, {"*": {"where": "process", "patience": 5.0}})) as env:
        env.reset()
        kills = 0
        while kills < 50:
            for link in host_of(env).links.values():
                if draws.random() < 0.7:
                    os.kill(draws.choice([link.pid, *workers_of(link)]), signal.SIGKILL)
                    kills += 1
            [*steps(env, int(draws.integers(1, 4)))]
            env.reset()


def decided(log):
    """Return seeds and steps of the decisions in a log: those in time, and late ones."""
    taken, late = set(), set()
    for file in Path(log).glob("*.decisions"):
        for message in messages_of(file):
            keys = zip(message.arrays["seed"].tolist(), message.arrays["step"].tolist(), strict=True)
            (late if message.values.get("late") else taken).update(keys)
    return taken, late


def test_late_answers_are_dropped_and_a_log_of_them_repeats_the_run_bit_by_bit(tmp_path):
    """The agent sleeps for 0.3 s at its third request, and nothing else is slow."""
    social = [{"agent": MISBEHAVING, "count": 1, "options": {"how": "sleep"}}, {"agent": DRAWING, "count": 1}]
    timing = {"where": "process", "deadline_ms": 60.0, "log": str(tmp_path)}
    with closing(environment(social, {MISBEHAVING: timing})) as env:
        env.reset()
        states = []
        for result in steps(env, 60):
            assert not result.social_failures
            states.append(state(env))
            time.sleep(0.01)
    taken, late = decided(tmp_path)
    assert {2, 3} <= {step for _, step in late}
    assert len(taken) > len(late)
    assert not taken & late
    again, failures = played(social, {MISBEHAVING: {"replay": str(tmp_path)}})
    assert again[1:] == states
    assert failures == {}


def test_a_replay_without_a_log_is_an_error(tmp_path):
    with pytest.raises(HostError):
        environment([{"agent": DRAWING}], {DRAWING: {"replay": str(tmp_path)}})
    (tmp_path / "x.decisions").write_bytes(bytes([8, 0, 0, 0, 4, 0, 0, 0, 1, 2, 3, 4]))
    with pytest.raises(HostError):
        environment([{"agent": DRAWING}], {DRAWING: {"replay": str(tmp_path)}})


def logged(folder, *answers):
    """Write a log with the answers to one question, each as another run's."""
    zeros, ones = np.zeros(1, np.int32), np.ones(1, np.bool_)
    seed, step = np.array([7], np.uint64), np.array([3], np.int32)
    batch = ActionBatch(
        {}, ones[:, None], zeros, zeros, zeros.astype(np.int64), zeros, step, ones, seed, ones
    )
    for answer in answers:
        with closing(DecisionLog(folder)) as log:
            if answer is None:
                log.write_late(Request(batch))
            else:
                log.write(Request(batch), answer)
    return Request(batch)


@pytest.mark.parametrize(
    "other", [np.array([2]), np.array([1.0]), np.array([[1]]), [Failed("raised ValueError")], None]
)
def test_a_log_with_two_answers_to_one_question_is_no_replay(tmp_path, other):
    request = logged(tmp_path / "once", np.array([1]), np.array([1]))
    replayed = Replayed(tmp_path / "once")
    replayed.ask(request)
    ((_, actions),) = replayed.take()
    assert [*actions] == [1]
    logged(tmp_path / "twice", np.array([1]), other)
    with pytest.raises(HostError) as raised:
        Replayed(tmp_path / "twice")
    assert str(tmp_path / "twice") in raised.value.place
    assert "7" in raised.value.problem
    assert "3" in raised.value.problem


def test_an_agent_of_this_process_is_never_late(tmp_path):
    for given in ({"deadline_ms": 10.0}, {"log": str(tmp_path)}):
        with pytest.raises(HostError):
            environment([{"agent": DRAWING}], {DRAWING: given})


@pytest.mark.parametrize("where", ["in_process", "process"])
def test_delayed_actions_are_those_of_earlier_steps(where):
    """An agent that is delayed by d steps acts at step k + d as it decided at step k."""
    delay = 4
    records = {}
    for steps_late in (0, delay):
        hosts = {DRAWING: {"where": where, "delay_steps": steps_late}}
        with closing(environment([{"agent": DRAWING, "count": 1}], hosts)) as env:
            env.reset()
            values = env._runner.actions.values
            column = env._runner._pool.columns(0).start
            taken = []
            for _ in steps(env, 15):
                taken.append(float(values[0, column, 0]))
            records[steps_late] = taken
    # The draws depend on seed and step alone.
    assert records[delay][delay:] == records[0][:-delay]


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"idm-v0": "elsewhere"}, InterfaceError),
        ({"idm-v0": {"where": "process", "patience": 0}}, InterfaceError),
        ({"idm-v0": {"patiense": 3}}, InterfaceError),
        ({"idm-v0": {"deadline_ms": 20_000.0}}, InterfaceError),
        ({"idm-v0": {"deadline_ms": 20.0, "delay_steps": 1}}, InterfaceError),
        ({"idm-v0": {"delay_steps": 1.5}}, InterfaceError),
        ({"idm-v0": 3}, InterfaceError),
        ({3: "process"}, InterfaceError),
        ({"mobil-v0": "process"}, InterfaceError),
        ("process", InterfaceError),
    ],
)
def test_hosts_that_cannot_be_are_errors_before_the_first_step(given, error):
    with pytest.raises(error) as raised:
        environment([{"agent": "idm-v0"}], given)
    assert "hosts" in raised.value.place


def test_an_agent_of_objects_acts_in_this_process_alone():
    describing = "tests.hosted_agents:describing-v0"
    with pytest.raises(HostError):
        environment([{"agent": describing}], {describing: "process"})
    with closing(environment([{"agent": describing}], {"*": "process"})) as env:
        env.reset()
        assert not host_of(env).links


def test_requests_that_no_message_holds_are_an_error_before_the_first_step():
    large = "tests.hosted_agents:large-v0"
    with pytest.raises(HostError) as raised:
        environment([{"agent": large}], {large: "process"})
    assert large in raised.value.place


def test_an_agent_that_cannot_be_made_elsewhere_is_one_error(monkeypatch):
    """The folder of its module is gone when the process starts."""
    with closing(environment([{"agent": DRAWING}], {"*": "process"})) as env:
        start = host_of(env)._away[0]._starter
        object.__setattr__(start, "values", {**start.values, "agent": "no_such_module:agent-v0"})
        with pytest.raises(HostError):
            env.reset()


def test_hosts_start_with_the_first_episode_and_only_if_they_are_needed():
    with closing(environment([{"agent": DRAWING}], {"*": "process"})) as env:
        assert not host_of(env).links
        env.reset()
        assert len(host_of(env).links) == 1
    with closing(environment([], {"*": "process"})) as env:
        env.reset()
        assert env._runner._requests is None


KILLED = """
import sys, time
from tests.unit.env.test_hosts import descendants, environment, hosted, steps
env = environment(*hosted("fork"))
env.reset()
[*steps(env, 8)]
print(*descendants(), flush=True)
time.sleep(1000)
"""


def test_a_simulator_that_is_killed_leaves_no_process_and_no_file():
    """The agent has started processes, in sessions of their own."""
    command = [sys.executable, "-c", KILLED]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as simulator:
        assert simulator.stdout is not None
        started = [int(pid) for pid in simulator.stdout.readline().split()]
        simulator.kill()
    assert len(started) == 4, "a supervisor, an agent, and two processes that it has started"
    until = time.monotonic() + 20.0
    while any(map(is_running, started)) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(map(is_running, started))


def is_running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
