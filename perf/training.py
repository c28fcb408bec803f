"""Speed of training in exact traffic, with a longer step of SUMO and on Native, and where its time goes.

    python -m perf.training [--algorithms ppo maddpg] [--ways exact native] [--seconds 60]

Trains algorithms of version 1 at its intersection with traffic, with the settings of its table, in one
process: in each of `WAYS` in turn, iteration by iteration, until each has had its time. Prints agent-steps
(simulation steps of 0.1 s x agents on the road) and agents' decisions for each second of this process'
processor time, the share of sampling (simulation and policy) in it, and the ratio of agent-steps.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import ray

from benchmark.experiment.config import read_experiment
from benchmark.experiment.runs import Run, runs_of
from benchmark.running.training import algorithm_of

FILE = """extends: native_v1.yaml
tasks: [{scenario}]
algorithms: [{algorithm}]
seeds: [1]
environment: {{{environment}}}
"""
WAYS = {
    "exact": "training_traffic: null",
    "traffic_step 0.5": "training_traffic: null, traffic_step: 0.5",
    "native": "training_traffic: native",
}
"""Name -> what differs in `environment`; only Native's has no vehicles of Bullet."""


def run_of(algorithm: str, scenario: str, environment: str, overrides: Sequence[str]) -> Run:
    """Return the run of version 1's table, with another environment and changed values."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "speed.yaml")
        file.write_text(FILE.format(algorithm=algorithm, scenario=scenario, environment=environment))
        (run,) = runs_of(read_experiment(file, overrides))
    return run


class Timed:
    """An algorithm whose iterations are timed.

    Args:
        algo: The built algorithm.
        interval: Simulation steps of a decision.
    """

    def __init__(self, algo: Any, interval: int) -> None:
        self._algo, self.interval = algo, interval
        self._runner = algo.env_runner_group.local_env_runner
        self._sample, self._runner._sample_fragment = self._runner._sample_fragment, self._watched
        self.steps, self.seconds, self.sampling = 0, 0.0, 0.0

    def train(self) -> None:
        """Make one iteration."""
        begin = time.process_time()
        self._algo.train()
        self.seconds += time.process_time() - begin

    def forget(self) -> None:
        """Begin to count again: the first iteration compiles, loads and fills buffers."""
        self.steps, self.seconds, self.sampling = 0, 0.0, 0.0

    @property
    def rate(self) -> float:
        """Agent-steps per second."""
        return self.steps / self.seconds

    def _watched(self, *args: Any, **options: Any) -> Any:
        begin = time.process_time()
        rollout = self._sample(*args, **options)
        self.sampling += time.process_time() - begin
        self.steps += self.interval * rollout.agent_steps()
        return rollout


def measure(algorithm: str, options: argparse.Namespace) -> None:
    """Train in all ways in turn, and print a line for each."""
    ways: dict[str, Timed] = {}
    with ExitStack() as algorithms:
        for name in options.ways:
            run = run_of(algorithm, options.scenario, WAYS[name], options.set)
            algo = algorithms.enter_context(algorithm_of(run))
            ways[name] = Timed(algo, run.task_setting.environment.decision_interval)
            ways[name].train()
            ways[name].forget()
        while any(way.seconds < options.seconds for way in ways.values()):
            min(ways.values(), key=lambda way: way.seconds).train()
        base = next(iter(ways.values())).rate
        for name, way in ways.items():
            share = f"{100 * way.sampling / way.seconds:.0f}%"
            rates = f"{way.rate:,.0f}", f"{way.rate / way.interval:,.0f}"
            cells = algorithm, name, *rates, share, f"{way.rate / base:.2f}"
            print("| " + " | ".join(cells) + " |", flush=True)


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--algorithms", nargs="+", default=["ppo"])
    parser.add_argument("--scenario", default="intersection_v1")
    parser.add_argument(
        "--ways", nargs="+", default=[*WAYS], choices=WAYS, help="the first is 1 of the ratio"
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="of processor time for each (default 60)")
    parser.add_argument("--set", nargs="*", default=(), metavar="KEY=VALUE", help="of the experiment")
    options = parser.parse_args()
    logging.getLogger("ray").setLevel(logging.ERROR)
    ray.init(address="local", num_cpus=2, include_dashboard=False, logging_level=logging.ERROR)
    header = "algorithm", "traffic", "agent-steps per CPU second", "decisions", "sampling", "ratio"
    print("| " + " | ".join(header) + " |", "|---" * len(header) + "|", sep="\n")
    for algorithm in options.algorithms:
        measure(algorithm, options)
    ray.shutdown()


if __name__ == "__main__":
    main()
