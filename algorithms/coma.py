"""Counterfactual multi-agent policy gradients (COMA): each agent's share of the team's value.

Foerster et al. 2018, "Counterfactual Multi-Agent Policy Gradients". One central critic Q(s, u) of the state
and all agents' actions learns on-policy from TD(lambda) targets of the team's reward, with a target network.
Each agent's policy follows grad log pi^a(u^a | o^a) A^a(s, u), where the counterfactual advantage of eq. 4,

    A^a(s, u) = Q(s, u) - sum over u'^a of pi^a(u'^a | o^a) Q(s, (u^-a, u'^a)),

compares the action with the agent's others while the other agents' actions stay. The critic is the paper's:
it takes the state, the agent's number and the actions u^-a of the others, and returns Q for all actions of
the agent in one pass. Policies explore by (1 - epsilon) softmax + epsilon / |U|, with epsilon annealed.

Deviations: memory is optional (`gru`); the critic does not read the agent's observation and last actions
beside the state; it takes `critic_steps` steps on a whole rollout instead of one on each time step; targets
bootstrap from the mean of the active agents' outputs, since agents come and go; where a fragment or a time
limit cuts, the actions that are valued next are drawn from the policies; the target network follows by polyak
averaging; Adam instead of RMSProp.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from algorithms.joint.algorithm import JointAlgorithm
from algorithms.joint.batch import GroupView, JointView, OnPolicyBatch, encode, to_tensor
from algorithms.joint.config import JointConfig
from algorithms.joint.joint_encoder import JointEncoder
from algorithms.joint.learner import OnPolicyLearner
from algorithms.joint.module import JointModule, LearnerModule
from algorithms.joint.rollout import JointRollout
from algorithms.joint.spec import JointSpec, action_size
from algorithms.joint.team import team_reward
from algorithms.maac import counterfactual_advantage
from algorithms.parts.advantages import generalised_advantages
from algorithms.parts.distributions import FlooredDistribution, FlooredHead, Head
from algorithms.parts.masking import masked_mean_of_agents

CRITIC = "team__critic"
LINEAR = 64
"""Width between the two linear maps of a critic without hidden layers."""


class COMAModule(JointModule):
    """The default policy, with a least probability of every action while it explores."""

    def make_head(self) -> Head:
        """Sample from a softmax with a floor."""
        return FlooredHead(self.group.action)


class CounterfactualQ(nn.Module):
    """Q(s, (u^-a, .)) of all agents and all own actions, (M, n, A) by group id.

    The first layer is linear in the actions, so taking an agent's own out costs one small product. Without
    hidden layers all of Q is linear.
    """

    def __init__(self, spec: JointSpec, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self._groups = spec.groups
        self._sizes = [(group.size, action_size(group.action)) for group in spec.groups]
        width, *others = hidden or (LINEAR,)
        self.encoder = JointEncoder(spec)
        self.see = nn.Linear(self.encoder.size, width)
        self.act = nn.Linear(sum(n * a for n, a in self._sizes), width, bias=False)
        self.place = nn.Parameter(torch.randn(len(spec.agents), width) * 0.1)
        layers = [layer for size in pairwise((width, *others)) for layer in (nn.ReLU(), nn.Linear(*size))]
        self.rest = nn.Sequential(*layers, *([nn.ReLU()] if hidden else []))
        last = [width, *others][-1]
        self.values = nn.ModuleList(
            nn.Linear(last, action_size(block.action)) for block in spec.spaces.blocks
        )

    def forward(self, view: JointView, actions: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return the values.

        Args:
            view: What all agents see.
            actions: All agents' actions by group id, one-hot (M, n, A), zeros for the absent.
        """
        flat = torch.cat([actions[group.id].flatten(1) for group in self._groups], -1)
        everything = (self.see(self.encoder(view)) + self.act(flat)).unsqueeze(1)
        weights = self.act.weight.T.split([n * a for n, a in self._sizes])
        values = {}
        for group, size, weight in zip(self._groups, self._sizes, weights, strict=True):
            own = torch.einsum("mna,nah->mnh", actions[group.id], weight.unflatten(0, size))
            first = everything - own + self.place[group.columns]
            values[group.id] = self.values[group.block](self.rest(first))
        return values


class COMACritic(LearnerModule):
    """The critic and its target."""

    targets, joins = ("target_q",), "state"

    def make_networks(self) -> None:
        """Create the critic."""
        self.q = CounterfactualQ(self.spec, self.settings["hidden"])


