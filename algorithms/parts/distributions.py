"""How network outputs become actions: distributions for learners, heads for runners."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Protocol

import torch
from gymnasium.spaces import Box, Discrete
from torch import Generator, Tensor

from algorithms.parts.masking import MASKED_LOGIT
from algorithms.parts.noise import exponential


class Exploration(NamedTuple):
    """How runners deviate from greedy play during one fragment.

    Attributes:
        explore: False: greedy.
        epsilon: Probability of a uniformly random allowed action, for heads of values.
        noise: Standard deviation of Gaussian noise on actions in [-1, 1], for deterministic heads.
        temperature: Temperature of joint actions that are drawn by their weights: the smaller, the greedier.
    """

    explore: bool = True
    epsilon: float = 0.0
    noise: float = 0.0
    temperature: float = 1.0


class SampledActions(NamedTuple):
    """Actions of one block and where they came from.

    Attributes:
        actions: int64 (B, n), or float32 (B, n, k).
        log_prob: Log-probability (B, n) under the sampling distribution, or None if it has no density.
        distribution: What was sampled from, (B, n, A) probabilities, or (B, n, 2, k) mean and standard
            deviation.
        memory: What a recurrent policy takes along, (B, n, H), or None.
    """

    actions: Tensor
    log_prob: Tensor | None
    distribution: Tensor
    memory: Tensor | None = None


class CategoricalDistribution:
    """Choice among A actions; masked ones have probability zero. Logits (..., A), mask (..., A) or None."""

    def __init__(self, logits: Tensor, action_mask: Tensor | None = None) -> None:
        if action_mask is not None:
            logits = logits.masked_fill(~action_mask, MASKED_LOGIT)
        self.log_probs = torch.log_softmax(logits, -1)

    def log_prob(self, actions: Tensor) -> Tensor:
        """Return (...) log-probabilities of int64 actions (...)."""
        return self.log_probs.gather(-1, actions.unsqueeze(-1)).squeeze(-1)

    def entropy(self) -> Tensor:
        """Return (...) entropies."""
        return -(self.log_probs.exp() * self.log_probs).sum(-1)

    def divergence(self, other: CategoricalDistribution) -> Tensor:
        """Return (...) KL divergences of these choices from others."""
        return (self.log_probs.exp() * (self.log_probs - other.log_probs)).sum(-1)

    def sample(self, generator: Generator) -> Tensor:
        """Return (...) actions by the Gumbel-max trick."""
        return (self.log_probs - exponential(self.log_probs, generator).log()).argmax(-1)

    def mode(self) -> Tensor:
        """Return (...) most probable actions, the first of equals."""
        return self.log_probs.argmax(-1)


class FlooredDistribution(CategoricalDistribution):
    """(1 - epsilon) times a choice by logits plus epsilon times a uniform one among the allowed actions."""

    def __init__(self, logits: Tensor, action_mask: Tensor | None, epsilon: float) -> None:
        super().__init__(logits, action_mask)
        if not epsilon:
            return
        allowed = torch.ones_like(logits) if action_mask is None else action_mask.to(logits.dtype)
        uniform = allowed / allowed.sum(-1, keepdim=True).clamp(min=1)
        mixed = ((1 - epsilon) * self.log_probs.exp() + epsilon * uniform).clamp(min=1e-30).log()
        self.log_probs = mixed.masked_fill(allowed == 0, MASKED_LOGIT)


class GaussianDistribution:
    """Independent normal action components; mean and log standard deviation (..., k)."""

    def __init__(self, mean: Tensor, log_std: Tensor) -> None:
        self.mean, self.log_std = mean, log_std.clamp(-5, 2)

    def log_prob(self, actions: Tensor) -> Tensor:
        """Return (...) log-densities of unclipped actions (..., k)."""
        z = (actions - self.mean) * torch.exp(-self.log_std)
        return -(0.5 * z.square() + self.log_std + 0.5 * math.log(2 * math.pi)).sum(-1)

    def entropy(self) -> Tensor:
        """Return (...) entropies."""
        return (self.log_std + 0.5 * math.log(2 * math.pi * math.e)).sum(-1)

    def divergence(self, other: GaussianDistribution) -> Tensor:
        """Return (...) KL divergences of these actions from others."""
        change, ratio = other.log_std - self.log_std, torch.exp(2 * (self.log_std - other.log_std))
        apart = (self.mean - other.mean).square() * torch.exp(-2 * other.log_std)
        return (change + 0.5 * (ratio + apart - 1)).sum(-1)

    def sample(self, generator: Generator) -> Tensor:
        """Return (..., k) actions."""
        return self.mean + self.log_std.exp() * torch.empty_like(self.mean).normal_(generator=generator)


class Head(Protocol):
    """Network outputs to actions, for all agents of a block at once.

    Attributes:
        outputs: Width of the network's last layer.
        has_log_prob: Whether `act` returns log-probabilities.
    """

    outputs: int
    has_log_prob: bool

    def act(
        self, outputs: Tensor, action_mask: Tensor | None, exploration: Exploration, generator: Generator
    ) -> SampledActions:
        """Return the actions for outputs (B, n, P) and action masks (B, n, A) or None."""
        ...


class CategoricalHead:
    """Samples from logits; greedy play takes the mode."""

    has_log_prob = True

    def __init__(self, space: Discrete) -> None:
        self.outputs = int(space.n)

    def distribution(self, outputs: Tensor, action_mask: Tensor | None) -> CategoricalDistribution:
        """Return the policy."""
        return CategoricalDistribution(outputs, action_mask)

    def act(
        self, outputs: Tensor, action_mask: Tensor | None, exploration: Exploration, generator: Generator
    ) -> SampledActions:
        """Return sampled, or most probable, actions."""
        policy = self.distribution(outputs, action_mask)
        actions = policy.sample(generator) if exploration.explore else policy.mode()
        return SampledActions(actions, policy.log_prob(actions), policy.log_probs.exp())


class FlooredHead(CategoricalHead):
    """Samples each of A allowed actions with probability `epsilon` / A at least; greedy: the mode."""

    def act(
        self, outputs: Tensor, action_mask: Tensor | None, exploration: Exploration, generator: Generator
    ) -> SampledActions:
        """Return sampled, or most probable, actions."""
        policy = FlooredDistribution(outputs, action_mask, exploration.epsilon)
        actions = policy.sample(generator) if exploration.explore else policy.mode()
        return SampledActions(actions, policy.log_prob(actions), policy.log_probs.exp())


class GaussianHead:
    """Samples from a normal distribution; clipped only at the environment, so densities are exact."""

    has_log_prob = True

    def __init__(self, space: Box) -> None:
        self._k = math.prod(space.shape)
        self.outputs = 2 * self._k

    def distribution(self, outputs: Tensor, action_mask: Tensor | None = None) -> GaussianDistribution:
        """Return the policy."""
        mean, log_std = outputs.split(self._k, -1)
        return GaussianDistribution(mean, log_std)

    def act(
        self, outputs: Tensor, action_mask: Tensor | None, exploration: Exploration, generator: Generator
    ) -> SampledActions:
        """Return sampled actions, or the mean."""
        policy = self.distribution(outputs)
        actions = policy.sample(generator) if exploration.explore else policy.mean
        return SampledActions(
            actions, policy.log_prob(actions), torch.stack([policy.mean, policy.log_std.exp()], -2)
        )


class EpsilonGreedyHead:
    """Best allowed action by value, or with probability epsilon a uniformly random allowed one.

    Args:
        space: A `Discrete` space.
    """

    has_log_prob = False

    def __init__(self, space: Any) -> None:
        self.outputs = int(space.n)

    def act(
        self, outputs: Tensor, action_mask: Tensor | None, exploration: Exploration, generator: Generator
    ) -> SampledActions:
        """Return epsilon-greedy actions."""
        epsilon = exploration.epsilon if exploration.explore else 0.0
        allowed = torch.ones_like(outputs) if action_mask is None else action_mask.to(outputs.dtype)
        values = outputs if action_mask is None else outputs.masked_fill(~action_mask, MASKED_LOGIT)
        greedy = torch.zeros_like(outputs).scatter_(-1, values.argmax(-1, keepdim=True), 1.0)
        probabilities = (
            epsilon * allowed / allowed.sum(-1, keepdim=True).clamp(min=1) + (1 - epsilon) * greedy
        )
        if epsilon == 0:
            return SampledActions(greedy.argmax(-1), None, probabilities)
        drawn = (probabilities / exponential(probabilities, generator)).argmax(-1)
        return SampledActions(drawn, None, probabilities)


class BoltzmannHead(CategoricalHead):
    """Allowed actions with probability proportional to exp(value / temperature); greedy: the best."""

    def __init__(self, space: Discrete, temperature: float) -> None:
        super().__init__(space)
        self.temperature = temperature

    def distribution(self, outputs: Tensor, action_mask: Tensor | None) -> CategoricalDistribution:
        """Return the policy."""
        return super().distribution(outputs / self.temperature, action_mask)


class DeterministicHead:
    """A point in [-1, 1] by tanh, plus Gaussian noise while exploring."""

    has_log_prob = False

    def __init__(self, space: Box) -> None:
        self.outputs = math.prod(space.shape)

    def act(
        self, outputs: Tensor, action_mask: Tensor | None, exploration: Exploration, generator: Generator
    ) -> SampledActions:
        """Return noisy actions, clipped to [-1, 1]."""
        mean = outputs.tanh()
        scale = exploration.noise if exploration.explore else 0.0
        noise = scale * torch.empty_like(mean).normal_(generator=generator)
        return SampledActions(
            (mean + noise).clamp(-1, 1), None, torch.stack([mean, torch.full_like(mean, scale)], -2)
        )


def stochastic_head(space: Box | Discrete) -> CategoricalHead | GaussianHead:
    """Return the head of a sampled policy for the space."""
    return CategoricalHead(space) if isinstance(space, Discrete) else GaussianHead(space)
