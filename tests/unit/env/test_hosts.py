"""Social agents in processes of their own: the same trajectories, and failures that stay theirs."""

import os
import signal
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from smarts.agents.hosting.options import HostError, HostOptions
from smarts.agents.options import InterfaceError
from smarts.env.vector import VectorHiWayEnv

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
    folder = Path(os.environ.get("TMPDIR", "/tmp"))
    return descendants(), {each.name for each in folder.glob("smarts-agent-*")}, sockets


@pytest.fixture(autouse=True)
def nothing_is_left():
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
    return social, {MISBEHAVING: {"where": "process", "patience": 1.0, **host}}


@pytest.mark.parametrize(
    "how",
    [
        *("loop", "leave", "raise_error", "fill_the_disk", "fill_the_memory"),
        *("answer_texts", "answer_too_few", "answer_too_much", "answer_objects"),
    ],
)
def test_an_agent_that_misbehaves_fails_alone(how):
    social, hosts = hosted(how, memory=1.0)
    _, failures = played(social, hosts, count=12)
    (named,) = failures.values()
    assert len(named) == 2


@pytest.mark.parametrize("how", ["fork", "print_much", "read_input"])
def test_an_agent_may_do_what_changes_nothing(how, capfd):
    social, hosts = hosted(how)
    _, failures = played(social, hosts, count=8)
    assert failures == {}
    assert "x" * 100 not in capfd.readouterr().out


def test_what_an_agent_raises_is_said_in_the_same_words_everywhere():
    social, hosts = hosted("raise_error")
    assert played(social, hosts, count=6) == played(social, {}, count=6)


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


def test_an_answer_after_the_deadline_is_dropped_and_the_next_one_counts():
    social, hosts = hosted("sleep", deadline_ms=100.0)
    with closing(environment(social, hosts)) as env:
        env.reset()
        given = env._runner.actions.fresh
        column = env._runner._pool.columns(0).start
        fresh = []
        for result in steps(env, 30):
            assert not result.social_failures
            fresh.append(bool(given[0, column]))
            time.sleep(0.02)
    assert fresh is not None


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
