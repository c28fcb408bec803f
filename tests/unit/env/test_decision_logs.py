"""Logs of what social agents have decided, and replays of them."""

import subprocess
import sys
import time
from contextlib import closing
from itertools import pairwise

import numpy as np
import pytest

from smarts.agents.acting import Failed, Request
from smarts.agents.hosting.links import AtAddress
from smarts.agents.hosting.log import DecisionLog, Replayed, messages_of
from smarts.agents.hosting.options import HostError
from smarts.agents.policy import ActionBatch
from tests.hosting import DRAWING, MISBEHAVING, decided, environment, host_of, hosted, played, state, steps
from tests.served_agents import kit_agent

pytestmark = pytest.mark.usefixtures("nothing_is_left")


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
    assert taken
    assert not taken & late
    counts = [0, *(info.get("late_decisions", {}).get(MISBEHAVING, 0) for info in infos)]
    assert sum(max(0, after - before) for before, after in pairwise(counts)) == len(late)
    again, failures = played(social, {MISBEHAVING: {"replay": str(tmp_path)}})
    assert again[1:] == states
    assert failures == {}


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
    for locator in (MISBEHAVING, "*"):
        with pytest.raises(HostError) as raised:
            environment(social, {locator: {"replay": str(tmp_path)}})
        assert "loop" in raised.value.problem
        assert str(tmp_path) in raised.value.place


@pytest.fixture(scope="module")
def drawing_log(tmp_path_factory):
    """Return the bytes of a log's only file."""
    folder = tmp_path_factory.mktemp("log")
    played([{"agent": DRAWING}], {DRAWING: {"where": "process", "log": str(folder)}}, count=5)
    (file,) = folder.iterdir()
    return file.read_bytes()


@pytest.mark.parametrize("length", [0, 10])
def test_a_file_that_ends_before_its_first_whole_message_is_left_out(tmp_path, drawing_log, length):
    (tmp_path / "good.decisions").write_bytes(drawing_log)
    (tmp_path / "000.decisions").write_bytes(drawing_log[:length])
    _, failures = played([{"agent": DRAWING}], {DRAWING: {"replay": str(tmp_path)}}, count=5)
    assert not failures


def test_what_is_no_log_is_an_error_that_names_the_file(tmp_path, drawing_log):
    for number, content in enumerate((b"no log at all, but a text", drawing_log + bytes(40))):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "bad.decisions").write_bytes(content)
        with pytest.raises(HostError) as raised:
            environment([{"agent": DRAWING}], {DRAWING: {"replay": str(folder)}})
        assert "bad.decisions" in raised.value.place
        assert raised.value.remedy


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


def test_a_replay_without_a_log_is_an_error(tmp_path):
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


@pytest.mark.parametrize("other", [np.array([2]), [Failed("raised ValueError")], None])
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


FORKED_BEFORE = """
import os, sys
from pathlib import Path
from smarts.agents.hosting.log import messages_of
from tests.hosting import DRAWING, environment, steps
from tests.leftovers import descendants
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


FULL = """
import resource, signal, sys
from tests.hosting import DRAWING, environment, steps
from tests.leftovers import descendants
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


def test_an_agent_at_an_address_is_started_once_and_replayed_when_it_is_gone(tmp_path, monkeypatch):
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
