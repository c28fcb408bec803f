"""Policy networks of a group, as RLlib modules, and the names of their companions."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Self

import numpy as np
import torch
from ray.rllib.core.rl_module.apis import InferenceOnlyAPI
from ray.rllib.core.rl_module.torch import TorchRLModule
from torch import Generator, Tensor, nn

from algorithms.joint.batch import GroupView
from algorithms.joint.env import MEMORY
from algorithms.joint.serving import STATE, answer
from algorithms.joint.spec import Group, JointSpec
from algorithms.parts.distributions import Exploration, Head, SampledActions, stochastic_head
from algorithms.parts.memory import GRUMemory
from algorithms.parts.networks import Encoder, orthogonal, perceptron


def critic_of(group: Group) -> str:
    """Return the module id of a group's critic or value network."""
    return f"{group.id}__critic"


class ConfiguredModule(TorchRLModule):
    """A network that a `JointConfig` describes.

    Attributes:
        targets: Names of attributes that are target networks: `target_x` is a copy of `x` (learner only, no
            gradient), made after `make_networks` if that has not made it.
    """

    targets: tuple[str, ...] = ()
    joins: Literal["", "observations", "state"] = ""
    """What it reads of all agents side by side, so that none may observe images: their observations, or the
    environment's state, in whose place are the observations where there is none."""
    group: Any
    """The `Group` of the agents; None for all agents."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Do without `feedforward_parts` where a class has another `policy` or `value` than those are of."""
        super().__init_subclass__(**kwargs)
        own = vars(cls)
        if ("policy" in own or "value" in own) and "feedforward_parts" not in own:
            cls.feedforward_parts = ConfiguredModule.feedforward_parts

    def feedforward_parts(self) -> tuple[Encoder, nn.Module] | None:
        """Return (encoder, body) if the network is just `body(encoder(...))`, so that it may be stacked."""
        return None

    def read_config(self) -> None:
        """Read the model config, which a `JointConfig` has made."""
        config: Any = self.model_config
        self.spec: JointSpec = config["spec"]
        self.group = next((g for g in self.spec.groups if g.id == config["group"]), None)
        self.settings: Mapping[str, Any] = config["settings"]

    def make_networks(self) -> None:
        """Create the networks, but for targets."""
        raise NotImplementedError

    def make_targets(self) -> None:
        """Copy the networks that targets follow."""
        for name in self.targets:
            if not hasattr(self, name):
                original = getattr(self, name.removeprefix("target_"))
                setattr(self, name, copy.deepcopy(original).requires_grad_(False))

    def trained_parameters(self) -> list[nn.Parameter]:
        """Return the parameters that optimisers step: all but the target networks'."""
        return [p for name, p in self.named_parameters() if name.split(".")[0] not in self.targets]


