"""What all agents see as one vector: the input of joint critics, mixers and central values."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import torch
from torch import Tensor, nn

from algorithms.joint.batch import JointView
from algorithms.joint.env import columns_of
from algorithms.joint.spec import JointSpec
from algorithms.parts.networks import Encoder


class JointEncoder(nn.Module):
    """The environment's state, or each agent's observation and whether it is active, as a vector.

    Sets among the observations are encoded as policies encode them (`set_width`), by one network for all
    agents of equal spaces; other observations stand side by side. Absent agents contribute zeros.

    Args:
        spec: Agents and spaces.
        state: False: encode observations although the environment has a state.
        without: Names of leaves to ignore.
    """

    def __init__(self, spec: JointSpec, *, state: bool = True, without: Collection[str] = ()) -> None:
        super().__init__()
        self._reads_state = state and spec.spaces.state > 0
        self._without, self._columns = frozenset(without), columns_of(spec.spaces.blocks)
        width = spec.groups[0].set_width
        blocks = [{k: s for k, s in b.observation.items() if k not in without} for b in spec.spaces.blocks]
        encoders = [Encoder(observation, set_width=width) for observation in blocks]
        joint = sum(len(b.agents) * e.size for b, e in zip(spec.spaces.blocks, encoders, strict=True))
        self.size = spec.spaces.state if self._reads_state else joint + len(spec.agents)
        """Numbers S in the vector."""
        self.blocks = nn.ModuleList(encoders if width and not self._reads_state else ())

    def forward(self, view: JointView) -> Tensor:
        """Return vectors (..., S)."""
        if self._without:
            kept = tuple(
                {name: leaf for name, leaf in leaves.items() if name not in self._without}
                for leaves in view.observations
            )
            view = replace(view, observations=kept)
        if not self.blocks:
            return view.global_state() if self._reads_state else view.everything
        seen = [
            (encoder(leaves) * view.alive[..., columns, None]).flatten(-2)
            for encoder, leaves, columns in zip(self.blocks, view.observations, self._columns, strict=True)
        ]
        return torch.cat([*seen, view.alive.float()], -1)
