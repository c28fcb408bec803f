"""How a rollout travels to learners."""

from __future__ import annotations

from typing import Any

import ray
from ray.rllib.core.learner.training_data import TrainingData

from algorithms.joint.rollout import JointRollout


class JointTrainingData(TrainingData):
    """Carries a rollout, or none, through RLlib's learner group."""

    def __init__(self, rollout: JointRollout | ray.ObjectRef | None = None) -> None:
        super().__init__()
        self.rollout = rollout

    def validate(self) -> None:
        """Accept it: the rollout was checked where it was made (RLlib)."""

    def solve_refs(self) -> None:
        """Fetch the data from the object store (RLlib)."""
        if isinstance(self.rollout, ray.ObjectRef):
            self.rollout = ray.get(self.rollout)

    def shard(self, num_shards: int, **kwargs: Any) -> list[tuple[JointTrainingData, dict]]:  # type: ignore[override]
        """Return the data for each of the learners (RLlib): all of it, since they split minibatches."""
        return [(self, {})] * num_shards
