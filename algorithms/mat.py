"""Multi-agent transformer (MAT): one network maps all observations to all actions, agent after agent.

Wen et al. 2022, "Multi-Agent Reinforcement Learning is a Sequence Modeling Problem". An encoder attends to
all agents' observations; its representations give the values V(o_i) and go to a decoder, whose masked
attention shows agent i what the agents before it do in this step:

    pi(a | o) = prod_i pi(a_i | o_1..o_n, a_1..a_{i-1}).

Agents act one after another; learning evaluates all of them at once, since their actions are known by then.
The network takes PPO's clipped steps on each agent's conditional probability (the paper's loss of the
decoder) and fits the values (that of the encoder). Its layers, the one step on the sum of both losses and the
order, that of the agents, are those of the authors' code (PKU-MARL/Multi-Agent-Transformer). A block:
attention, sum, layer normalisation, perceptron, sum, layer normalisation. What enters the blocks, and what
follows them, is normalised, too.

Deviations, where "the code" is the authors':

- Each agent's advantage is of its own reward and value, as in the code, where the paper's agents share one of
  the team, from the mean of their values.
- The encoder reads observations with one-hot places; the code normalises observations.
- The blocks begin with larger weights than the code's, whose attention is near zero then.
- The values' errors are squared; the code has Huber's loss, clipped as the policy's ratio is.
- Continuous actions are embedded as discrete ones are; the code gives the first agent zeros, and a bias.
- Agents that are not active are heard neither by the encoder nor by the decoder; the code leaves them out of
  the losses only. An agent that is asked alone decides as the only active one.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Generator, Tensor, nn

from algorithms.errors import SpaceError
from algorithms.joint.batch import GroupView, JointView, OnPolicyBatch, encode
from algorithms.joint.module import JointModule
from algorithms.joint.spec import JointSpec, action_size
from algorithms.parts.attention import MultiHeadAttention
from algorithms.parts.distributions import Exploration, SampledActions
from algorithms.parts.moments import RunningMoments
from algorithms.parts.networks import Encoder, orthogonal, perceptron
from algorithms.ppo import PPO, PPOConfig, PPOLearner


def head(width: int, outputs: int, last: float) -> nn.Sequential:
    """Return the layers that follow the last block."""
    layers = [nn.Linear(width, width), nn.GELU(), nn.LayerNorm(width), nn.Linear(width, outputs)]
    return orthogonal(nn.Sequential(*layers), gain=2**0.5, last=last)


class EncoderBlock(nn.Module):
    """Representations that attend to each other."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.attention = MultiHeadAttention(width, heads)
        self.body = perceptron([width, width, width], nn.GELU)
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(2))

    def forward(self, x: Tensor, heard: Tensor) -> Tensor:
        """Return the next representations (M, n, H)."""
        x = self.norms[0](x + self.attention(x, x, heard))
        return self.norms[1](x + self.body(x))


class DecoderBlock(nn.Module):
    """Actions that attend to earlier ones, and representations that attend to these."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.actions = MultiHeadAttention(width, heads)
        self.agents = MultiHeadAttention(width, heads)
        self.body = perceptron([width, width, width], nn.GELU)
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(3))

    def forward(self, x: Tensor, represented: Tensor, heard: Tensor) -> Tensor:
        """Return the next embeddings (M, n, H)."""
        x = self.norms[0](x + self.actions(x, x, heard))
        x = self.norms[1](represented + self.agents(represented, x, heard))
        return self.norms[2](x + self.body(x))


class MATModule(JointModule):
    """Encoder, decoder and values of all agents."""

    acts_jointly = True

    def make_networks(self) -> None:
        """Create all layers."""
        width, heads = self.settings["hidden"][-1], self.settings["attention_heads"]
        blocks = range(self.settings["blocks"])
        self.see = Encoder(self.group.observation, self.group.places, self.group.set_width)
        self.first = nn.Sequential(nn.Linear(self.see.size, width), nn.GELU(), nn.LayerNorm(width))
        self.encoder = nn.ModuleList(EncoderBlock(width, heads) for _ in blocks)
        taken = nn.Linear(1 + action_size(self.group.action), width, bias=False)
        self.act = nn.Sequential(taken, nn.GELU(), nn.LayerNorm(width))
        self.decoder = nn.ModuleList(DecoderBlock(width, heads) for _ in blocks)
        self.last = head(width, self.head.outputs, last=0.01)
        self.baseline = head(width, 1, last=1)
        self.moments = RunningMoments(enabled=self.settings["normalize_values"])

    def represent(self, view: GroupView) -> Tensor:
        """Return the encoder's representations (M, n, H)."""
        x = self.first(self.see(view.observations))
        for block in self.encoder:
            x = block(x, _heard(view.alive))
        return x

    def value(self, represented: Tensor) -> Tensor:
        """Return scaled values (M, n)."""
        return self.baseline(represented).squeeze(-1)

    def decide(self, represented: Tensor, actions: Tensor, alive: Tensor) -> Tensor:
        """Return the outputs (M, n, P) of every agent, given the actions of the agents before it.

        Args:
            represented: (M, n, H).
            actions: Actions as critics see them, (M, n, A); an agent's own and those after it have no effect.
            alive: (M, n).
        """
        # Place i holds the action of agent i - 1, the first a one before all; zeros stand for absent agents.
        there = alive[..., None]
        before = nn.functional.pad((actions * there)[:, :-1], (1, 0, 1, 0))
        before[:, 0, 0] = 1
        x, represented = self.act(before), represented * there
        heard = _heard(nn.functional.pad(alive[:, :-1], (1, 0), value=True)).tril()
        for block in self.decoder:
            x = block(x, represented, heard)
        return self.last(x)

    @classmethod
    def act_jointly(
        cls,
        modules: Sequence[MATModule],  # type: ignore[override]
        views: Sequence[GroupView],
        exploration: Exploration,
        generator: Generator,
    ) -> list[SampledActions]:
        """Return the actions of all agents, drawn one after another."""
        (net,), (view,) = modules, views
        represented = net.represent(view)
        known = represented.new_zeros(*view.alive.shape, action_size(net.group.action))
        drawn: list[SampledActions] = []
        for i in range(view.alive.shape[1]):
            agent = slice(i, i + 1)
            outputs = net.decide(represented, known, view.alive)[:, agent]
            mask = None if view.action_mask is None else view.action_mask[:, agent]
            drawn.append(net.head.act(outputs, mask, exploration, generator))
            known[:, agent] = encode(net.group, drawn[-1].actions)
        columns = zip(*((each.actions, each.log_prob, each.distribution) for each in drawn), strict=True)
        return [SampledActions(*(torch.cat(parts, 1) for parts in columns))]

    def policy(self, view: GroupView) -> Tensor:
        """Raise: agents act together (`act_jointly`)."""
        raise NotImplementedError("agents of 'mat' act one after another: see act_jointly")

    def get_non_inference_attributes(self) -> list[str]:
        """Return the attributes that runners do not hold (RLlib)."""
        return ["baseline", "moments"]