class COMALearner(OnPolicyLearner):
    """Critic steps towards TD(lambda) targets, then a step of every policy."""

    epsilon = 0.0
    """Floor of the policies that acted."""

    def update_joint(self, rollout: JointRollout) -> None:
        """Learn from one rollout."""
        with self.parallel.own_rows(self.prepare(rollout)) as own:
            self.update_minibatch(own)
        self.polyak_update(CRITIC, tau=self.config.tau)
        self.updates += 1

    def prepare(self, rollout: JointRollout) -> OnPolicyBatch:
        """Return all transitions of the rollout, T*B rows, with TD(lambda) targets of the team's value."""
        self.epsilon = self.config.exploration(max(self.env_steps - rollout.env_steps(), 0)).epsilon
        device = self._device
        views = JointView.of(self.spec, rollout.views, device)
        final = JointView.of(self.spec, rollout.final, device)
        now, end, alive = views[:-1].flat(), views[-1], views.alive[:-1]
        with torch.no_grad():
            taken = self.team_value(now, self.taken(now, rollout)).unflatten(0, alive.shape[:2])
            values = torch.cat([taken, self.team_value(end, self.drawn(end))[None]])
            final_values = self.team_value(final, self.drawn(final)) if len(final) else values[0, :0]
        chain, bootstrap = (to_tensor(mask, device) for mask in team_masks(rollout))
        rewards = team_reward(to_tensor(rollout.rewards, device), alive, self.config.team_reward)
        _, targets = generalised_advantages(
            self.config.reward_scale * rewards[..., None],
            values[..., None],
            final_values[..., None],
            to_tensor(rollout.final_at, device),
            bootstrap[..., None],
            chain[..., None],
            gamma=self.gamma,
            lambda_=self.config.lambda_,
        )
        self.report_values(values[:-1, :, None].expand_as(alive), targets.expand_as(alive), alive)
        # The agents' advantages are known after the critic's steps only.
        return self.batch(rollout, views, torch.zeros_like(alive.float()), targets.expand_as(alive))

    def taken(self, view: JointView, rollout: JointRollout) -> dict[str, Tensor]:
        """Return the rollout's actions by group id, one-hot (T*B, n, A)."""
        actions = [to_tensor(actions, self._device).flatten(0, 1) for actions in rollout.actions]
        return {
            g.id: encode(g, actions[g.block][:, g.within]) * view.alive[:, g.columns, None]
            for g in self.groups
        }

    def drawn(self, view: JointView) -> dict[str, Tensor]:
        """Return actions drawn from the policies by group id, one-hot (M, n, A)."""
        drawn = {}
        for group in self.groups:
            own = view.view(group)
            actions = self.distribution(group.id, own).sample(self.generator)
            drawn[group.id] = encode(group, actions) * own.alive[..., None]
        return drawn

    def distribution(self, module_id: str, view: GroupView) -> FlooredDistribution:
        """Return a policy as it acts while it explores."""
        return FlooredDistribution(self.net(module_id).policy(view), view.action_mask, self.epsilon)

    def team_value(self, view: JointView, actions: Mapping[str, Tensor]) -> Tensor:
        """Return the target critic's Q(s, u), (M,): the mean of the active agents' outputs."""
        values = self.net(CRITIC).target_q(view, actions)
        chosen = view.join({name: (values[name] * actions[name]).sum(-1) for name in values})
        return masked_mean_of_agents(chosen, view.alive)

    def update_minibatch(self, batch: OnPolicyBatch) -> None:
        """Fit the critic, then step every policy."""
        if len(batch.absent) == len(self.groups):
            return
        taken = batch.encoded_actions()
        for _ in range(self.config.critic_steps):
            self.fit_critic(batch, taken)
        self.improve_policies(batch, taken)

    def fit_critic(self, batch: OnPolicyBatch, taken: Mapping[str, Tensor]) -> None:
        """Regress Q(s, u) on its targets, as the output of every active agent."""
        values = self.net(CRITIC).q(batch, taken)
        chosen = batch.join({name: (values[name] * taken[name]).sum(-1) for name in values})
        loss = self.mean((chosen - batch.targets).square(), batch.alive)
        self.step_optimizer(loss, CRITIC)
        self.log(CRITIC, "critic_loss", loss)

    def improve_policies(self, batch: OnPolicyBatch, taken: Mapping[str, Tensor]) -> None:
        """Follow grad log pi^a(u^a) A^a(s, u) of every policy (eq. 4)."""
        with torch.no_grad():
            values = self.net(CRITIC).q(batch, taken)
        losses = {}
        for group, own in batch.present():
            policy = self.distribution(group.id, own)
            advantage = counterfactual_advantage(values[group.id], policy, own.actions).detach()
            losses[group.id] = -self.mean(policy.log_prob(own.actions) * advantage, own.alive)
            self.log(group.id, "policy_loss", losses[group.id])
            self.log(group.id, "entropy", self.mean(policy.entropy(), own.alive))
        self.step_each(losses)


def team_masks(rollout: JointRollout) -> tuple[np.ndarray, np.ndarray]:
    """Return where the team continues in the next row, and where what follows counts, each (T, B).

    A row that follows the cut of any agent is a final row, in which that agent still counts.
    """
    alive = rollout.views.alive
    chain = alive[1:].any(-1) & ~(rollout.masks().last.any(-1) | rollout.reset | rollout.failed)
    bootstrap = chain.copy()
    bootstrap[tuple(rollout.final_at.T)] = rollout.final.alive.any(-1)
    return chain, bootstrap


class COMAConfig(JointConfig):
    """RLlib config of COMA."""

    algorithm = "coma"
    policy_module = COMAModule
    team_modules: ClassVar = {CRITIC: COMACritic}
    explores_by = "epsilon"


class COMA(JointAlgorithm):
    """COMA."""

    config_class = COMAConfig
    learner_class = COMALearner
