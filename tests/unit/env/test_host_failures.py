"""Failures of social agents in processes of their own, which stay theirs."""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import closing

import numpy as np
import pytest

from tests.hosting import DRAWING, environment, host_of, hosted, played, steps
from tests.leftovers import is_running

pytestmark = pytest.mark.usefixtures("nothing_is_left")


@pytest.mark.parametrize(
    "how",
    ["loop", "fill_the_memory", "answer_texts", "answer_too_few", "answer_too_much"],
)
def test_an_agent_that_misbehaves_fails_alone(how):
    social, hosts = hosted(how, memory=1.0, patience=2.0 if how == "loop" else 60.0)
    _, failures = played(social, hosts, count=6)
    (named,) = failures.values()
    assert len(named) == 2


def test_a_host_that_is_stopped_is_ended_and_started_again():
    social, hosts = [{"agent": DRAWING, "count": 2}], {DRAWING: {"where": "process", "patience": 0.5}}
    with closing(environment(social, hosts)) as env:
        env.reset()
        [*steps(env, 3)]
        (link,) = host_of(env).links.values()
        os.kill(link.pid, signal.SIGSTOP)
        failures = {}
        for result in steps(env, 2):
            failures |= result.social_failures.get(0, {})
        assert len(failures) == 2
        assert all(re.search(r"at step \d+: silent for 0\.5\d* s", said) for said in failures.values())
        env.reset()
        assert not any(result.social_failures for result in steps(env, 5))
        (again,) = host_of(env).links.values()
        assert again is not link


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV])
def test_a_killed_agent_names_the_signal_and_the_step(number):
    hosts = {DRAWING: {"where": "process", "patience": 30.0}}
    with closing(environment([{"agent": DRAWING}], hosts)) as env:
        env.reset()
        [*steps(env, 3)]
        (link,) = host_of(env).links.values()
        os.kill(link.pid, number)
        (result,) = steps(env, 1)
        if not result.social_failures:  # the request was sent before
            (result,) = steps(env, 1)
        (said,) = result.social_failures[0].values()
    assert number.name in said
    assert re.search(r"at step (\d+)", said).group(1) in ("3", "4")


def test_every_step_completes_whatever_is_killed():
    draws = np.random.default_rng(3)
    social = [{"agent": DRAWING, "count": 1}, {"agent": "random-v0", "count": 1}]
    with closing(environment(social, {"*": {"where": "process", "patience": 5.0}})) as env:
        env.reset()
        kills = wanted = made = 0
        while kills < 12:
            for link in host_of(env).links.values():
                if draws.random() < 0.7:
                    os.kill(link.pid, signal.SIGKILL)
                    kills += 1
            wanted += (count := int(draws.integers(1, 4)))
            made += len([*steps(env, count)])
            env.reset()
    assert made == wanted


KILLED = """
import sys, time
from tests.hosting import environment, hosted, steps
from tests.leftovers import descendants
env = environment(*hosted("fork"))
env.reset()
[*steps(env, 8)]
print(*descendants(), flush=True)
time.sleep(1000)
"""


def test_a_simulator_that_is_killed_leaves_no_process_and_no_file():
    """The agent has started processes."""
    command = [sys.executable, "-c", KILLED]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as simulator:
        assert simulator.stdout is not None
        started = [int(pid) for pid in simulator.stdout.readline().split()]
        simulator.kill()
    assert len(started) == 3, "an agent, and two processes that it has started"
    until = time.monotonic() + 20.0
    while any(map(is_running, started)) and time.monotonic() < until:
        time.sleep(0.05)
    assert not any(map(is_running, started))
