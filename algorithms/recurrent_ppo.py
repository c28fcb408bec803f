"""PPO whose policies and critics both have memories: recurrent IPPO, and recurrent MAPPO.

Yu et al. 2022, "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games", with recurrent
networks: an agent's value is body(memory(trunk(x))), with a memory besides the policy's, which is empty where
the agent's trajectory begins. In IPPO x is the agent's observation, in MAPPO the global state and the agent's
number. Policies and losses are those of `ppo` and `centralised_v` with `gru`, whose critics have no memory.

Runners hold no critics, so the learner unrolls their memories over each rollout, from where they were at the
end of the environment's last one. Minibatches hold sequences, each of which begins with the memory that was
found there before the update (Kapturowski et al. 2019).

Deviations: those of `ppo` and `centralised_v`; in MAPPO the critic tells agents apart by a number that its
trunk sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from algorithms.centralised_v import CRITIC, CentralisedV, CentralisedVConfig, CentralisedVLearner
from algorithms.joint.batch import GroupView, JointView, OnPolicyBatch, to_tensor
from algorithms.joint.env import MEMORY
from algorithms.joint.joint_encoder import JointEncoder
from algorithms.joint.module import LearnerModule, critic_of, encoder_of
from algorithms.joint.rollout import JointRollout, View
from algorithms.parts.memory import GRUMemory
from algorithms.parts.moments import RunningMoments
from algorithms.parts.networks import orthogonal, perceptron
from algorithms.ppo import PPO, PPOConfig, PPOLearner

CRITIC_MEMORY = "@critic_memory"
"""Leaf that the learner adds to the observations of a rollout: the critic's memory before each of them."""


class RecurrentValue(LearnerModule):
    """V of what an agent has seen since its trajectory began."""

    def make_networks(self) -> None:
        """Create trunk, memory and body."""
        hidden, size = self.settings["hidden"], self.settings["gru"]
        sizes = [self.make_features(), *hidden]
        self.trunk = orthogonal(perceptron(sizes), gain=np.sqrt(2), last=np.sqrt(2)).append(nn.Tanh())
        self.memory = GRUMemory(sizes[-1], size)
        self.body = orthogonal(perceptron([size, 1]), gain=np.sqrt(2), last=1)
        self.moments = RunningMoments(enabled=self.settings["normalize_values"])

    def make_features(self) -> int:
        """Create what makes features, and return their width."""
        raise NotImplementedError

    def features(self, view: Any) -> Tensor:
        """Return what the memory's trunk reads, (M, n, d)."""
        raise NotImplementedError

    def start(self, view: Any) -> Tensor:
        """Return the memories before each row, (M, n, H)."""
        raise NotImplementedError

    def recall(self, view: Any) -> Tensor:
        """Return the memories after each row, (M, n, H)."""
        return self.memory(self.trunk(self.features(view)), self.start(view), view.fresh, view.length)

    def value(self, view: Any) -> Tensor:
        """Return scaled values (M, n) of moments, or of sequences of moments."""
        return self.body(self.recall(view)).squeeze(-1)


class RecurrentLocalValue(RecurrentValue):
    """V(o_i) of a group's agents."""

    def make_features(self) -> int:
        """Create the encoder."""
        self.encoder = encoder_of(self.group)
        return self.encoder.size

    def features(self, view: GroupView) -> Tensor:
        """Return encoded observations."""
        return self.encoder(view.observations)

    def start(self, view: GroupView) -> Tensor:
        """Return the memories before each row."""
        return view.observations[CRITIC_MEMORY]


class RecurrentCentralValue(RecurrentValue):
    """V_i(s) of all N agents."""

    joins = "state"

    def make_features(self) -> int:
        """Return the width of the state and the agents' numbers."""
        self.encoder = JointEncoder(self.spec, without=(MEMORY, CRITIC_MEMORY))
        return self.encoder.size + len(self.spec.agents)

    def features(self, view: JointView) -> Tensor:
        """Return the state with each agent's number."""
        state = self.encoder(view).unsqueeze(-2)
        numbers = torch.eye(view.alive.shape[-1], device=state.device)
        rows = (*view.alive.shape, -1)
        return torch.cat([state.expand(rows), numbers.expand(rows)], -1)

    def start(self, view: JointView) -> Tensor:
        """Return the memories before each row."""
        return torch.cat([leaves[CRITIC_MEMORY] for leaves in view.observations], -2)


