"""Social agents in processes of their own: the same trajectories, and failures that stay theirs."""

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import closing, suppress
from itertools import pairwise
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
from smarts_agent_kit.channel import Channel, wait_for
from smarts_agent_kit.child import MOST_PROCESSES
from smarts_agent_kit.service import LONGEST_PROBLEM
from smarts_agent_kit.wire import Message, encode

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


def test_an_agent_at_an_address_drives_as_in_this_process_bit_by_bit():
    from tests.unit.agents.test_addresses import served

    here = played([{"agent": "tests.hosted_agents:easing-v0", "count": 3}], {})
    assert len(set(here[0])) == len(here[0])
    with served("-m", "smarts_agent_kit", "tests.easing:Easing", "--address", "127.0.0.1:0") as address:
        assert played([{"agent": address, "count": 3}], {}) == here


def test_the_arrays_that_objects_are_made_of_reach_a_process():
    social = [{"agent": "tests.hosted_agents:sensing-v0", "count": 3}]
    states, failures = played(social, {}, count=20)
    assert failures == {}
    assert len(set(states)) == len(states)
    assert played(social, {"*": "process"}, count=20) == (states, failures)


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


@pytest.mark.parametrize("how", ["bomb", "bomb_in_sessions"])
def test_an_agent_that_forks_without_end_is_ended(how):
    """It makes 512 processes, and they stay for a minute; the fixture sees that none is left."""
    social, hosts = hosted(how, patience=60.0)
    _, failures = played(social, hosts, count=6)
    assert len(failures[0]) == 2
    assert all(f"more than {MOST_PROCESSES} processes" in said for said in failures[0].values())


LIMITED = """
import os, sys, time
from smarts_agent_kit import worker
if os.getuid() == 0:
    os.setresgid(65534, 65534, 65534)
    os.setresuid(65534, 65534, 65534)
worker.MOST_TASKS = 20
worker.confine(10**9)
started = []
try:
    while len(started) < 5000:
        child = os.fork()
        if child == 0:
            time.sleep(60)
            os._exit(0)
        started.append(child)
except BlockingIOError:
    print(len(started))
for child in started:
    os.kill(child, 9)
    os.waitpid(child, 0)
"""


def test_the_system_bounds_what_an_agent_starts_unless_it_is_root():
    command = [sys.executable, "-c", LIMITED]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert int(done.stdout) < 1000  # others of the user end meanwhile


def test_a_request_that_takes_too_much_processor_time_is_ended():
    burning = "tests.hosted_agents:burning-v0"
    _, failures = played([{"agent": burning}], {burning: {"where": "process", "patience": 60.0}}, count=4)
    (said,) = failures[0].values()
    assert "SIGXCPU: a request took more processor time than is allowed" in said


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
    assert all(re.search(r"hosted_agents\.py:\d+\)$", each) for each in named.values())


def test_a_failure_that_an_address_sends_is_one_line():
    near, far = socket.socketpair()
    with closing(Channel(far)) as agent, closing(SocketLink(Channel(near))) as link:
        agent.send(Message("failed", {"problem": "no\nagent \x1b[31m"}))
        with pytest.raises(HostError) as raised:
            about(link, "there")
    assert raised.value.problem.isprintable()
    assert "no agent" in raised.value.problem


FORKED = """
import os, sys
from tests.unit.env.test_hosts import DRAWING, descendants, environment, state, steps
env = environment([{"agent": DRAWING, "count": 2}], {"*": "process"})
env.reset()
[*steps(env, 3)]
started = descendants()
child = os.fork()
found = [state(env) if not result.social_failures else None for result in steps(env, 5)]
ended = descendants()
env.close()
if child == 0:
    assert ended and not ended & started
    os._exit(3 if None not in found else 1)
assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 3
assert None not in found and started <= ended
assert not descendants()
"""


def test_an_environment_that_is_forked_in_mid_episode_has_agents_of_its_own():
    """The parent's agents are the parent's still, and end with it although the child has copies of all."""
    subprocess.run([sys.executable, "-c", FORKED], check=True, timeout=60)


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


