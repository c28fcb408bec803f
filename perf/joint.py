"""Speed of the joint runner and learner beside RLlib's stock ones, on an environment that computes nothing.

    python perf/joint.py [--seconds 5] [--epochs 1]

4 agents, observations of 200 floats, 5 actions, 8 environments, networks [64, 64], fragments of 64 steps.
Prints agents' decisions per second of this process' processor time, of sampling and of whole iterations
(independent PPO), the ratios to RLlib's PPO measured in the same run, and the time of an iteration without
its sampling, in us for each decision and epoch.
"""

from __future__ import annotations

import argparse
import logging
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import ray
import torch
from gymnasium.spaces import Box, Discrete
from ray.rllib.algorithms.ppo import PPOConfig as StockPPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.env.multi_agent_env import MultiAgentEnv

import algorithms
from algorithms.joint.env import AgentBlock, FinalStep, JointSpaces, JointStep

AGENTS, WIDTH, ACTIONS, ENVS, LENGTH, FRAGMENT = 4, 200, 5, 8, 100, 64
NAMES = tuple(f"agent_{i}" for i in range(AGENTS))


class NullEnv(MultiAgentEnv):
    """Returns the same dicts in every step."""

    def __init__(self, config=None):
        super().__init__()
        self.possible_agents = self.agents = list(NAMES)
        self.observation_spaces = {a: Box(-np.inf, np.inf, (WIDTH,), np.float32) for a in NAMES}
        self.action_spaces = {a: Discrete(ACTIONS) for a in NAMES}
        rng = np.random.default_rng(0)
        self.seen: dict[Any, Any] = {a: rng.standard_normal(WIDTH, np.float32) for a in NAMES}
        self.t = 0

    def reset(self, *, seed=None, options=None):
        """Begin an episode."""
        self.t = 0
        return self.seen, {}

    def step(self, action_dict):
        """Count."""
        self.t += 1
        rewards: dict[Any, Any] = dict.fromkeys(NAMES, 1.0)
        ends: dict[Any, Any] = {"__all__": False}
        cuts: dict[Any, Any] = {"__all__": self.t >= LENGTH}
        return self.seen, rewards, ends, cuts, {}


class NullVector:
    """The same as arrays."""

    def __init__(self, config=None):
        self.num_envs = ENVS
        self.spaces = JointSpaces(
            (AgentBlock(NAMES, {"": Box(-np.inf, np.inf, (WIDTH,), np.float32)}, Discrete(ACTIONS)),)
        )
        self.seen = ({"": np.random.default_rng(0).standard_normal((ENVS, AGENTS, WIDTH), np.float32)},)
        self.ones, self.no = np.ones((ENVS, AGENTS), np.float32), np.zeros((ENVS, AGENTS), bool)
        self.final = FinalStep(np.arange(ENVS), self.seen)
        self.t = 0

    def reset(self, seed, worlds, *, stride=0):
        """Begin episodes."""
        self.t = 0
        return JointStep(self.seen, self.ones, self.no, self.no, ~self.no, self.no[:, 0])

    def step(self, actions):
        """Count."""
        self.t += 1
        over = self.t % LENGTH == 0
        cut = ~self.no if over else self.no
        return JointStep(
            self.seen, self.ones, self.no, cut, ~self.no, cut[:, 0], self.final if over else None
        )

    def recreate(self, failures):
        """Do nothing: no simulation fails."""
        raise NotImplementedError

    def close(self):
        """Do nothing."""


def rate(run: Callable[[], int], seconds: float) -> float:
    """Return units per second of processor time of calls that return units done; the first call warms up."""
    run()
    done, start = 0, time.process_time()
    while time.process_time() - start < seconds:
        done += run()
    return done / (time.process_time() - start)


def joint(env, sharing: str, epochs: int, seconds: float) -> tuple[float, float]:
    """Return (sampling, training) decisions/s of the joint core."""
    config = algorithms.config("ppo").environment(env)
    config.env_runners(num_env_runners=0, num_envs_per_env_runner=ENVS, rollout_fragment_length=FRAGMENT)
    algo: Any = config.training(sharing=sharing, epochs=epochs, minibatch_size=128).build_algo()
    runner = algo.env_runner_group.local_env_runner
    sampling = rate(lambda: runner.sample()[0].agent_steps(), seconds)

    def iteration() -> int:
        algo.train()
        return FRAGMENT * ENVS * AGENTS

    training = rate(iteration, seconds)
    algo.stop()
    return sampling, training


def stock(sharing: str, epochs: int, seconds: float) -> tuple[float, float]:
    """Return (sampling, training) decisions/s of RLlib's PPO with the same networks and batches."""
    modules = {"shared"} if sharing == "all" else set(NAMES)
    model = DefaultModelConfig(fcnet_hiddens=[64, 64], vf_share_layers=False)
    config = (
        StockPPOConfig()
        .environment(NullEnv)
        .env_runners(num_env_runners=0, num_envs_per_env_runner=ENVS, rollout_fragment_length=FRAGMENT)
        .multi_agent(policies=modules, policy_mapping_fn=_shared if sharing == "all" else _own)
        .rl_module(
            rl_module_spec=MultiRLModuleSpec(
                rl_module_specs={m: RLModuleSpec(model_config=model) for m in modules}
            )
        )
        .training(
            train_batch_size_per_learner=FRAGMENT * ENVS, num_epochs=epochs, minibatch_size=128 * AGENTS
        )
    )
    algo: Any = config.build_algo()
    runner = algo.env_runner_group.local_env_runner

    def sample() -> int:
        return sum(e.agent_steps() for e in runner.sample(num_timesteps=FRAGMENT * ENVS))

    def iteration() -> int:
        algo.train()
        return FRAGMENT * ENVS * AGENTS

    sampling, training = rate(sample, seconds), rate(iteration, seconds)
    algo.stop()
    return sampling, training


def _shared(agent_id, episode, **kwargs):
    return "shared"


def _own(agent_id, episode, **kwargs):
    return agent_id


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--epochs", type=int, default=1)
    arguments = parser.parse_args()
    logging.getLogger("ray").setLevel(logging.ERROR)
    # One thread for both sides: with more, either is slowed tenfold by whatever else runs on the machine.
    torch.set_num_threads(1)
    ray.init(address="local", num_cpus=2, include_dashboard=False, logging_level=logging.ERROR)
    print(f"decisions/CPU s, {arguments.epochs} epoch(s)    sampling   ratio   training   ratio  update [us]")
    for sharing in ("all", "none"):
        base = stock(sharing, arguments.epochs, arguments.seconds)
        rows = {
            "RLlib PPO, dicts": base,
            "joint, dicts": joint(NullEnv, sharing, arguments.epochs, arguments.seconds),
            "joint, arrays": joint(NullVector, sharing, arguments.epochs, arguments.seconds),
        }
        for name, (sampling, training) in rows.items():
            ratios = sampling / base[0], training / base[1]
            update = 1e6 * (1 / training - 1 / sampling) / arguments.epochs
            label = f"sharing {sharing}: {name}"
            rates = f"{sampling:9,.0f} {ratios[0]:7.1f} {training:10,.0f} {ratios[1]:7.1f}"
            print(f"{label:33s} {rates} {update:12.1f}")
    ray.shutdown()


if __name__ == "__main__":
    main()
