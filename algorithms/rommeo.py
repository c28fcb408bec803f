"""Regularised opponent model with maximum entropy objective (ROMMEO-Q): a prior over optimistic answers.

Tian et al. 2019, "A Regularized Opponent Model with Maximum Entropy Objective". Agent i chooses a policy
pi(a_i | o, a_-i) and a model rho(a_-i | o) of what the others do, to maximise

    E over rho and pi of Q_i(o, a_i, a_-i) + alpha H(pi) - alpha KL(rho || P),

where P(a_-i | o) is what the others have been seen to do. So the model leans to what is good for agent i, as
far as experience lets it. The best pair, and its value, are

    pi  = exp(Q_i(o, a_i, a_-i) / alpha) / Z(a_-i),  Z(a_-i) = sum over a_i of exp(Q_i(o, a_i, a_-i) / alpha),
    rho = P(a_-i | o) Z(a_-i) exp(-V(o) / alpha),    V(o) = alpha log of the sum over a_-i of P(a_-i | o) Z.

An agent draws a_i from the marginal policy, the mean of pi under rho, which is

    p(a_i | o) = exp((q(a_i) - V(o)) / alpha),  q(a_i) = alpha log E under P of exp(Q_i(o, a_i, .) / alpha),

and Q_i is fitted to r_i + gamma V(o'). Q_i, the models P and replay are those of `opponent_q`; since this Q_i
is a sum over the others, q(a_i) is one, too, and exact.

The paper could not be read when this was written. The objective, losses and targets are those of the authors'
code of ROMMEO-AC; pi, rho and the marginal policy, those of one author's code of ROMMEO-Q.

Deviations: own observations instead of states; one weight `alpha`, in scaled returns, for both terms, where
the code anneals that of H(pi), by which Z gets a power; discrete actions only, no ROMMEO-AC; random actions
with probability epsilon, as in the code; those of `opponent_q` for Q_i and P, which are networks, where the
code counts. The others' action masks are not known to an agent and are ignored.
"""

from __future__ import annotations

import torch
from torch import Tensor

from algorithms.joint.batch import GroupView
from algorithms.opponent_q import OpponentQ, OpponentQConfig, OpponentQLearner, OpponentQModule, PairwiseQ
from algorithms.parts.distributions import FlooredHead, Head
from algorithms.parts.masking import MASKED_LOGIT


class ROMMEOModule(OpponentQModule):
    """Draws actions by the best tempered expectation of the others."""

    def make_head(self) -> Head:
        """Draw actions by p(a_i | o), or at random."""
        return FlooredHead(self.group.action)

    def policy(self, view: GroupView) -> Tensor:
        """Return log p(a_i | o) but for a constant, (M, n, K)."""
        return self.values(view, self.q) / self.settings["alpha"]

    def values(self, view: GroupView, q: PairwiseQ) -> Tensor:
        """Return q(a_i) (M, n, K) by a Q network."""
        own, pairs = q(view.observations)
        with torch.no_grad():
            model = self.model(view.observations).unsqueeze(-3)
        return own + self.tempered(pairs, model).sum(-1)

    def tempered(self, pairs: Tensor, model: Tensor) -> Tensor:
        """Return alpha log E under P of exp(q_ij / alpha), (M, n, K, N); absent agents add nothing.

        Args:
            pairs: q_ij, (M, n, K, N, A).
            model: log P, (M, n, 1, N, A + 1).
        """
        alpha = self.settings["alpha"]
        worth = torch.cat([pairs, torch.zeros_like(pairs[..., :1])], -1)
        return alpha * (model + worth / alpha).logsumexp(-1)


class ROMMEOLearner(OpponentQLearner):
    """Models from the newest rollout, soft temporal differences from replay."""

    def next_value(self, net: ROMMEOModule, view: GroupView) -> Tensor:  # type: ignore[override]
        """Return V(o) (M, n) by the target network, over the own actions that the mask allows."""
        alpha = net.settings["alpha"]
        with torch.no_grad():
            values = net.values(view, net.target_q)
            if view.action_mask is not None:
                values = values.masked_fill(~view.action_mask, MASKED_LOGIT)
            return alpha * (values / alpha).logsumexp(-1)


class ROMMEOConfig(OpponentQConfig):
    """RLlib config of ROMMEO-Q."""

    algorithm = "rommeo"
    interchangeable = ("alpha",)
    module_class = ROMMEOModule

    def module_settings(self):
        """Return the settings that networks are built from."""
        return super().module_settings() | {"alpha": self.alpha}


class ROMMEO(OpponentQ):
    """ROMMEO-Q."""

    config_class = ROMMEOConfig
    learner_class = ROMMEOLearner
