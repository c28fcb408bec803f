"""Regularised opponent model with maximum entropy objective (ROMMEO-Q): a prior over optimistic answers.

Tian et al. 2019, "A Regularized Opponent Model with Maximum Entropy Objective". Agent i chooses a policy
pi(a_i | o, a_-i) and a model rho(a_-i | o) of what the others do, to maximise (eq. 6 and 7)

    E over rho and pi of Q_i(o, a_i, a_-i) + alpha H(pi) - alpha KL(rho || P),

where P(a_-i | o) is what the others have been seen to do. So the model leans to what is good for agent i, as
far as experience lets it. The best pair, and its value, are (theorem 1: eq. 10, 11 and 9)

    pi  = exp(Q_i(o, a_i, a_-i) / alpha) / Z(a_-i),  Z(a_-i) = sum over a_i of exp(Q_i(o, a_i, a_-i) / alpha),
    rho = P(a_-i | o) Z(a_-i) exp(-V(o) / alpha),    V(o) = alpha log of the sum over a_-i of P(a_-i | o) Z.

An agent draws a_i from the marginal policy, the mean of pi under rho (algorithm 1), which is

    p(a_i | o) = exp((q(a_i) - V(o)) / alpha),  q(a_i) = alpha log E under P of exp(Q_i(o, a_i, .) / alpha),

and Q_i is fitted to r_i + gamma V(o') (eq. 12 and 13). Q_i, the models P and replay are those of
`opponent_q`; since this Q_i is a sum over the others, q(a_i) is one, too, and exact.

Deviations, where "the code" is the authors' (rommeoijcai2019/rommeo, which holds ROMMEO-Q and the paper with
its appendix):

- Both terms have the weight `alpha`, in scaled returns: eq. 6 has weights of 1, so this is its solution for
  rewards divided by `alpha`. From section 3.1 on, the paper's alpha is a weight of the entropy only, by which
  Z gets the power alpha; the code lets it fall from 1. Sums over what the others do would then not factorise.
- V is exact; algorithm 1 and the code estimate it from samples of pi and rho.
- P is a network fitted to the newest rollout. The paper counts in all of replay, the code in the last 50
  steps.
- Own observations instead of states; the others' action masks are not known to an agent and are ignored.
- Random actions with probability epsilon, as in the code and not in the paper.
- Huber's loss; the code updates a table without replay.
- Discrete actions only; ROMMEO-AC, whose policies are networks, is left out.
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
    network_settings = ("alpha",)
    interchangeable = ("alpha",)
    policy_module = ROMMEOModule


class ROMMEO(OpponentQ):
    """ROMMEO-Q."""

    config_class = ROMMEOConfig
    learner_class = ROMMEOLearner
