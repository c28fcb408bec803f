"""Social agents in processes of their own: the same trajectories, and when hosts start."""

import os
import signal
import time
from contextlib import closing
from itertools import pairwise

import pytest

from smarts.agents.hosting.options import HostError, HostOptions
from tests.hosting import (
    DRAWING,
    MISBEHAVING,
    MIXED,
    environment,
    host_of,
    played,
    state,
    steps,
)
from tests.served_agents import served

pytestmark = pytest.mark.usefixtures("nothing_is_left")


def test_agents_in_processes_drive_as_in_this_one_bit_by_bit():
    here = played(MIXED, {}, num_envs=2, count=30)
    assert played(MIXED, {"*": "process"}, num_envs=2, count=30) == here
    assert played(MIXED, {DRAWING: HostOptions("process")}, num_envs=2, count=30) == here


def test_an_agent_at_an_address_drives_as_in_this_process_bit_by_bit():
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


def test_late_decisions_of_policies_with_one_name_are_added_up():
    """Policies of one locator with different options; both are stopped, and one may have answered before."""
    social = [{"agent": MISBEHAVING, "options": {"how": how}} for how in ("sleep", "nothing")]
    hosts = {MISBEHAVING: {"where": "process", "deadline_ms": 50.0, "patience": 60.0}}
    with closing(environment(social, hosts)) as env:
        env.reset()
        for link in host_of(env).links.values():
            os.kill(link.pid, signal.SIGSTOP)
        [*steps(env, 2)]
        counts = [result.social_infos[0]["late_decisions"][MISBEHAVING] for result in steps(env, 4)]
    assert [after - before for before, after in pairwise(counts)] == [2, 2, 2]


def test_late_answers_are_dropped_and_counted():
    """The agent sleeps for 0.3 s at its third request, and nothing else is slow."""
    social = [{"agent": MISBEHAVING, "options": {"how": "sleep"}}, {"agent": DRAWING}]
    with closing(environment(social, {MISBEHAVING: {"where": "process", "deadline_ms": 60.0}})) as env:
        env.reset()
        late = []
        for result in steps(env, 60):
            assert not result.social_failures
            late.append(result.social_infos.get(0, {}).get("late_decisions", {}).get(MISBEHAVING, 0))
            time.sleep(0.01)
    assert 2 <= max(late) < 60


def test_an_agent_of_this_process_is_never_late():
    with pytest.raises(HostError):
        environment([{"agent": DRAWING}], {DRAWING: {"deadline_ms": 10.0}})


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
            assert env._runner.actions.age[0, column] == steps_late
    # The draws depend on seed and step alone.
    assert records[delay][delay:] == records[0][:-delay]


def test_an_agent_of_objects_acts_in_this_process_alone():
    describing = "tests.hosted_agents:describing-v0"
    with pytest.raises(HostError):
        environment([{"agent": describing}], {describing: "process"})
    with closing(environment([{"agent": describing}], {"*": "process"})) as env:
        env.reset()
        assert not host_of(env).links


def test_hosts_start_with_the_first_episode_and_only_if_they_are_needed():
    with closing(environment([{"agent": DRAWING}], {"*": "process"})) as env:
        assert not host_of(env).links
        env.reset()
        assert len(host_of(env).links) == 1
    with closing(environment([], {"*": "process"})) as env:
        env.reset()
        assert env._runner._requests is None
