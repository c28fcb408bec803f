"""Measure what it costs that agents act elsewhere: a round trip, and the steps of a simulation.

    python -m perf.hosts --rounds 2000 --ray

A round trip is `dispatch` and `gather` for 8 agents with observations of 2 kB each, which answer at once. The
kinds of hosts take turns, so that they share the machine's moods. Printed: the median, and what the fastest
tenth stays below. The processes need cores of their own: with fewer cores than processes, or on a busy
machine, the numbers are those of the scheduler.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing

import numpy as np

from smarts.agents.acting import Request
from smarts.agents.hosting.hosts import Hosts
from smarts.agents.hosting.options import HostOptions, Starter
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.agents.social import SocialPolicy
from smarts.env.vector import VectorHiWayEnv
from smarts.zoo import make_spec, register
from smarts.zoo.driving import DRIVER
from smarts.zoo.serving import starter

AGENTS, NUMBERS = 8, 250
"""Agents, and 64-bit numbers that each observes: 2 kB."""
TARGETS = {"one process": 100e-6, "eight processes": 600e-6, "one Ray actor": 1500e-6}
"""Targets of a round trip's time [s]."""
SHARE = 0.85
"""Least rate of steps with one process, as a share of the rate in process."""
LOCATOR = "perf.hosts:still-v0"


class Still(BatchAgent):
    """Answers at once."""

    interface = DRIVER

    def act(self, obs: ActionBatch) -> np.ndarray:
        """Return zeros."""
        return np.zeros((len(obs.env_id), 2))


register("still-v0", Still)


def request(agents: int) -> Request:
    """Return a request of some agents."""
    ids = np.arange(agents, dtype=np.int32)
    return Request(
        ActionBatch(
            observations={"observation": np.random.default_rng(1).random((agents, NUMBERS))},
            action_mask=np.ones((agents, 4), np.bool_),
            env_id=np.zeros(agents, np.int32),
            agent_id=ids,
            hold=ids.astype(np.int64),
            episode=np.zeros(agents, np.int32),
            step=np.zeros(agents, np.int32),
            is_first=np.zeros(agents, np.bool_),
            seed=ids.astype(np.uint64),
            drives=np.ones(agents, np.bool_),
        )
    )


def host(policies: int, start: Starter | None) -> Hosts:
    """Return a host of some equal policies."""
    spec = make_spec(LOCATOR)
    hosts = Hosts(
        [
            SocialPolicy("still", LOCATOR, spec, 0, observation="benchmark", start=start)
            for _ in range(policies)
        ]
    )
    hosts.begin()
    return hosts


def round_trips(rounds: int, with_ray: bool) -> dict[str, tuple[float, float]]:
    """Return median and first decile of the time of a round trip [s], by the kind of host."""
    child = starter(LOCATOR, {}, HostOptions("process"))
    with ExitStack() as stack:
        kinds = {
            "in process": (host(1, None), 1),
            "one process": (host(1, child), 1),
            "eight processes": (host(AGENTS, child), AGENTS),
        }
        if with_ray:
            kinds["one Ray actor"] = (host(1, starter(LOCATOR, {}, HostOptions("ray"))), 1)
        for each, _ in kinds.values():
            stack.enter_context(closing(each))
        times: dict[str, list[float]] = {name: [] for name in kinds}
        asked = {name: request(AGENTS // policies) for name, (_, policies) in kinds.items()}
        for _ in range(rounds // 20):
            for name, (each, policies) in kinds.items():
                requests = dict.fromkeys(range(policies), asked[name])
                for _ in range(20):
                    begun = time.perf_counter()
                    each.dispatch(requests)
                    answers = each.gather()
                    times[name].append(time.perf_counter() - begun)
                    assert len(answers) == policies
                    assert all(isinstance(answer.actions, np.ndarray) for answer in answers)
        return {
            name: (statistics.median(each), float(np.quantile(each, 0.1))) for name, each in times.items()
        }


def share_of_steps(steps: int) -> float:
    """Return the steps per second with social agents in one process, as a share of those in process."""
    social = [{"agent": "idm-v0", "count": "missions"}]
    envs: list[VectorHiWayEnv] = [
        VectorHiWayEnv(1, ["city"], 1, social_agents=social, hosts=hosts, decision_interval=1)
        for hosts in ({}, {"*": "process"})
    ]
    times: Sequence[list[float]] = ([], [])
    try:
        for env in envs:
            env.reset()
            _step(env, steps // 10)
        for _ in range(10):
            for env, spent in zip(envs, times, strict=True):
                begun = time.perf_counter()
                _step(env, steps // 10)
                spent.append(time.perf_counter() - begun)
    finally:
        for env in envs:
            env.close()
    here, there = map(statistics.median, times)
    return here / there


def _step(env: VectorHiWayEnv, steps: int) -> None:
    for _ in range(steps):
        env.step([np.zeros((1, 1), int)])


def main(echo: Callable[[str], object] = print) -> None:
    """Print the times beside their targets."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--rounds", type=int, default=2000)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--ray", action="store_true", help="measure a Ray actor too")
    given = parser.parse_args()
    if given.ray:
        import ray

        ray.init(address="local", include_dashboard=False, log_to_driver=False)
    echo(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    echo("| | target | median | fastest tenth |\n|---|---|---|---|")
    for name, times in round_trips(given.rounds, given.ray).items():
        target, *measured = (f"{1e6 * each:.0f} us" for each in (TARGETS.get(name, 0.0), *times))
        echo(f"| {name} | {target if name in TARGETS else ''} | {' | '.join(measured)} |")
    echo(f"| steps, as a share of those in process | {SHARE} | {share_of_steps(given.steps):.2f} | |")


if __name__ == "__main__":
    main()
