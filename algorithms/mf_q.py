"""Mean-field Q-learning (MF-Q).

Yang et al. 2018, "Mean Field Multi-Agent Reinforcement Learning", section 3 and its algorithm of the same
name. What the others do enters an agent's value through the mean of its neighbours' one-hot actions only:

    mean action     m_i = (1 / N_i) * sum of one-hot a_j over the neighbours j of i
    policy          pi_i(a | o, m) proportional to exp(Q_i(o, a, m) / temperature), m of the step before
    value           v_i(o') = sum_a pi_i(a | o', m_i) * Q_i(o', a, m_i), by the target network
    update          Q_i(o, a_i, m) towards r_i + gamma * v_i(o')

Agents act before they know what the others do now, so they act on the mean action of the step before. It
leaves out the agent's own action, inactive agents and agents that are not its neighbours; it is zero for an
agent alone, and where a trajectory begins.

The update is at the m acted on, as in the authors' code (mlii/mfrl). In the paper's algorithm it is at m_i,
that of the same step as a_i: `update_at="same_step"`. Such values say what an action is worth while the
others do something, and agents act on them as if the others did it again: where several have to begin
together, none does. Where an agent acted on zero it is updated at zero in any case: otherwise the values that
its first action follows would never be learned.

Deviations: agents see their own observations, not a global state; v_i takes one sample of m_i, the actual
one, for its expectation; the temperature is constant; target networks follow by polyak averaging; agents that
share a network are told apart by their place.
"""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from algorithms.errors import SpaceError
from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import GroupView, ReplayBatch, ReplayGroup
from algorithms.joint.config import JointConfig
from algorithms.joint.env import VectorJointEnv
from algorithms.joint.features import MEAN_ACTION, WithMeanActions, common_actions
from algorithms.joint.learner import OffPolicyLearner
from algorithms.joint.module import JointModule
from algorithms.joint.neighbours import Neighbourhood
from algorithms.joint.spec import Group, JointSpec
from algorithms.maac import of_actions
from algorithms.maddpg import ObservationNetwork
from algorithms.parts.communication import mean_over
from algorithms.parts.distributions import BoltzmannHead, Head
from algorithms.parts.networks import Encoder


class MeanFieldQModule(JointModule):
    """A Q network, whose Boltzmann policy acts, and its target."""

    targets = ("target_q",)

    def make_head(self) -> Head:
        """Act by Boltzmann's distribution."""
        return BoltzmannHead(self.group.action, self.settings["temperature"])  # type: ignore[arg-type]

    def make_networks(self) -> None:
        """Create Q(o, ., m) of the observations, one of which is the mean action."""
        self.q = ObservationNetwork(self.group, self.settings["hidden"], self.head.outputs)

    def policy(self, view: GroupView) -> Tensor:
        """Return Q values (M, n, A) for the mean action of the step before, which is among the leaves."""
        return self.q(view.observations)

    def feedforward_parts(self) -> tuple[Encoder, nn.Module]:
        """Return encoder and body, for stacked acting."""
        return self.q.encoder, self.q.body


def mean_actions(batch: ReplayBatch, neighbourhood: Neighbourhood) -> Tensor:
    """Return the mean one-hot action of each agent's active neighbours, (M, N, A)."""
    return mean_over(neighbourhood.of(batch), batch.join(batch.encoded_actions()))


class MeanFieldLearner(OffPolicyLearner):
    """Knows the neighbours over which means are taken."""

    def build(self) -> None:
        """Build modules, and what tells neighbours."""
        super().build()
        self.neighbourhood = Neighbourhood(self.spec.spaces, self.config.graph)


class MeanFieldQLearner(MeanFieldLearner):
    """Temporal-difference steps with the mean action, group by group."""

    def update_minibatch(self, batch: ReplayBatch) -> None:
        """Step every Q network towards its bootstrapped target, then targets."""
        losses = {}
        for group, own in batch.present():
            net = self.net(group.id)
            with torch.no_grad():
                following = net.target_q(own.next.observations)
                policy = net.head.distribution(following, own.next.action_mask)
                target = self.td_target(own, (policy.log_probs.exp() * following).sum(-1))
            chosen = of_actions(net.q(self._updated_at(batch, group, own)), own.actions)
            losses[group.id] = self.mean((chosen - target).square(), own.alive)
            self.log(group.id, "td_loss", losses[group.id])
        self.step_each(losses)
        self.polyak_update(*(g.id for g in self.groups), tau=self.config.tau)

    def _updated_at(self, batch: ReplayBatch, group: Group, own: ReplayGroup) -> Mapping[str, Tensor]:
        """Return the observations at which values are updated, with the mean action of `update_at`."""
        if self.config.update_at == "acted_on":
            return own.observations
        mean = mean_actions(batch, self.neighbourhood)[:, group.columns]
        known = own.observations[MEAN_ACTION].any(-1, keepdim=True)
        return {**own.observations, MEAN_ACTION: torch.where(known, mean, 0)}


class MeanFieldConfig(JointConfig):
    """RLlib config of both mean-field algorithms."""

    def check(self, spec: JointSpec) -> None:
        """Raise if agents have different actions; see `JointConfig.check`.

        Raises:
            SpaceError: Actions are not discrete, or not equally many.
        """
        super().check(spec)
        if not common_actions(spec.spaces):
            sizes = {block.agents[0]: str(block.action) for block in spec.spaces.blocks}
            raise SpaceError(
                f"{self.algorithm!r} takes means over actions, which differ: {sizes}",
                place="action space",
                remedy="give all agents equal action spaces, or use 'maddpg' or 'maac'",
            )


class MeanFieldQConfig(MeanFieldConfig):
    """RLlib config of MF-Q."""

    algorithm = "mf_q"
    policy_module = MeanFieldQModule
    network_settings = ("temperature",)
    interchangeable = ("temperature",)

    def adapt(self, env: VectorJointEnv) -> VectorJointEnv:
        """Show agents the mean action of the step before, where actions are equal; else `check` raises."""
        return WithMeanActions(env, self.graph) if common_actions(env.spaces) else env


class MeanFieldQLearning(JointAlgorithm):
    """MF-Q."""

    config_class = MeanFieldQConfig
    learner_class = MeanFieldQLearner
