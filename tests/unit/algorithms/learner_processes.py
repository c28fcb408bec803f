"""Learners in processes of their own, and one to compare them with."""

import math
import os

import numpy as np
import ray
import torch

from algorithms.joint.data_parallel import DataParallel
from algorithms.joint.training_data import JointTrainingData
from algorithms.parts.noise import RowGenerator, exponential
from algorithms.ppo import PPOLearner
from tests.games.games import Ragged
from tests.unit.algorithms.rigs import Rig, known

LR = 2.0**-10
SETTINGS = {
    "lr": LR,
    "epochs": 2,
    "minibatch_size": 25,
    "learning_starts": 8,
    "batch_size": 25,
    "capacity": 300,
    "updates_per_step": 0.05,
    "fit_steps": 2,
    "sequence_length": 8,
}


def rig(name, learners=0, seed=0, gpus=0, **settings):
    """Return the rig of an algorithm: odd minibatches, agents that come and go."""
    return Rig(
        name,
        Ragged,
        {"crash": 0.0},
        seed=seed,
        learners=learners,
        gpus=gpus,
        **(known(name, SETTINGS) | settings),
    )


def learn(learner, rollouts, made=0):
    """Learn from rollouts, as many having been made before; return the results of the last update."""
    results = {}
    for count, rollout in enumerate(rollouts, made + 1):
        steps = {"num_env_steps_sampled_lifetime": 48 * count}
        results = learner.update(training_data=JointTrainingData(rollout), timesteps=steps)
    return {
        f"{key}/{name}": value
        for key, part in results.items()
        if isinstance(part, dict)
        for name, stats in part.items()
        if math.isfinite(value := float(stats.peek()))  # others are of earlier updates
    }


def arrays(weights):
    """Return weights as arrays by name."""
    return {
        f"{module}/{name}": x.cpu().numpy() for module, part in weights.items() for name, x in part.items()
    }


@ray.remote(num_cpus=0)
class Process:
    """One of several learners."""

    def __init__(self, rank, size, meeting):
        torch.set_num_threads(1)
        self.rank, self.size = rank, size
        torch.distributed.init_process_group(
            "gloo", init_method=f"file://{meeting}", rank=rank, world_size=size
        )

    def learn(self, name, rollouts, settings):
        """Return weights and results of this learner, and a number that it draws next."""
        made = rig(name, self.size, **settings)
        results = learn(made.learner, rollouts)
        return arrays(made.weights()), results, made.learner.rng.random()

    def first_weights(self, name):
        """Return the weights of a learner of its own seed."""
        return arrays(rig(name, self.size, seed=self.rank).weights())

    def drawn(self, rows):
        """Return the numbers that this learner draws for its rows of a minibatch, and these of all rows."""
        batch = replay_of(rig("dqn")).batch(np.arange(rows), "cpu")
        generator = RowGenerator()
        parallel = DataParallel(generator, size=self.size, rank=self.rank)
        with parallel.own_rows(batch) as own:
            numbers = exponential(own.rewards, generator)
            whole = parallel.whole(numbers[:, 0].contiguous())
        return own.rows, numbers, whole, exponential(torch.zeros(3), generator)


def replay_of(made):
    """Return a replay buffer with a rollout."""
    made.learner.replay.add(made.rollout(24))
    return made.learner.replay


def process_id(learner):
    """Return the id of a learner's process."""
    return os.getpid()


class Failing(PPOLearner):
    """Fails in the second of two learners only."""

    def update_minibatch(self, batch):
        if self.parallel.rank == 1:
            raise ValueError("half a loss")
        super().update_minibatch(batch)
