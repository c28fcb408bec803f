"""The policies of all groups acting together: a view in, actions of every block out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import torch
from torch import Generator, Tensor, nn

from algorithms.joint.batch import GroupView
from algorithms.joint.module import JointModule
from algorithms.joint.rollout import View
from algorithms.joint.spec import Group, JointSpec
from algorithms.parts.distributions import Exploration, SampledActions
from algorithms.parts.networks import PlacedPerceptron, StackedPerceptrons


class Policies:
    """The policy networks of all groups, evaluated together.

    Where every agent of a block has its own plain perceptron, these are stacked into one batched product;
    sampling happens once per block in any case.
    """

    def __init__(self, spec: JointSpec, modules: Mapping[str, JointModule]) -> None:
        self._spec = spec
        self._modules = modules
        self._by_block = [[g for g in spec.groups if g.block == k] for k in range(len(spec.spaces.blocks))]
        self._stacked: list[Callable[[Mapping[str, Tensor]], Tensor] | None] = []
        self.refresh()

    @property
    def has_log_prob(self) -> bool:
        """Whether every policy has a density."""
        return all(module.head.has_log_prob for module in self._modules.values())

    def refresh(self) -> None:
        """Take over changed weights."""
        with torch.no_grad():
            self._stacked = [self._stack([self._modules[g.id] for g in groups]) for groups in self._by_block]

    def act(self, view: View, exploration: Exploration, generator: Generator) -> list[SampledActions]:
        """Return one `SampledActions` per block for a view with leading axis (B,)."""
        with torch.inference_mode():
            return [self._act(k, view, exploration, generator) for k in range(len(self._by_block))]

    def _act(self, block: int, view: View, exploration: Exploration, generator: Generator) -> SampledActions:
        leaves = {name: torch.from_numpy(leaf) for name, leaf in view.observations[block].items()}
        mask = view.masks[block]
        action_mask = None if mask is None else torch.from_numpy(mask)
        groups = self._by_block[block]
        first = self._modules[groups[0].id]
        stacked = self._stacked[block]
        if stacked is not None:
            outputs = stacked(leaves)
        elif first.memory_size:
            recalled = [self._modules[g.id].forward_recurrent(_seen_by(g, view)) for g in groups]
            outputs, memory = (self._in_columns(block, parts) for parts in zip(*recalled, strict=True))
            return first.head.act(outputs, action_mask, exploration, generator)._replace(memory=memory)
        else:
            outputs = self._gather(block, view)
        return first.head.act(outputs, action_mask, exploration, generator)

    def _gather(self, block: int, view: View) -> Tensor:
        """Return (B, n, P): each group's outputs in the columns of its agents."""
        own = self._by_block[block]
        kind = type(self._modules[own[0].id])
        groups = self._spec.groups if kind.communicates else own
        outputs = kind.policies([self._modules[g.id] for g in groups], [_seen_by(g, view) for g in groups])
        return self._in_columns(
            block, [part for group, part in zip(groups, outputs, strict=True) if group.block == block]
        )

    def _in_columns(self, block: int, parts: Sequence[Tensor]) -> Tensor:
        """Return the parts (B, n, ...) of a block's groups in the order of its agents."""
        if len(parts) == 1:
            return parts[0]
        own, joined = self._by_block[block], torch.cat(list(parts), 1)
        places = np.concatenate([np.arange(joined.shape[1])[group.within] for group in own])
        return joined[:, torch.from_numpy(np.argsort(places))]

    @staticmethod
    def _stack(modules: list[JointModule]) -> Callable[[Mapping[str, Tensor]], Tensor] | None:
        """Return what maps the leaves of a block to outputs (B, n, P) in few steps, if that can be."""
        plain = [parts for module in modules if (parts := module.feedforward_parts())]
        bodies = [body for _, body in plain if isinstance(body, nn.Sequential)]
        if not bodies or len(bodies) < len(modules) or not StackedPerceptrons.fits(bodies):
            return None
        encoder = plain[0][0]
        if len(modules) == 1:
            return PlacedPerceptron(encoder, bodies[0]) if encoder.places else None
        if any(module.group.size > 1 for module in modules) or not all(e.is_plain for e, _ in plain):
            return None
        perceptrons = StackedPerceptrons(bodies)
        return lambda leaves: perceptrons(encoder(leaves))


def _seen_by(group: Group, view: View) -> GroupView:
    leaves, mask = view.observations[group.block], view.masks[group.block]
    return GroupView(
        {name: torch.from_numpy(leaf)[:, group.within] for name, leaf in leaves.items()},
        torch.from_numpy(view.alive)[:, group.columns],
        None if mask is None else torch.from_numpy(mask)[:, group.within],
    )