class JointModule(ConfiguredModule, InferenceOnlyAPI):
    """A policy shared by the n agents of a group.

    `model_config` carries `spec` (JointSpec), `group` (Group id, or None for modules of all agents) and
    `settings` (whatever the algorithm's config hands over).

    Attributes:
        head: How outputs become actions.
        communicates: Whether agents hear those of other groups, so that `policies` needs all groups at once.
        acts_jointly: Whether actions depend on other agents' actions of the same step: see `act_jointly`.
        memory_size: Width H of a recurrent policy's memory, 0 for a policy without.
        exploration: How the runner explores, for those that ask the module itself.
    """

    communicates: bool = False
    acts_jointly: bool = False
    head: Head

    def setup(self) -> None:
        """Read the model config and build the networks."""
        self.read_config()
        self.memory_size = int(np.prod(self.group.observation[MEMORY].shape)) if self.recurrent else 0
        self.exploration: Exploration = self.model_config.get("exploration", Exploration())
        self.head = self.make_head()
        self.make_networks()
        self.make_targets()

    @property
    def recurrent(self) -> bool:
        """Whether the sampler carries a memory for this policy."""
        return MEMORY in self.group.observation

    def make_head(self) -> Head:
        """Return how outputs become actions."""
        return stochastic_head(self.group.action)

    def make_networks(self) -> None:
        """Create `encoder` and `body`; the default policy is `body(encoder(observations))`.

        A recurrent policy is `body(memory(trunk(encoder(observations))))`.
        """
        self.encoder = encoder_of(self.group)
        sizes = [self.encoder.size, *self.settings["hidden"]]
        if self.memory_size:
            self.trunk = orthogonal(perceptron(sizes), gain=np.sqrt(2), last=np.sqrt(2)).append(nn.Tanh())
            self.memory = GRUMemory(sizes[-1], self.memory_size)
            sizes = [self.memory_size]
        body = perceptron([*sizes, self.head.outputs])
        self.body: nn.Module = orthogonal(body, gain=np.sqrt(2), last=0.01)

    def policy(self, view: GroupView) -> Tensor:
        """Return the outputs (M, n, P) that the head turns into actions."""
        return (
            self.forward_recurrent(view)[0]
            if self.memory_size
            else self.body(self.encoder(view.observations))
        )

    def forward_recurrent(self, view: GroupView) -> tuple[Tensor, Tensor]:
        """Return a recurrent policy's (outputs, memory afterwards) of moments, or of sequences of moments."""
        features = self.trunk(self.encoder(view.observations))
        memory = self.memory(features, view.observations[MEMORY], view.fresh, view.length)
        return self.body(memory), memory

    @classmethod
    def policies(cls, modules: Sequence[Self], views: Sequence[GroupView]) -> list[Tensor]:
        """Return each group's outputs (M, n, P); the slot of agents that communicate."""
        return [module.policy(view) for module, view in zip(modules, views, strict=True)]

    @classmethod
    def begin_episode(
        cls, modules: Sequence[Self], views: Sequence[GroupView], generator: Generator
    ) -> list[Tensor]:
        """Return each group's latents (K, n, *shape) for K episodes that begin with these views.

        Called where the config's `carried` declares the leaf `LATENT`, which shows an agent its latent in
        every step of the episode, and which rollouts, replay and learners hold as they hold observations. All
        random numbers come from the generator, which is the episode's own.
        """
        raise NotImplementedError(f"{cls.__name__} draws no latents, which its config declares")

    @classmethod
    def act_jointly(
        cls,
        modules: Sequence[Self],
        views: Sequence[GroupView],
        exploration: Exploration,
        generator: Generator,
    ) -> list[SampledActions]:
        """Return each group's actions, drawn together: of agents that `acts_jointly`.

        An agent's actions may depend on those that other agents take in this step. `log_prob` (B, n) is each
        agent's share of the joint log-probability: its sum over agents is that of the joint action.
        """
        raise NotImplementedError(f"{cls.__name__} samples agents one by one")

    def feedforward_parts(self) -> tuple[Encoder, nn.Module] | None:
        """Return (encoder, body) if the policy is just `body(encoder(...))`, so that runners may stack it."""
        return None if self.memory_size else (self.encoder, self.body)

    def get_non_inference_attributes(self) -> list[str]:
        """Return the attributes that runners do not hold (RLlib)."""
        return list(self.targets)

    def get_initial_state(self) -> dict[str, Tensor]:
        """Return the empty memory (H,) of a recurrent policy, nothing of others (RLlib)."""
        return {STATE: torch.zeros(self.memory_size)} if self.memory_size else {}

    def _forward_inference(self, batch: Mapping[str, Any], **kwargs: Any) -> dict[str, Any]:
        """Return greedy actions of single agents (RLlib); see `answer`."""
        with torch.no_grad():
            return answer(self, batch, Exploration(explore=False))

    def _forward_exploration(self, batch: Mapping[str, Any], **kwargs: Any) -> dict[str, Any]:
        """Return actions of single agents that explore as the runner does (RLlib); see `answer`."""
        with torch.no_grad():
            return answer(self, batch, self.exploration._replace(explore=True))


class LearnerModule(ConfiguredModule):
    """A network that only learners hold: a critic, a mixer. See `JointModule` for `model_config`."""

    def setup(self) -> None:
        """Read the model config and build the networks."""
        self.read_config()
        self.make_networks()
        self.make_targets()


def encoder_of(group: Group) -> Encoder:
    """Return a new encoder of what a group's agents see, without their memory."""
    seen = {name: leaf for name, leaf in group.observation.items() if name != MEMORY}
    return Encoder(seen, group.places, group.set_width)