def _heard(alive: Tensor) -> Tensor:
    """Return which places attend to which, (M, n, n): to themselves, and to active ones."""
    return alive.unsqueeze(-2) | torch.eye(alive.shape[-1], dtype=torch.bool, device=alive.device)


class MATLearner(PPOLearner):
    """One step of the whole network on the losses of decoder and encoder."""

    def values(self, view: JointView) -> Tensor:
        """Return each agent's value of all observations, (M, N)."""
        (group,) = self.groups
        net = self.net(group.id)
        return net.moments.unscaled(net.value(net.represent(view.view(group))))

    def observe_targets(self, batch: OnPolicyBatch) -> None:
        """Adapt the scale of values."""
        (group,) = self.groups
        if group.id not in self.frozen:
            self.net(group.id).moments.observe(batch.targets, batch.alive)

    def update_minibatch(self, batch: OnPolicyBatch) -> None:
        """Take one step on the sum of policy, value and entropy losses."""
        if batch.absent:
            return
        ((group, own),) = batch.groups()
        net = self.net(group.id)
        represented = net.represent(own)
        outputs = net.decide(represented, batch.encoded_actions()[group.id], own.alive)
        policy = net.head.distribution(outputs, own.action_mask)
        log_prob = torch.where(own.alive, policy.log_prob(own.actions), own.log_prob)
        reports = {
            "policy_loss": self.policy_loss(log_prob, own.log_prob, own.advantages),
            "value_loss": (net.value(represented) - net.moments.scaled(own.targets)).square(),
            "entropy": policy.entropy(),
            **self.change(log_prob, own.log_prob),
        }
        means = {name: self.mean(each, own.alive) for name, each in reports.items()}
        weight = self.schedule_value(self.config.entropy_coeff)
        fit = self.config.value_coeff * means["value_loss"]
        self.step_optimizer(means["policy_loss"] + fit - weight * means["entropy"], group.id)
        for name, mean in means.items():
            self.log(group.id, name, mean)


class MATConfig(PPOConfig):
    """RLlib config of MAT."""

    algorithm = "mat"
    policy_module, critic_module = MATModule, None
    network_settings = (*PPOConfig.network_settings, "blocks", "attention_heads")

    def check(self, spec: JointSpec) -> None:
        """Raise if the algorithm cannot handle the environment; see `JointConfig.check`.

        Raises:
            SpaceError: Agents have different spaces.
        """
        super().check(spec)
        if len(spec.groups) > 1:
            raise SpaceError(
                f"{self.algorithm!r} is one network of all agents, but {spec.groups[0].agents[0]!r} and "
                f"{spec.groups[1].agents[0]!r} have different spaces or networks",
                place="observation and action spaces",
                remedy="give all agents equal spaces and sharing='all', or use 'centralised_v'",
            )


class MAT(PPO):
    """MAT."""

    config_class = MATConfig
    learner_class = MATLearner