def test_a_whole_group_that_is_stopped_ends_by_itself(monkeypatch):
    sent, send = [], os.killpg
    monkeypatch.setattr(os, "killpg", lambda group, number: (sent.append(number), send(group, number)))
    with closing(environment([{"agent": DRAWING}], {"*": "process"})) as env:
        env.reset()
        (link,) = host_of(env).links.values()
        supervisor = link.pid
        send(supervisor, signal.SIGSTOP)
    assert not Path(f"/proc/{supervisor}").exists()
    assert sent == [signal.SIGCONT]  # not killed, after `END_TIME`


def failures_after(number, whom):
    """Return what is said of an agent whose process gets a signal after three requests, and the step."""
    hosts = {DRAWING: {"where": "process", "patience": 2.0 if number == signal.SIGSTOP else 30.0}}
    with closing(environment([{"agent": DRAWING}], hosts)) as env:
        env.reset()
        [*steps(env, 3)]
        (link,) = host_of(env).links.values()
        (pid,) = workers_of(link) if whom == "worker" else [link.pid]
        os.kill(pid, number)
        if number != signal.SIGSTOP:
            wait_until_gone(pid)
        step = int(env.episode_steps[0])
        (result,) = steps(env, 1)
        if not result.social_failures:  # the request was sent before
            (result,) = steps(env, 1)
        (said,) = result.social_failures[0].values()
        return said, step


def wait_until_gone(pid):
    until = time.monotonic() + 10.0
    with suppress(OSError):
        while time.monotonic() < until and "Z" not in Path(f"/proc/{pid}/stat").read_text().split()[2]:
            time.sleep(0.01)


@pytest.mark.parametrize("whom", ["worker", "supervisor"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGSEGV])
def test_a_killed_agent_names_the_signal_and_the_step(number, whom):
    said, step = failures_after(number, whom)
    assert number.name in said
    assert re.search(r"at step (\d+)", said).group(1) in (str(step), str(step + 1))


def test_a_stopped_agent_names_the_seconds_and_the_step():
    said, _ = failures_after(signal.SIGSTOP, "worker")
    assert re.search(r"at step \d+: silent for 2(\.\d+)? s", said)


def test_an_agent_that_ends_itself_names_its_exit_code():
    social, hosts = hosted("leave", patience=60.0)
    _, failures = played(social, hosts, count=6)
    assert all("exit code 7" in said for said in failures[0].values())


def test_every_step_completes_whatever_is_killed():
    draws = np.random.default_rng(3)
    social = [{"agent": DRAWING, "count": 1}, {"agent": "random-v0", "count": 1}]
    with closing(environment(social, {"*": {"where": "process", "patience": 5.0}})) as env:
        env.reset()
        kills = wanted = made = 0
        while kills < 50:
            for link in host_of(env).links.values():
                if draws.random() < 0.7:
                    os.kill(draws.choice([link.pid, *workers_of(link)]), signal.SIGKILL)
                    kills += 1
            wanted += (count := int(draws.integers(1, 4)))
            made += len([*steps(env, count)])
            env.reset()
    assert made == wanted


def decided(log):
    """Return seeds and steps of the decisions in a log: those in time, and late ones."""
    taken, late = set(), set()
    for file in Path(log).glob("*.decisions"):
        _, *messages = messages_of(file)
        for message in messages:
            keys = zip(message.arrays["seed"].tolist(), message.arrays["step"].tolist(), strict=True)
            (late if message.values.get("late") else taken).update(keys)
    return taken, late


