"""What a longer step of the traffic (`Options.traffic_step`) changes: outcomes, and time.

    python -m perf.traffic_step [--episodes 300] [--policies keep_lane gap_acceptance] [--step 0.5]
    python -m perf.traffic_step --run results/NAME/ppo/intersection/random_social_vehicles/seed_1

Plays the same episodes (starts, traffic, seeds) with and without the longer step, in turn in one process, and
prints for each scenario and policy the rates of collision and completion with standard errors (the unit is
the episode, of four agents), their difference in standard errors, the mean speed of the traffic, the ratio
of the processor times of a simulation step, resets in it, and the time of a reset. A trained policy plays its
own scenario and acts as in training (sampled). Exit code 1: a rate differs by more than two standard errors.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmark.scripted import SCRIPTED_POLICIES
from smarts.env.vector import VectorHiWayEnv, VectorStep
from smarts.errors import SmartsError, TrafficError
from smarts.sim.assembly import Options
from smarts.types.vehicles import Owner

SCENARIOS = ("two_way", "double_merge", "intersection")
POLICIES = ("keep_lane", "gap_acceptance")
TRAFFIC = "random_social_vehicles"
ENVS, AGENTS, PERIOD = 8, 4, 5
FIRST_EPISODE = 3_000_000
BLOCK = 20
"""Decisions that the two modes make in turn."""
MOST_APART = 2.0
"""Standard errors of the difference."""

Act = Callable[[VectorStep], Sequence[NDArray]]


class ScriptedAgents:
    """Acts by a scripted policy for all agents; its observations are those of the benchmark."""

    def __init__(self, policy: str, env: VectorHiWayEnv) -> None:
        self._env = env
        self._drivers = [[SCRIPTED_POLICIES[policy]() for _ in range(AGENTS)] for _ in range(ENVS)]

    def __call__(self, now: VectorStep) -> list[NDArray]:
        """Return the actions of all active agents."""
        (leaves,), (masks,) = now.observations, now.masks
        assert masks is not None
        actions = np.zeros((ENVS, AGENTS), np.int64)
        for row, drivers in enumerate(self._drivers):
            for agent, driver in enumerate(drivers):
                if now.reset[row]:
                    driver.begin(self._env.episodes[row], agent)
                if now.alive[row, agent]:
                    actions[row, agent] = driver.act(leaves[""][row, agent], masks[row, agent])
        return [actions]


@dataclass
class Mode:
    """One environment, and what its episodes come to."""

    env: VectorHiWayEnv
    act: Act
    quota: int
    """Episodes that count in each simulation: the first ones, so that long episodes count as often."""
    rates: dict[str, list[float]] = field(default_factory=lambda: {"collision": [], "goal": []})
    """Share of the agents of each episode with an outcome."""
    speeds: list[float] = field(default_factory=list)
    """Mean speed of the traffic at each decision [m/s]."""
    seconds: float = 0.0
    steps: int = 0
    reset_seconds: float = 0.0
    """Of one reset."""

    def begin(self) -> None:
        """Begin the first episodes, and time resets."""
        self._now = self.env.reset(42, FIRST_EPISODE + np.arange(ENVS), stride=ENVS)._replace(
            reset=np.ones(ENVS, np.bool_)
        )
        begin = time.process_time()
        for _ in range(3):
            self.env.recreate({row: TrafficError("timed") for row in range(ENVS)})
        self.reset_seconds = (time.process_time() - begin) / (3 * ENVS)
        self._left = np.full(ENVS, self.quota)
        worlds = FIRST_EPISODE + np.arange(ENVS)
        self._now = self.env.reset(42, worlds, stride=ENVS)._replace(reset=np.ones(ENVS, np.bool_))

    def decide(self) -> None:
        """Make one decision in all simulations."""
        actions = self.act(self._now)
        begin = time.process_time()
        self._now = now = self.env.step(actions)
        self.seconds += time.process_time() - begin
        self.steps += ENVS * PERIOD
        if now.failed:
            raise next(iter(now.failed.values()))
        for row, shares in now.metrics.items():
            # An invalid episode is replaced by the next of its simulation.
            if self._left[row] > 0 and not shares["invalid"]:
                self._left[row] -= 1
                for outcome, found in self.rates.items():
                    found.append(shares[outcome])
        vehicles = self.env._runner.world.vehicles
        driven = vehicles.alive & (vehicles.owner == Owner.TRAFFIC)
        if driven.any():
            self.speeds.append(float(vehicles.speed[driven].mean()))

    @property
    def is_over(self) -> bool:
        """Whether all episodes have been played."""
        return not self._left.any()


def rate(values: Sequence[float]) -> tuple[float, float]:
    """Return the mean and its standard error."""
    return float(np.mean(values)), float(np.std(values, ddof=1) / math.sqrt(len(values)))


def compare(
    label: str, episodes: int, makers: Sequence[Callable[[], VectorHiWayEnv]], acts: Callable[..., Act]
) -> bool:
    """Play the same episodes in two environments, print a line, and return whether the rates agree."""
    modes: list[Mode] = []
    try:
        for make in makers:
            env = make()
            modes.append(Mode(env, lambda now: [], math.ceil(episodes / ENVS)))
            modes[-1].act = acts(env)
            modes[-1].begin()
        while not all(mode.is_over for mode in modes):
            for mode in modes:
                for _ in range(0 if mode.is_over else BLOCK):
                    mode.decide()
    finally:
        for mode in modes:
            mode.env.close()
    exact, coarse = modes
    cells, agree = [label, f"{len(exact.rates['goal'])}"], True
    for outcome in exact.rates:
        (one, error), (other, its_error) = rate(exact.rates[outcome]), rate(coarse.rates[outcome])
        both = math.hypot(error, its_error)
        apart = (other - one) / both if both else 0.0
        agree &= abs(apart) <= MOST_APART
        cells += [f"{one:.3f} ({error:.3f})", f"{other:.3f} ({its_error:.3f})", f"{apart:+.1f}"]
    cells += [f"{np.mean(exact.speeds):.2f}", f"{np.mean(coarse.speeds):.2f}"]
    cells.append(f"{coarse.seconds / coarse.steps / (exact.seconds / exact.steps):.2f}")
    cells.append(f"{exact.reset_seconds * 1e3:.1f}, {coarse.reset_seconds * 1e3:.1f}")
    print("| " + " | ".join(cells) + " |", flush=True)
    return agree


HEADER = (
    *("policy, scenario", "episodes", "collision, exact (s.e.)", "longer step (s.e.)", "apart [s.e.]"),
    *("completion, exact (s.e.)", "longer step (s.e.)", "apart [s.e.]"),
    *("traffic's speed, exact [m/s]", "longer step [m/s]", "time of a step, ratio", "reset [ms]"),
)


def scripted(policy: str, scenario: str, episodes: int, steps: Sequence[float | None]) -> bool:
    """Compare a scripted policy's episodes."""

    def maker(step: float | None) -> Callable[[], VectorHiWayEnv]:
        options = Options(traffic_step=step)
        return lambda: VectorHiWayEnv(ENVS, [scenario], AGENTS, traffic=[TRAFFIC], simulation=options)

    makers = [maker(step) for step in steps]
    return compare(f"{policy}, {scenario}", episodes, makers, lambda env: ScriptedAgents(policy, env))


