"""Time of a learner's update on the CPU and on a GPU, by width of the networks.

    python -m perf.gpu_learner [--algorithms ppo dqn ...] [--widths 64 256 ...] [--seconds 4]

The environment of perf/joint.py: 4 agents, observations of 200 floats, 8 environments, fragments of 64 steps.
Two layers of each width; PPO learns from minibatches of 128 moments, the others from 8 of 512. Prints the
update of a fragment in ms of wall clock, by a learner with one thread, with half as many as there are cores,
and on the GPU, and how many times faster the GPU is than the better of the two. An update is the median of
RLlib's iterations less the median of sampling: RLlib's own bookkeeping is in it, which no GPU makes faster.
Iterations are measured for `--seconds` each, samplings for a quarter of it. Exit code 2: torch finds no GPU.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
import time
from collections.abc import Callable
from statistics import median
from typing import Any

import ray
import torch

import algorithms
from perf.joint import ENVS, FRAGMENT, NullVector

REPLAY = {"batch_size": 512, "learning_starts": 512, "updates_per_step": 8 / (ENVS * FRAGMENT)}


def typical_time(run: Callable[[], Any], seconds: float) -> float:
    """Return the median wall time of a call in seconds; the first two warm up."""
    run()
    run()
    times, start = [], time.perf_counter()
    while time.perf_counter() - start < seconds or len(times) < 3:
        before = time.perf_counter()
        run()
        times.append(time.perf_counter() - before)
    return median(times)


def update_time(name: str, width: int, seconds: float, *, gpus: int, threads: int) -> float:
    """Return the seconds of an iteration without its sampling: learner's update, RLlib's bookkeeping."""
    config = algorithms.config(name).environment(NullVector)
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=ENVS, rollout_fragment_length=FRAGMENT)
    batches = REPLAY if "batch_size" in config.setting_names else {"minibatch_size": 128}
    config.training(hidden=(width, width), torch_threads=threads, **batches)
    algo: Any = config.learners(num_gpus_per_learner=gpus).build_algo()
    try:
        sample = algo.env_runner_group.local_env_runner.sample
        return typical_time(algo.train, seconds) - typical_time(sample, seconds / 4)
    finally:
        algo.stop()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--algorithms", nargs="+", default=["ppo", "dqn", "qmix", "maddpg"])
    parser.add_argument("--widths", nargs="+", type=int, default=[64, 256, 1024])
    parser.add_argument("--seconds", type=float, default=4.0, help="of measuring iterations (default 4)")
    arguments = parser.parse_args()
    if not torch.cuda.is_available():
        print("torch finds no GPU on this machine", file=sys.stderr)
        sys.exit(2)
    logging.getLogger("ray").setLevel(logging.ERROR)
    torch.set_num_threads(1)
    ray.init(address="local", include_dashboard=False, logging_level=logging.ERROR)
    threads = max((os.cpu_count() or 1) // 2, 1)
    print(f"{torch.cuda.get_device_name()}, {os.cpu_count()} cores; update of a fragment [ms]")
    print(f"algorithm  width   one thread  {threads:2d} threads       GPU   ratio")
    for name in arguments.algorithms:
        for width in arguments.widths:
            one, several, gpu = (
                1e3 * update_time(name, width, arguments.seconds, gpus=gpus, threads=count)
                for gpus, count in ((0, 1), (0, threads), (1, 1))
            )
            ratio = min(one, several) / gpu
            print(f"{name:10s} {width:5d} {one:11.1f} {several:11.1f} {gpu:9.1f} {ratio:7.2f}", flush=True)
    ray.shutdown()


if __name__ == "__main__":
    main()
