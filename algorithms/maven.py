"""MAVEN: QMIX whose agents commit to a shared latent for a whole episode, so that a team explores jointly.

Mahajan et al. 2019, "MAVEN: Multi-Agent Variational Exploration". A policy pi_z(z | s_0) draws a latent z at
the start of an episode; agents and mixer are conditioned on it until the end. The paper maximises

    J_RL + lambda_MI J_V - lambda_QL L_QL,    J_V = H(z) + E[log q(z | sigma(tau))],

where L_QL is QMIX's loss given z, J_RL the return of the episodes that z leads to, and J_V a lower bound on
the mutual information between z and the behaviour sigma(tau): the state and the agents' Boltzmann policies,
softmax over Q_i(o_i, .; z). The discriminator q and the agents' values ascend J_V together; pi_z ascends J_RL
by the policy gradient grad log pi_z(z | s_0) R on whole episodes as they end. In the authors' slides these
are eq. 8 (the sum), 4 (L_QL), 5 (J_RL), 6 and 7 (the mutual information and its bound).

Deviations, where "the code" is the authors' (AnujMahajanOxf/MAVEN, with the slides):

- QMIX's; lambda_QL is 1, as in the code.
- z is one-hot and enters the mixer's hypernetworks beside the state, as in the code. Sigma is of single
  steps, which is one of the code's two; the published runs have the other, of a recurrent network over the
  episode.
- The last layer of Q_i has biases, and an agent's number is an input of Q_i; the code's hypernetwork of that
  layer reads z and the number, and makes no biases.
- The logits of pi_z are sums over the agents' observations in s_0; the code reads the state.
- Returns are standardised by running moments, and H(z) has a weight of its own, `latent_entropy` (the code,
  of returns as they are: 0.001 to 0.1 in the published runs, where lambda_MI is 0.001 to 1).
- pi_z takes a step on the episodes that end in a rollout; the code takes several on draws from the last 512
  episodes. Where an episode outlasts its fragment, an older pi_z drew its z and older values played it: no
  importance ratio corrects that, nor in the code.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import torch
from gymnasium.spaces import Box
from torch import Generator, Tensor, nn

from algorithms.dqn import DQNModule, QNetwork
from algorithms.joint.batch import GroupView, JointView, ReplayBatch, to_tensor
from algorithms.joint.env import CARRIED, LATENT, AgentBlock, Floats
from algorithms.joint.joint_encoder import JointEncoder
from algorithms.joint.module import LearnerModule
from algorithms.joint.rollout import JointRollout, View
from algorithms.joint.serving import ask
from algorithms.joint.spec import Group, JointSpec, action_size
from algorithms.joint.team import team_reward
from algorithms.parts.distributions import CategoricalDistribution
from algorithms.parts.masking import MASKED_LOGIT
from algorithms.parts.moments import RunningMoments
from algorithms.parts.networks import Encoder, perceptron
from algorithms.qmix import MIXER, QMIX, QMIXConfig, QMIXLearner, QMIXMixer

DISCRIMINATOR = "team__discriminator"


class LatentPolicy(nn.Module):
    """Each agent's share (M, n, Z) of the logits of pi_z(z | s_0)."""

    def __init__(self, group: Group, hidden: Sequence[int], latents: int) -> None:
        super().__init__()
        own = {name: space for name, space in group.observation.items() if not name.startswith(CARRIED)}
        self.encoder = Encoder(own, group.places, group.set_width)
        self.body = perceptron([self.encoder.size, *hidden, latents], nn.ReLU)

    def forward(self, view: GroupView) -> Tensor:
        """Return the shares, zeros for inactive agents."""
        return torch.where(view.alive[..., None], self.body(self.encoder(view.observations)), 0)


class LatentQNetwork(QNetwork):
    """Q(o_i, .; z): the latent chooses the last layer, as a linear hypernetwork of a one-hot z does."""

    def __init__(
        self, group: Group, hidden: tuple[int, ...], actions: int, latents: int, **kind: Any
    ) -> None:
        seen = {name: space for name, space in group.observation.items() if name != LATENT}
        super().__init__(replace(group, observation=seen), hidden, latents * actions, **kind)
        if self.value is not None:
            self.value = nn.Linear(self.value.in_features, latents)

    def values(self, features: Tensor, leaves: Mapping[str, Tensor]) -> Tensor:
        """Return Q values of features, given the latent."""
        chosen = leaves[LATENT].float()
        every = self.advantage(features).unflatten(-1, (chosen.shape[-1], -1))
        advantage = (every * chosen[..., None]).sum(-2)
        value = None if self.value is None else (self.value(features) * chosen).sum(-1, keepdim=True)
        return self.duel(advantage, value)