def trained(run: Path, episodes: int, steps: Sequence[float | None]) -> bool:
    """Compare a trained policy's episodes."""
    # Only trained policies wait for torch and Ray.
    from benchmark.results.run_folder import RunFolder
    from benchmark.running.environments import environment
    from benchmark.running.policy import load_policy
    from benchmark.running.trained_run import read_run

    setting = read_run(RunFolder(run)).task_setting

    def acts(env: VectorHiWayEnv) -> Act:
        policy: Any = load_policy(run, mode="sampled")
        return policy.act

    def maker(step: float | None) -> Callable[[], VectorHiWayEnv]:
        return lambda: environment(setting, num_envs=ENVS, traffic_step=step)

    label = f"{setting.task.name}, trained ({run.parents[2].name})"
    return compare(label, episodes, [maker(step) for step in steps], acts)


def main() -> None:
    """Compare what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--episodes", type=int, default=300)
    parser.add_argument("--policies", nargs="*", help=f"default: {' '.join(POLICIES)}; none with --run")
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS)
    parser.add_argument("--step", type=float, default=0.5, help="of the traffic [s] (default 0.5)")
    parser.add_argument("--run", type=Path, nargs="*", default=(), help="folders of trained runs")
    options = parser.parse_args()
    policies = (() if options.run else POLICIES) if options.policies is None else options.policies
    steps = None, options.step
    print("| " + " | ".join(HEADER) + " |", "|---" * len(HEADER) + "|", sep="\n")
    try:
        agree = [trained(run, options.episodes, steps) for run in options.run]
        agree += [
            scripted(policy, scenario, options.episodes, steps)
            for scenario in options.scenarios
            for policy in policies
        ]
    except SmartsError as error:
        sys.exit(f"perf.traffic_step: {error}")
    sys.exit(0 if all(agree) else 1)


if __name__ == "__main__":
    main()
