"""Probabilistic recursive reasoning (PR2-Q): agents expect the others to answer to what they do themselves.

Wen et al. 2019, "Probabilistic Recursive Reasoning for Multi-Agent Reinforcement Learning". The joint policy
is factored as pi_i(a_i | s) rho(a_-i | s, a_i), with the others' conditional policy approximated by

    rho(a_-i | s, a_i) = exp(Q_i(s, a_i, a_-i) - Q_i(s, a_i)),   Q_i(s, a_i) = log sum over a_-i of exp Q_i,

the minimum of the paper's variational bound. The value of an own action is the mean of Q_i(s, a_i, a_-i)
under rho. The agent takes the best action, and bootstraps with its value.

Q_i, its loss and replay are those of `opponent_q`. Since this Q_i is a sum over the others, rho is a product
of softmaxes over q_ij(o, a_i, .), and exact: no sampler (the paper's SVGD) is needed.

Deviations: own observations instead of states; discrete actions only (the paper's PR2-AC is left out),
chosen epsilon-greedily; a temperature `alpha` on Q, in scaled returns; Q_i is the sum of `opponent_q`, which
is exact for two agents; an agent's answers count by the probability that it is present, from a model as in
`opponent_q`. The others' action masks are not known to an agent and are ignored.
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
    interchangeable = ("alpha",)
    module_class = PR2Module

    def module_settings(self):
        """Return the settings that networks are built from."""
        return super().module_settings() | {"alpha": self.alpha}


class PR2(OpponentQ):
    """PR2-Q."""

    config_class = PR2Config
    learner_class = OpponentQLearner