def test_late_answers_are_dropped_and_a_log_of_them_repeats_the_run_bit_by_bit(tmp_path):
    """The agent sleeps for 0.3 s at its third request, and nothing else is slow."""
    social = [{"agent": MISBEHAVING, "count": 1, "options": {"how": "sleep"}}, {"agent": DRAWING, "count": 1}]
    timing = {"where": "process", "deadline_ms": 60.0, "log": str(tmp_path)}
    with closing(environment(social, {MISBEHAVING: timing})) as env:
        env.reset()
        states, infos = [], []
        for result in steps(env, 60):
            assert not result.social_failures
            states.append(state(env))
            infos.append(result.social_infos.get(0, {}))
            time.sleep(0.01)
    taken, late = decided(tmp_path)
    assert {2, 3} <= {step for _, step in late}
    assert len(taken) > len(late)
    assert not taken & late
    counts = [0, *(info.get("late_decisions", {}).get(MISBEHAVING, 0) for info in infos)]
    assert sum(max(0, after - before) for before, after in pairwise(counts)) == len(late)
    again, failures = played(social, {MISBEHAVING: {"replay": str(tmp_path)}})
    assert again[1:] == states
    assert failures == {}


def test_late_decisions_of_policies_with_one_name_are_added_up():
    """Policies of one locator with different options; both are stopped, and one may have answered before."""
    social = [{"agent": MISBEHAVING, "options": {"how": how}} for how in ("sleep", "print_once")]
    hosts = {MISBEHAVING: {"where": "process", "deadline_ms": 50.0, "patience": 60.0}}
    with closing(environment(social, hosts)) as env:
        env.reset()
        for link in host_of(env).links.values():
            os.kill(workers_of(link)[0], signal.SIGSTOP)
        [*steps(env, 2)]
        counts = [result.social_infos[0]["late_decisions"][MISBEHAVING] for result in steps(env, 4)]
    assert [after - before for before, after in pairwise(counts)] == [2, 2, 2]


def test_a_replay_starts_no_agent(tmp_path, monkeypatch):
    """The agent's module cannot make it any more, neither here nor in a process."""
    social = [{"agent": DRAWING, "count": 2}]
    states, _ = played(social, {DRAWING: {"where": "process", "log": str(tmp_path)}}, count=20)
    monkeypatch.setattr("smarts.env.casting.make_spec", None)
    monkeypatch.setattr("subprocess.Popen", None)
    for hosts in ({DRAWING: {"replay": str(tmp_path)}}, {"*": {"replay": str(tmp_path)}}):
        assert played(social, hosts, count=20) == (states, {})


def test_a_replay_is_of_the_same_agent_and_options(tmp_path):
    social, hosts = hosted("raise_error", log=str(tmp_path))
    played(social, hosts, count=3)
    social[0]["options"] = {"how": "loop"}
    with pytest.raises(HostError) as raised:
        environment(social, {MISBEHAVING: {"replay": str(tmp_path)}})
    assert "loop" in raised.value.problem
    assert str(tmp_path) in raised.value.place


@pytest.fixture(scope="module")
def drawing_log(tmp_path_factory):
    """Return the bytes of a log's only file."""
    folder = tmp_path_factory.mktemp("log")
    played([{"agent": DRAWING}], {DRAWING: {"where": "process", "log": str(folder)}}, count=5)
    (file,) = folder.iterdir()
    return file.read_bytes()


@pytest.mark.parametrize("name", ["000.decisions", "zzz.decisions"])
@pytest.mark.parametrize("length", [0, 3, 10])
def test_a_file_that_ends_before_its_first_whole_message_is_left_out(tmp_path, drawing_log, name, length):
    (tmp_path / "good.decisions").write_bytes(drawing_log)
    (tmp_path / name).write_bytes(drawing_log[:length])
    for hosts in ({DRAWING: {"replay": str(tmp_path)}}, {"*": {"replay": str(tmp_path)}}):
        _, failures = played([{"agent": DRAWING}], hosts, count=5)
        assert not failures


