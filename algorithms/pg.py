"""Independent policy gradient (PG, REINFORCE) on whole trajectories.

Williams 1992, "Simple Statistical Gradient-Following Algorithms for Connectionist Reinforcement Learning":
the gradient grad log pi(a_i | o_i) (G_i - b), where G_i is the discounted sum of the agent's own rewards from
this step to the end of its trajectory and b does not depend on the action. Sutton et al. 2000, "Policy
Gradient Methods for Reinforcement Learning with Function Approximation", give the same per step.

Nothing is bootstrapped: a trajectory that has not ended with the fragment is held until it ends, and its
whole return is learned from. Where a time limit ends a trajectory, its return ends too. A trajectory that a
failing environment breaks off has no return and is dropped.

Deviations: the factor gamma^t of a step's place in its trajectory is left out, as is usual; the baseline is a
learned V(o_i), regressed on the returns (`baseline=False`: none); standardised advantages; an entropy bonus;
Adam. A trajectory that outlasts its fragment is learned from by the newest policy, although older ones chose
its first actions, one update older for each fragment: no importance ratio corrects that. Fragments that are
long beside episodes keep the share of such actions small.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import torch

from algorithms.a2c import A2C, A2CConfig, A2CLearner
from algorithms.joint.batch import JointView, OnPolicyBatch, to_tensor
from algorithms.joint.env import Bools
from algorithms.joint.rollout import JointRollout
from algorithms.joint.spec import JointSpec
from algorithms.joint.trajectories import OpenTrajectories


def returns_to_go(rewards: np.ndarray, chain: Bools, gamma: float) -> np.ndarray:
    """Return the discounted sum of rewards (T, B, N) from each step to the end of the trajectory or the data.

    Args:
        rewards: (T, B, N).
        chain: The trajectory continues in the next row, (T, B, N).
        gamma: Discount.
    """
    returns = np.empty_like(rewards)
    running = np.zeros_like(rewards[0])
    for t in range(len(rewards) - 1, -1, -1):
        running = rewards[t] + gamma * chain[t] * running
        returns[t] = running
    return returns


class PGLearner(A2CLearner):
    """One policy-gradient step on all trajectories that have ended since the last."""

    def build(self) -> None:
        """Build modules, with no trajectory open."""
        super().build()
        self.trajectories = OpenTrajectories(self.config.longest_trajectory)

    def update_joint(self, rollout: JointRollout) -> None:
        """Learn from the trajectories that ended in this fragment."""
        batch = self.prepare(rollout)
        if len(batch):
            with self.parallel.own_rows(batch) as own:
                self.update_minibatch(own)
            self.updates += 1

    def prepare(self, rollout: JointRollout) -> OnPolicyBatch:
        """Return one row per (step, environment) with an agent whose trajectory has ended.

        `alive` marks these agents only.
        """
        whole, ready = self.trajectories.add(rollout)
        returns = returns_to_go(whole.rewards * self.config.reward_scale, whole.masks().chain, self.gamma)
        t, b = np.nonzero(ready.any(-1))
        device = self._device
        now = replace(
            JointView.of(self.spec, whole.views[t, b], device), alive=to_tensor(ready[t, b], device)
        )
        alive, targets = now.alive, to_tensor(returns[t, b], device)
        with torch.no_grad():
            baseline = self.values(now) if self.config.baseline else torch.zeros_like(targets)
            if self.config.baseline:
                self.report_values(baseline, targets, alive)
        batch = OnPolicyBatch(
            *now.moments(),
            actions=tuple(to_tensor(actions[t, b], device) for actions in whole.actions),
            rewards=to_tensor(whole.rewards[t, b], device),
            bootstrap=torch.zeros_like(alive),
            log_prob=torch.zeros_like(targets),
            advantages=self._scaled(targets - baseline, alive),
            targets=torch.where(alive, targets, 0),
        )
        self.observe_targets(batch)
        return batch

    def observe_targets(self, batch: OnPolicyBatch) -> None:
        """Adapt the scale of baselines."""
        if self.config.baseline:
            super().observe_targets(batch)

    def fit_values(self, batch: OnPolicyBatch) -> None:
        """Regress baselines on returns."""
        if self.config.baseline:
            super().fit_values(batch)

    def _own_state(self) -> dict[str, Any]:
        return {**super()._own_state(), "trajectories": self.trajectories.get_state()}

    def _set_own_state(self, state: dict[str, Any]) -> None:
        super()._set_own_state(state)
        self.trajectories.set_state(state["trajectories"])


class PGConfig(A2CConfig):
    """RLlib config of independent PG."""

    algorithm = "pg"

    def checkpoint_signature(self):
        """Return what a checkpoint's weights depend on."""
        return {**super().checkpoint_signature(), "baseline": self.baseline}

    def modules(self, spec: JointSpec):
        """Return a policy for each group, and a value network as its baseline."""
        return {
            name: module
            for name, module in super().modules(spec).items()
            if self.baseline or not module.learner_only
        }


class PG(A2C):
    """Independent PG."""

    config_class = PGConfig
    learner_class = PGLearner