class CriticMemories:
    """The critics' memories at the end of each environment's last rollout."""

    def __init__(self) -> None:
        self._held: dict[tuple[int, ...], Tensor] = {}

    def before(self, rollout: JointRollout, like: Tensor) -> Tensor:
        """Return (B, N, H): the memories before a rollout, empty where it does not continue the last one."""
        empty = torch.zeros_like(like)
        return torch.stack([self._held.get(key, empty) for key in _keys(rollout, rollout.start)])

    def hold(self, rollout: JointRollout, memories: Tensor) -> None:
        """Take the memories (B, N, H) with which the next rollout begins."""
        ends = rollout.start + len(rollout.rewards)
        self._held = dict(zip(_keys(rollout, ends), memories.clone(), strict=True))

    def get_state(self) -> dict[tuple[int, ...], np.ndarray]:
        """Return the memories by environment and step."""
        return {key: memory.cpu().numpy() for key, memory in self._held.items()}

    def set_state(self, state: Mapping[tuple[int, ...], np.ndarray], device: Any) -> None:
        """Restore what `get_state` gave."""
        self._held = {key: to_tensor(memory, device) for key, memory in state.items()}


def _keys(rollout: JointRollout, steps: np.ndarray) -> list[tuple[int, ...]]:
    return [(*source, step) for source, step in zip(rollout.source.tolist(), steps.tolist(), strict=True)]


class RecurrentPPOLearner(PPOLearner):
    """PPO with local critics that have memories."""

    def build(self) -> None:
        """Build modules, with empty memories."""
        super().build()
        self.memories = CriticMemories()

    def prepare(self, rollout: JointRollout) -> OnPolicyBatch:
        """Return the batch, with the critics' memories before each row as a leaf of the observations."""
        return super().prepare(self.remember(rollout))

    @torch.no_grad()
    def remember(self, rollout: JointRollout) -> JointRollout:
        """Return the rollout with the critics' memories; those after its last step are held for the next."""
        device, masks = self._device, rollout.masks()
        steps, envs, agents = JointView.of(self.spec, rollout.views, device).alive.shape
        first = self.memories.before(rollout, torch.zeros(agents, self.config.gru, device=device))
        flat = replace(
            JointView.of(
                self.spec, _with_memories(rollout.views, first.expand(steps, -1, -1, -1)), device
            ).flat(),
            fresh=to_tensor(masks.fresh, device).flatten(0, 1),
            length=steps,
        )
        after = self.recall(flat).unflatten(0, (steps, envs))
        following = torch.where(to_tensor(masks.chain, device)[..., None], after[:-1], 0)
        before = torch.cat([first[None], following])
        self.memories.hold(rollout, before[-1])
        at = torch.as_tensor(rollout.final_at, device=device)
        return replace(
            rollout,
            views=_with_memories(rollout.views, before),
            final=_with_memories(rollout.final, after[at[:, 0], at[:, 1]]),
        )

    def recall(self, view: JointView) -> Tensor:
        """Return the critics' memories (M, N, H) after each row."""
        return view.join({g.id: self.net(critic_of(g)).recall(view.view(g)) for g in self.groups})

    def _own_state(self) -> dict[str, Any]:
        return {**super()._own_state(), "critic_memories": self.memories.get_state()}

    def _set_own_state(self, state: dict[str, Any]) -> None:
        super()._set_own_state(state)
        self.memories.set_state(state["critic_memories"], self._device)


def _with_memories(view: View, memories: Tensor) -> View:
    """Return the view with the memories (..., N, H) as leaves of the agents' observations."""
    parts = memories.cpu().numpy()
    widths = [next(iter(leaves.values())).shape[view.alive.ndim - 1] for leaves in view.observations]
    ends = np.cumsum(widths).tolist()
    return replace(
        view,
        observations=tuple(
            {**leaves, CRITIC_MEMORY: parts[..., end - width : end, :]}
            for leaves, width, end in zip(view.observations, widths, ends, strict=True)
        ),
    )


class RecurrentMAPPOLearner(RecurrentPPOLearner, CentralisedVLearner):
    """PPO with a central critic that has a memory for each agent."""

    def recall(self, view: JointView) -> Tensor:
        """Return the critic's memories (M, N, H) after each row."""
        return self.net(CRITIC).recall(view)


class RecurrentIPPOConfig(PPOConfig):
    """RLlib config of recurrent IPPO."""

    algorithm = "recurrent_ippo"
    critic_module = RecurrentLocalValue
    network_settings = (*PPOConfig.network_settings, "gru")


class RecurrentMAPPOConfig(RecurrentIPPOConfig, CentralisedVConfig):
    """RLlib config of recurrent MAPPO."""

    algorithm = "recurrent_mappo"
    critic_module = None
    team_modules: ClassVar = {CRITIC: RecurrentCentralValue}


class RecurrentIPPO(PPO):
    """Recurrent IPPO."""

    config_class = RecurrentIPPOConfig
    learner_class = RecurrentPPOLearner


class RecurrentMAPPO(CentralisedV):
    """Recurrent MAPPO."""

    config_class = RecurrentMAPPOConfig
    learner_class = RecurrentMAPPOLearner