def damaged(log):
    """Yield logs that no version has written, and one of an older version."""
    values = {"agent": DRAWING, "options": "{}", "about": {}}
    keys = {"seed": np.zeros(2, np.uint64), "step": np.zeros(2, np.int32)}
    yield bytes(100)
    yield b"no log at all, but a text"
    yield log + bytes(40)
    yield encode(Message("acted", {}, {**keys, "actions": np.zeros(2)}))
    yield encode(Message("about", {"agent": DRAWING}))
    yield encode(Message("about", {**values, "options": 3}))
    yield encode(Message("about", values))
    for wrong in ({"observation": ["no_such_feature"]}, {"period": "x"}, {"interface": {"action": None}}):
        whole = {"interface": {"action": "Lane"}, "observation": ["speed"], "period": 1, **wrong}
        yield encode(Message("about", {**values, "about": whole}))
    for arrays in (
        {},
        {"seed": keys["seed"], "actions": np.zeros(2)},
        keys,
        {**keys, "actions": np.zeros(3)},
        {**keys, "step": np.zeros(3, np.int32), "actions": np.zeros(2)},
        {"seed": np.uint64(1), "step": np.int32(1), "actions": np.zeros(())},
        {**keys, "seed": np.zeros(2), "actions": np.zeros(2)},
    ):
        yield log + encode(Message("acted", {}, {name: np.asarray(each) for name, each in arrays.items()}))
    yield log + log
    yield log + encode(Message("failed", {"problem": "x"}))


def test_damaged_logs_are_errors_that_name_the_file(tmp_path, drawing_log):
    for number, content in enumerate(damaged(drawing_log)):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "bad.decisions").write_bytes(content)
        for locator in (DRAWING, "*"):
            with pytest.raises(HostError) as raised:
                environment([{"agent": DRAWING}], {locator: {"replay": str(folder)}})
            assert "bad.decisions" in raised.value.place, content
            assert raised.value.remedy


def test_a_log_with_any_byte_changed_raises_no_other_error(tmp_path, drawing_log):
    draws, file = np.random.default_rng(5), tmp_path / "bad.decisions"
    for _ in range(500):
        content = bytearray(drawing_log)
        content[draws.integers(len(content))] = draws.integers(256)
        file.write_bytes(content[: draws.integers(len(content))] if draws.random() < 0.2 else content)
        with suppress(HostError):
            Replayed(tmp_path, DRAWING, "{}")


def test_a_folder_in_place_of_a_file_is_an_error(tmp_path):
    (tmp_path / "x.decisions").mkdir()
    with pytest.raises(HostError) as raised:
        environment([{"agent": DRAWING}], {DRAWING: {"replay": str(tmp_path)}})
    assert "x.decisions" in raised.value.place


