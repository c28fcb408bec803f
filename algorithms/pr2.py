"""Probabilistic recursive reasoning (PR2-Q): agents expect the others to answer to what they do themselves.

Wen et al. 2019, "Probabilistic Recursive Reasoning for Multi-Agent Reinforcement Learning". The joint policy
is factored as pi_i(a_i | s) rho(a_-i | s, a_i) (eq. 3), with the others' conditional policy approximated by

    rho(a_-i | s, a_i) = exp(Q_i(s, a_i, a_-i) - Q_i(s, a_i)),   Q_i(s, a_i) = log sum over a_-i of exp Q_i,

the minimum of the paper's variational bound (theorem 1: eq. 12 and 11). The value of an own action is the
mean of Q_i(s, a_i, a_-i) under rho, along which the policy gradient goes (eq. 6 and 7). The agent takes the
best action, and bootstraps with its value. Numbers are those of the version that was submitted to ICLR.

Q_i, its loss and replay are those of `opponent_q`. Since this Q_i is a sum over the others, rho is a product
of softmaxes over q_ij(o, a_i, .), and exact: no sampler (the paper's SVGD) is needed.

Deviations, where "the code" is that of PR2-Q by one of the authors (ying-wen/malib_deprecated):

- Targets take the largest mean of Q_i under rho, as in the code; the paper's operator (eq. 13) takes the
  Q_i(s, a_i) of eq. 11, the others' entropy included, for a_i of the policy.
- Actions are chosen epsilon-greedily; the code draws them from a softmax of their values, besides epsilon.
- Q_i(s, a_i) is the logarithm of the sum, by which rho adds up to 1. The code fits it to the targets of
  Q_i(s, a_i, a_-i), and by default takes for rho how often the others did a_-i when it did a_i.
- A temperature `alpha` on Q, in scaled returns.
- Q_i is the sum of `opponent_q`, which is exact for two agents; an agent's answers count by the probability
  that it is present, from a model as in `opponent_q`.
- Own observations instead of states; the others' action masks are not known to an agent and are ignored.
- Discrete actions only; PR2-AC is left out.
"""

from __future__ import annotations

import torch
from torch import Tensor

from algorithms.joint.batch import GroupView
from algorithms.opponent_q import OpponentQ, OpponentQConfig, OpponentQLearner, OpponentQModule
from algorithms.parts.masking import MASKED_LOGIT


class PR2Module(OpponentQModule):
    """Expects the others to answer to each of its own actions."""

    def expected(self, view: GroupView, pairs: Tensor) -> Tensor:
        """Return rho, (M, n, K, N, A), times the probability that an agent is there."""
        with torch.no_grad():
            there = 1 - self.model(view.observations)[..., -1:].exp()
        return self.answers(pairs) * there.unsqueeze(-3)

    def answers(self, pairs: Tensor) -> Tensor:
        """Return rho_j(a_j | o_i, a_i), (M, n, K, N, A), of q_ij."""
        possible = self.model.possible[:, :-1]
        return (pairs / self.settings["alpha"]).masked_fill(~possible, MASKED_LOGIT).softmax(-1)


class PR2Config(OpponentQConfig):
    """RLlib config of PR2-Q."""

    algorithm = "pr2"
    network_settings = ("alpha",)
    interchangeable = ("alpha",)
    policy_module = PR2Module


class PR2(OpponentQ):
    """PR2-Q."""

    config_class = PR2Config
    learner_class = OpponentQLearner
