"""Ray: a cluster that is joined, or one of this experiment's own on this machine."""

from __future__ import annotations

import logging
import os
import signal
import socket
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import ray
from ray._private import worker
from ray._private.services import canonicalize_bootstrap_address
from ray.experimental.internal_kv import _internal_kv_del, _internal_kv_exists, _internal_kv_put

from benchmark.experiment.models import Resources
from benchmark.results.files import ResultsError, first_line
from benchmark.running.signals import handled

OWN = "local"
"""Ray's address that starts a local cluster; without one it joins any cluster of this machine."""
CONNECT_TIMEOUT = 20.0
"""Time for a cluster to answer [s]."""
PLACE = "resources.address"
REMEDY = "start a cluster with `ray start --head`, or leave the address out"


def start_ray(resources: Resources, runtime_env: Mapping[str, Any] | None = None) -> None:
    """Join the cluster, or start Ray on this machine.

    Args:
        resources: Resources of an experiment.
        runtime_env: What Ray brings to the machines of the cluster; see `shipped_code`.

    Raises:
        ResultsError: There is no cluster at the address, Ray does not start, or there is too little; or an
            address is given in a process in which Ray runs already.
    """
    if resources.address is not None and ray.is_initialized():
        raise ResultsError(
            f"{resources.address!r} has no effect: Ray runs in this process already",
            place=PLACE,
            remedy="leave the address out, or let Ray be started by it: no ray.init before",
        )
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    address = OWN if resources.address is None else _address_of(resources.address)
    try:
        # This process's own way to take SIGTERM, which Ray replaces by an exit, comes back.
        with handled(signal.getsignal(signal.SIGTERM), signal.SIGTERM), _own_groups():
            ray.init(
                address=address,
                include_dashboard=False if address == OWN else None,
                log_to_driver=False,
                logging_level=logging.ERROR,
                ignore_reinit_error=True,
                runtime_env=None if runtime_env is None else dict(runtime_env),
            )
    except Exception as error:  # Ray raises errors of many types, plain `Exception` too
        raise ResultsError(
            f"Ray does not start: {first_line(error)}",
            place=PLACE if address != OWN else "",
            remedy=REMEDY
            if address != OWN
            else "give the same command again when the machine is less busy and has memory and disk to spare",
        ) from error
    check_room(resources, living_nodes())


def living_nodes() -> list[Mapping[str, float]]:
    """Return Ray's resources of each of its machines."""
    return [node["Resources"] for node in ray.nodes() if node["Alive"]]


def check_ray() -> None:
    """Raise if this machine's own processes of Ray have ended, which else ends this one after a minute.

    Raises:
        ResultsError: One has, killed by a user or for want of memory.
    """
    node: Any = worker._global_node
    dead = {name for name, _ in node.dead_processes()} if node is not None else set()
    if lost := sorted(dead & {"gcs_server", "raylet"}):
        raise ResultsError(
            f"Ray's own process {lost[0]} is lost, killed by a user or for want of memory",
            remedy="give the same command again: it continues from the last checkpoints",
        )


@contextmanager
def stopping() -> Iterator[None]:
    """Let `is_stopping` be true meanwhile, in all processes of this one's tasks."""
    _internal_kv_put(_stop_key(), b"")
    try:
        yield
    finally:
        _internal_kv_del(_stop_key())


def is_stopping() -> bool:
    """Return whether the runs of the driver should save and end."""
    return _internal_kv_exists(_stop_key())


def _stop_key() -> str:
    return f"smarts-bench-stop-{ray.get_runtime_context().get_job_id()}"


def check_room(resources: Resources, nodes: Sequence[Mapping[str, float]]) -> None:
    """Raise if the cluster lacks the resources of one run; Ray would wait forever without a message.

    Args:
        resources: What a run needs.
        nodes: Ray's resources of each machine.

    Raises:
        ResultsError: There is less.
    """
    cpus, needed = int(sum(node.get("CPU", 0) for node in nodes)), resources.processes
    share, learners, place = resources.learner_gpus, max(resources.learners, 1), "learner_gpus"
    most = learners_on(nodes, share) if share else learners
    problem = f"{learners} learners need {share:g} GPUs each, on one machine each; Ray has room for {most}"
    if needed > cpus:
        place = max(("env_runners", "learners"), key=lambda name: getattr(resources, name))
        problem = f"a run needs {needed} CPUs, one for itself, each env runner and learner; Ray has {cpus}"
    if needed > cpus or learners > most:
        remedy = "ask for fewer env_runners, learners or learner_gpus"
        raise ResultsError(problem, place=f"resources.{place}", remedy=remedy)


def learners_on(nodes: Sequence[Mapping[str, float]], share: float) -> int:
    """Return how many learners have room on the GPUs of machines.

    Args:
        nodes: Ray's resources of each machine.
        share: GPUs of each learner. One with a part of a GPU lies on one.
    """
    # Ray counts in parts of 10,000.
    of_one = max(1, round(1e4 * share))
    gpus = [round(1e4 * node.get("GPU", 0)) for node in nodes]
    if share >= 1:
        return sum(each // of_one for each in gpus)
    return sum(each // 10_000 * (10_000 // of_one) for each in gpus)


def _address_of(given: str) -> str:
    """Return the address of a cluster whose port is open; Ray itself would wait for minutes.

    Raises:
        ResultsError: No such cluster answers.
    """
    try:
        # Not public, but what `ray.init` does with "auto", which may be of a cluster that is gone.
        address = canonicalize_bootstrap_address(given) or given
        host, _, port = address.rpartition(":")
        socket.create_connection((host.strip("[]"), int(port)), CONNECT_TIMEOUT).close()
    except (OSError, ValueError) as error:
        raise ResultsError(
            f"there is no Ray cluster at {given!r}: {first_line(error)}", place=PLACE, remedy=REMEDY
        ) from error
    return address


_starting = threading.local()
"""Has `ray` while this thread starts Ray's processes."""


@contextmanager
def _own_groups() -> Iterator[None]:
    """Start Ray's processes in process groups of their own.

    A signal to the group of a command, such as that of a batch system, reaches the command alone, which then
    saves its runs and ends Ray.
    """
    _starting.ray = True
    try:
        yield
    finally:
        _starting.ray = False


def _take_own_group() -> None:
    if getattr(_starting, "ray", False):
        os.setpgid(0, 0)


os.register_at_fork(after_in_child=_take_own_group)
