"""Social agents in Ray actors."""

from contextlib import closing

import pytest
import ray

from smarts.agents.hosting.options import HostError
from tests.hosting import DRAWING, MISBEHAVING, MIXED, environment, host_of, played, steps


@pytest.fixture(scope="module")
def cluster():
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


def test_without_ray_an_actor_is_an_error():
    assert not ray.is_initialized()
    with closing(environment([{"agent": DRAWING}], {"*": "ray"})) as env, pytest.raises(HostError):
        env.reset()


def test_agents_in_actors_drive_as_in_this_process_bit_by_bit(cluster):
    here = played(MIXED, {}, count=20)
    assert played(MIXED, {DRAWING: "ray", "*": "process"}, count=20) == here


def test_an_actor_that_is_killed_or_silent_is_made_again(cluster):
    with closing(environment([{"agent": DRAWING}], {"*": "ray"})) as env:
        env.reset()
        [*steps(env, 3)]
        ray.kill(host_of(env).links[0]._actor)
        assert any(result.social_failures for result in steps(env, 30))
        env.reset()
        assert not any(result.social_failures for result in steps(env, 3))
    social = [{"agent": MISBEHAVING, "options": {"how": "loop"}}]
    _, failures = played(social, {"*": {"where": "ray", "patience": 1.0}}, count=6)
    assert len(failures[0]) == 1
