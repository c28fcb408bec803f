"""Ray is joined or started, or one message says within seconds why not."""

import os
import signal
import socket
import time

import pytest
import ray

from benchmark.experiment.models import Resources
from benchmark.results.files import ResultsError
from benchmark.running import jobs
from benchmark.running.cluster import check_room, start_ray
from benchmark.running.jobs import JobScheduler
from tests.raising import raises


@pytest.fixture
def listener():
    # On all addresses of the machine: Ray takes 127.0.0.1 for the one by which others reach it.
    with socket.create_server(("", 0)) as server:
        yield server


def address_of(server):
    return f"127.0.0.1:{server.getsockname()[1]}"


def refusal(resources):
    began = time.monotonic()
    with pytest.raises(ResultsError) as caught:
        start_ray(resources)
    assert time.monotonic() - began < 60
    assert not ray.is_initialized()
    return str(caught.value)


def test_an_address_where_nobody_listens(listener, monkeypatch):
    address = address_of(listener)
    listener.close()
    said = refusal(Resources(address=address))
    assert said.startswith(f"resources.address: there is no Ray cluster at '{address}'")
    assert "Connection refused" in said
    assert "leave the address out" in said
    monkeypatch.setenv("RAY_ADDRESS", address)
    said = refusal(Resources(address="auto"))
    assert "no Ray cluster at 'auto'" in said


def test_an_address_beside_a_ray_that_runs(monkeypatch):
    monkeypatch.setattr(ray, "is_initialized", lambda: True)
    with raises(ResultsError, "resources.address", values=["'auto' has no effect"]):
        start_ray(Resources(address="auto"))


def test_a_ray_that_does_not_start(tmp_path, monkeypatch):
    file = tmp_path / "file"
    file.touch()
    monkeypatch.setenv("RAY_TMPDIR", str(file))
    said = refusal(Resources())
    assert said.startswith("Ray does not start: ")
    assert "the same command again" in said


def test_without_an_address_ray_is_its_own_whatever_else_there_is(listener, monkeypatch):
    monkeypatch.setenv("RAY_ADDRESS", address_of(listener))
    before = signal.getsignal(signal.SIGTERM)
    try:
        start_ray(Resources())
        own = ray.get_runtime_context().gcs_address
        assert own.rpartition(":")[2] != address_of(listener).rpartition(":")[2]
        assert signal.getsignal(signal.SIGTERM) == before
        started = ray._private.worker._global_node.all_processes
        assert {"raylet", "gcs_server"} <= {*started}
        groups = {os.getpgid(each.process.pid) for processes in started.values() for each in processes}
        assert os.getpgrp() not in groups
    finally:
        ray.shutdown()


@pytest.mark.parametrize(
    ("needed", "named"),
    [
        ({"env_runners": 5}, []),
        ({"env_runners": 6}, [7, 6]),
        ({"learner_gpus": 3}, [1, 3, 0]),
        ({"learners": 3, "learner_gpus": 0.6}, []),
        ({"learners": 4, "learner_gpus": 0.6}, [4, 0.6, 3]),  # one on each
    ],
)
def test_a_run_that_could_never_be_placed_is_refused(needed, named):
    resources, nodes = Resources(**needed), [{"CPU": 2.0, "GPU": 2.0}, {"CPU": 4.0, "GPU": 1.0}]
    if not named:
        check_room(resources, nodes)
        return
    place = "learner_gpus" if "learner_gpus" in needed else "env_runners"
    with raises(ResultsError, f"resources.{place}", values=named):
        check_room(resources, nodes)
    with pytest.raises(ResultsError):
        check_room(resources, [])


@pytest.mark.parametrize(
    ("needed", "most"),
    [
        ({}, 16),
        ({"learner_gpus": 0.6}, 2),  # one on each
        ({"learners": 2, "learner_gpus": 0.6}, 1),
        ({"learner_gpus": 1, "parallel": 5}, 5),
    ],
)
def test_as_many_runs_begin_as_there_is_room_for(tmp_path, monkeypatch, needed, most):
    monkeypatch.setattr(ray, "cluster_resources", lambda: {"CPU": 16.0, "GPU": 2.0})
    monkeypatch.setattr(jobs, "living_nodes", lambda: [{"CPU": 16.0, "GPU": 2.0}])
    assert JobScheduler([], tmp_path, Resources(**needed)).most_at_once() == most