class MAVENModule(DQNModule):
    """A Q network given the latent, and a share of the policy that draws it."""

    def make_networks(self) -> None:
        """Create the Q network and the latents' policy."""
        hidden, latents = self.settings["hidden"], self.settings["latents"]
        kind = {"duelling": self.settings["duelling"], "memory": self.memory_size}
        self.q = LatentQNetwork(self.group, hidden, self.head.outputs, latents, **kind)
        self.latent = LatentPolicy(self.group, hidden, latents)

    def feedforward_parts(self) -> None:
        """Return None: last layers differ from episode to episode."""

    @classmethod
    def latents(cls, modules: Sequence[MAVENModule], views: Sequence[GroupView]) -> CategoricalDistribution:
        """Return pi_z(z | s_0) for K first moments."""
        shares = [module.latent(view).sum(-2) for module, view in zip(modules, views, strict=True)]
        return CategoricalDistribution(torch.stack(shares).sum(0))

    @classmethod
    def begin_episode(  # type: ignore[override]
        cls, modules: Sequence[MAVENModule], views: Sequence[GroupView], generator: Generator
    ) -> list[Tensor]:
        """Draw one latent for each episode, the same for all agents, (K, n, Z)."""
        policy = cls.latents(modules, views)
        drawn = one_hot(policy.sample(generator), policy)
        return [drawn[:, None].expand(*view.alive.shape, -1) for view in views]

    def _forward_inference(self, batch: Mapping[str, Any], **kwargs: Any) -> dict[str, Any]:
        return super()._forward_inference(self._with_latent(batch), **kwargs)

    def _forward_exploration(self, batch: Mapping[str, Any], **kwargs: Any) -> dict[str, Any]:
        return super()._forward_exploration(self._with_latent(batch), **kwargs)

    def _with_latent(self, batch: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the batch with each row's most probable latent, where the caller gives none."""
        if LATENT in batch:
            return batch
        question = ask(self.group, batch, recurrent=self.recurrent)
        with torch.no_grad():
            policy = self.latents([self], [question.view])
        likely = one_hot(policy.mode(), policy)[question.rows]
        return {**batch, LATENT: likely.unflatten(0, question.shape)}


def one_hot(drawn: Tensor, policy: CategoricalDistribution) -> Tensor:
    """Return latents (K,) as agents see them, (K, Z)."""
    return nn.functional.one_hot(drawn, policy.log_probs.shape[-1]).float()


def latent_of(view: JointView) -> Tensor:
    """Return the latents (M, Z), which are those of every agent."""
    return view.observations[0][LATENT][:, 0]


class StateAndLatent(JointEncoder):
    """The global state and the latent."""

    def __init__(self, spec: JointSpec, latents: int) -> None:
        super().__init__(spec, without=(LATENT,))
        self.size += latents

    def forward(self, view: JointView) -> Tensor:
        """Return vectors (M, S + Z)."""
        return torch.cat([super().forward(view), latent_of(view)], -1)


class MAVENMixer(QMIXMixer):
    """QMIX's mixer, whose weights depend on the latent too."""

    def make_encoder(self) -> JointEncoder:
        """Return what encodes state and latent."""
        return StateAndLatent(self.spec, self.settings["latents"])


class Discriminator(LearnerModule):
    """q(z | sigma(tau)) from state and policies of a step, and the scale of the episodes' returns."""

    def make_networks(self) -> None:
        """Create all parts."""
        latents = self.settings["latents"]
        policies = sum(group.size * action_size(group.action) for group in self.spec.groups)
        self.encoder = JointEncoder(self.spec, without=(LATENT,))
        sizes = [self.encoder.size + policies, *self.settings["hidden"], latents]
        self.body = perceptron(sizes, nn.ReLU)
        self.moments = RunningMoments(enabled=True)


class EpisodeReturns:
    """The team's returns of whole episodes, with the moments in which they began.

    An episode that a failure breaks off, or of whose beginning nothing is known, has no return.
    """

    def __init__(self) -> None:
        self.open: dict[tuple[int, ...], tuple[int, View | None, float]] = {}
        """Steps made, first moment of the episode, and return so far, by environment."""

    def add(self, rollout: JointRollout, rewards: Floats) -> tuple[list[View], list[float]]:
        """Return first moments and returns of the episodes that end, given the team's rewards (T, B)."""
        starts, returns, still_open = [], [], {}
        for b, (source, made) in enumerate(
            zip(map(tuple, rollout.source.tolist()), rollout.start, strict=True)
        ):
            reached, first, total = self.open.get(source, (-1, None, 0.0))
            if reached != made:
                first, total = (rollout.views[[0], [b]] if made == 0 else None), 0.0
            begin = 0
            for t in np.flatnonzero(rollout.reset[:, b]).tolist():
                if first is not None and not rollout.failed[t, b]:
                    starts.append(first)
                    returns.append(total + float(rewards[begin : t + 1, b].sum()))
                first, total, begin = rollout.views[[t + 1], [b]], 0.0, t + 1
            still_open[source] = int(made) + len(rewards), first, total + float(rewards[begin:, b].sum())
        self.open = still_open
        return starts, returns


class MAVENLearner(QMIXLearner):
    """QMIX's step with a mutual information, and a policy gradient of the latents."""

    def build(self) -> None:
        """Build modules, with no episode open."""
        super().build()
        self.episodes = EpisodeReturns()

    def update_joint(self, rollout: JointRollout) -> None:
        """Learn which latents pay from the episodes that ended, and values from replay."""
        alive, rewards = (to_tensor(x) for x in (rollout.views.alive[:-1], rollout.rewards))
        paid = self.config.reward_scale * team_reward(rewards, alive, self.config.team_reward)
        starts, returns = self.episodes.add(rollout, paid.numpy())
        if starts:
            first = JointView.of(self.spec, View.concat(starts, 0), self._device)
            self.improve_latents(first, torch.tensor(returns, device=self._device))
        super().update_joint(rollout)

    def improve_latents(self, first: JointView, returns: Tensor) -> None:
        """Follow grad log pi_z(z | s_0) R, and the entropy of z."""
        every = torch.ones_like(returns, dtype=torch.bool)
        moments = self.net(DISCRIMINATOR).moments
        moments.observe(returns, every)
        nets, views = [self.net(g.id) for g in self.groups], [first.view(g) for g in self.groups]
        policy = MAVENModule.latents(nets, views)
        log_prob = policy.log_prob(latent_of(first).argmax(-1))
        gain = self.mean(log_prob * moments.scaled(returns), every)
        entropy = self.mean(policy.entropy(), every)
        present = [group.id for group in self.groups if group.id not in first.absent]
        self.step_optimizer(-gain - self.config.latent_entropy * entropy, *present)
        self.log(DISCRIMINATOR, "latent_entropy", entropy)

    def penalty(self, batch: ReplayBatch, values: Mapping[str, Tensor]) -> Tensor:
        """Return -lambda_MI log q(z | sigma(tau)), which the discriminator and the agents' values descend."""
        discriminator = self.net(DISCRIMINATOR)
        seen = [discriminator.encoder(batch)]
        for group, own in batch.groups():
            ranked = values[group.id]
            if own.action_mask is not None:
                ranked = ranked.masked_fill(~own.action_mask, MASKED_LOGIT)
            seen.append((ranked.softmax(-1) * own.alive[..., None]).flatten(1))
        guess = discriminator.body(torch.cat(seen, -1)).log_softmax(-1)
        surprise = self.mean(-(guess * latent_of(batch)).sum(-1), batch.alive.any(-1))
        self.log(DISCRIMINATOR, "latent_surprise", surprise)
        return self.config.lambda_mi * surprise

    def trained(self) -> tuple[str, ...]:
        """Return the networks that the loss steps."""
        return (*super().trained(), DISCRIMINATOR)

    def _own_state(self) -> dict[str, Any]:
        return {**super()._own_state(), "episodes": self.episodes.open}

    def _set_own_state(self, state: dict[str, Any]) -> None:
        super()._set_own_state(state)
        self.episodes.open = dict(state["episodes"])


class MAVENConfig(QMIXConfig):
    """RLlib config of MAVEN."""

    algorithm = "maven"
    policy_module = MAVENModule
    team_modules: ClassVar = {MIXER: MAVENMixer, DISCRIMINATOR: Discriminator}
    network_settings = (*QMIXConfig.network_settings, "latents")

    def carried(self, block: AgentBlock) -> dict[str, Box]:
        """Return the leaves that the sampler adds: the episode's latent."""
        return {**super().carried(block), LATENT: Box(0.0, 1.0, (self.latents,), np.float32)}


class MAVEN(QMIX):
    """MAVEN."""

    config_class = MAVENConfig
    learner_class = MAVENLearner