def test_a_folder_that_cannot_be_made_is_an_error_before_the_first_step(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(HostError) as raised:
        environment([{"agent": DRAWING}], {DRAWING: {"where": "process", "log": str(tmp_path / "file")}})
    assert str(tmp_path / "file") in raised.value.place


@pytest.mark.parametrize("where", ["process", "in_process"])
def test_an_agent_that_is_not_in_the_log_acts_in_this_process_or_is_an_error(tmp_path, drawing_log, where):
    (tmp_path / "x.decisions").write_bytes(drawing_log)
    hosts = {"*": {"where": where, "replay": str(tmp_path)}}
    social = [{"agent": DRAWING}, {"agent": "random-v0"}]
    if where == "process":
        with pytest.raises(HostError) as raised:
            environment(social, hosts)
        assert str(tmp_path) in raised.value.place
    else:
        assert not played(social, hosts, count=5)[1]


def test_a_log_of_an_agent_with_other_options_is_an_error_under_others_too(tmp_path):
    social, hosts = hosted("raise_error", log=str(tmp_path))
    played(social, hosts, count=3)
    social[0]["options"] = {"how": "print_once"}
    with pytest.raises(HostError) as raised:
        environment(social, {"*": {"replay": str(tmp_path)}})
    assert "print_once" in raised.value.problem


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
            log.begin({"period": 1})
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


FORKED_BEFORE = """
import os, sys
from pathlib import Path
from tests.unit.env.test_hosts import DRAWING, decided, descendants, environment, messages_of, steps
folder = sys.argv[1]
env = environment([{"agent": DRAWING}], {DRAWING: {"where": "process", "log": folder}})
assert not [*Path(folder).iterdir()]
child = os.fork()
env.reset()
started = descendants()
[*steps(env, 3)]
assert child or descendants() == started
env.close()
if child:
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    files = [[each.kind for each in messages_of(file)] for file in Path(folder).iterdir()]
    assert files == 2 * [["about", "acted", "acted", "acted"]], files
else:
    os._exit(0)
"""


def test_an_environment_that_is_forked_before_its_first_reset_starts_its_agents_once(tmp_path):
    """Each process writes a log of its own, and an environment that is never reset writes none."""
    subprocess.run([sys.executable, "-c", FORKED_BEFORE, str(tmp_path)], check=True, timeout=60)
    social = [{"agent": DRAWING}]
    _, failures = played(social, {DRAWING: {"replay": str(tmp_path)}}, count=3)
    assert not failures


def test_an_answer_that_came_while_another_agent_was_ended_is_in_time(monkeypatch):
    """The first agent is stopped, and to end it takes longer than the second one's deadline."""
    monkeypatch.setattr("smarts.agents.hosting.links.END_TIME", 3.0)
    social = [{"agent": DRAWING}, {"agent": MISBEHAVING, "options": {"how": "sleep"}}]
    hosts = {
        DRAWING: {"where": "process", "patience": 0.1},
        MISBEHAVING: {"where": "process", "deadline_ms": 2000.0},
    }
    with closing(environment(social, hosts)) as env:
        env.reset()
        [*steps(env, 1)]
        link = host_of(env).links[0]
        assert wait_for([link.channel], time.monotonic() + 10.0)  # the second answer; the third does not come
        for pid in (*workers_of(link), link.pid):
            os.kill(pid, signal.SIGSTOP)
        infos, failures = [], {}
        for result in steps(env, 3):
            infos.append(result.social_infos.get(0, {}))
            failures |= result.social_failures.get(0, {})
    assert len(failures) == 1
    assert not any("late_decisions" in info for info in infos)


FULL = """
import resource, signal, sys
from tests.unit.env.test_hosts import DRAWING, descendants, environment, steps
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
social = [{"agent": DRAWING}, {"agent": "random-v0"}]
env = environment(social, {"*": {"where": "process", "log": sys.argv[1]}})
env.reset()
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))
[*steps(env, 10)]
resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
[*steps(env, 3)]
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY))
env.close()
assert not descendants()
"""


def test_a_full_disk_ends_the_log_and_neither_the_run_nor_its_end(tmp_path):
    """What is written later does not follow a message that was cut off."""
    subprocess.run([sys.executable, "-c", FULL, str(tmp_path)], check=True, timeout=60)
    files = [*tmp_path.iterdir()]
    assert len(files) == 2
    for file in files:
        kinds = [message.kind for message in messages_of(file)]
        assert kinds[0] == "about"
        assert 1 < len(kinds) < 11
        assert set(kinds[1:]) == {"acted"}


def test_all_agents_are_ended_though_one_cannot_be():
    social = [{"agent": DRAWING}, {"agent": "random-v0"}]
    env = environment(social, {"*": "process"})
    env.reset()
    first, second = host_of(env).links.values()
    process, other = first._process, second.pid
    os.close(process.stdin.fileno())  # so `close` of this link raises, and its agent ends by itself
    env.close()
    assert not Path(f"/proc/{other}").exists()
    process.wait(10)


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


def test_an_agent_at_an_address_is_started_once_and_replayed_when_it_is_gone(tmp_path, monkeypatch):
    from tests.unit.agents.test_addresses import AtAddress, kit_agent

    opened, open_link = [], AtAddress.open
    monkeypatch.setattr(AtAddress, "open", lambda self: opened.append(self) or open_link(self))
    with kit_agent(tmp_path) as address:
        social, log = [{"agent": address}], str(tmp_path / "log")
        states, failures = played(social, {address: {"log": log}}, count=20)
        assert len(opened) == 1
        with closing(environment(social, {})) as env:  # never reset: nothing is left, see the fixture
            assert not host_of(env).links
    assert not failures
    opened.clear()
    assert played(social, {address: {"replay": log}}, count=20) == (states, {})
    assert not opened
