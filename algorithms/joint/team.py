"""Learners of a team's value, from the team's reward."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from algorithms.joint.batch import ReplayBatch, to_tensor
from algorithms.joint.learner import OffPolicyLearner
from algorithms.joint.rollout import JointRollout
from algorithms.parts.masking import masked_mean_of_agents
from algorithms.parts.moments import RunningMoments

MOMENTS = "reward_moments"


def team_reward(rewards: Tensor, alive: Tensor, kind: str) -> Tensor:
    """Return the "sum" or "mean" (...) of the active agents' rewards (..., N)."""
    return masked_mean_of_agents(rewards, alive) if kind == "mean" else torch.where(alive, rewards, 0).sum(-1)


class TeamLearner(OffPolicyLearner):
    """Learns a value of the team from its rewards, with `standardize_rewards` from standardised ones.

    Each rollout enters the moments once, with a weight by which they are about those of the transitions in
    replay. They are applied to samples, so that old and new transitions are scaled alike. (EPyMARL takes in
    every sample, which counts a transition as often as it is drawn.)
    """

    def build(self) -> None:
        """Build modules, with no reward seen."""
        super().build()
        self.reward_moments = RunningMoments(enabled=self.config.standardize_rewards).to(self._device)

    def update_joint(self, rollout: JointRollout) -> None:
        """Update the moments of the team's rewards, then learn from replay."""
        if self.config.standardize_rewards:
            alive, rewards = (to_tensor(x, self._device) for x in (rollout.views.alive[:-1], rollout.rewards))
            is_active = alive.any(-1)
            decay = math.exp(-int(is_active.sum()) / self.config.capacity)
            team = team_reward(rewards, alive, self.config.team_reward)
            self.reward_moments.observe(team, is_active, decay)
        super().update_joint(rollout)

    def reward(self, batch: ReplayBatch) -> Tensor:
        """Return the team's rewards (M,) that values are fitted to."""
        reward = team_reward(batch.rewards, batch.alive, self.config.team_reward)
        if self.config.standardize_rewards:
            reward = self.reward_moments.scaled(reward)
        return self.config.reward_scale * reward

    def _own_state(self) -> dict[str, Any]:
        moments = {name: float(x) for name, x in self.reward_moments.state_dict().items()}
        return {**super()._own_state(), MOMENTS: moments}

    def _set_own_state(self, state: dict[str, Any]) -> None:
        super()._set_own_state(state)
        self.reward_moments.load_state_dict({name: torch.tensor(x) for name, x in state[MOMENTS].items()})
