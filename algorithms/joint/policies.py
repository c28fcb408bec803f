"""The policies of all groups together: they map a `View` to the actions of every block."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Generator, Tensor, nn

from algorithms.joint.batch import GroupView, JointView
from algorithms.joint.module import JointModule
from algorithms.joint.rollout import View
from algorithms.joint.spec import Group, JointSpec
from algorithms.parts.distributions import Exploration, SampledActions
from algorithms.parts.networks import PlacedPerceptron, StackedPerceptrons


class Policies:
    """The policy networks of all groups, evaluated together.

    A block is agents with equal spaces; a group is agents of a block that share one network.

    Where every agent of a block has its own plain perceptron, these are stacked into one batched product;
    sampling happens once per block in any case.
    """

    def __init__(self, spec: JointSpec, modules: Mapping[str, JointModule]) -> None:
        self._spec = spec
        self._modules = modules
        self._by_block = [[g for g in spec.groups if g.block == k] for k in range(len(spec.spaces.blocks))]
        self._acts_jointly = any(module.acts_jointly for module in modules.values())
        self._stacked: list[Callable[[Mapping[str, Tensor]], Tensor] | None] = []
        self.refresh()

    @property
    def has_log_prob(self) -> bool:
        """Whether every policy has a density."""
        return all(module.head.has_log_prob for module in self._modules.values())

    def refresh(self) -> None:
        """Rebuild the stacked networks after a change of weights."""
        with torch.no_grad():
            self._stacked = [self._stack([self._modules[g.id] for g in groups]) for groups in self._by_block]

    def begin_episode(self, view: View, generator: Generator) -> list[Tensor]:
        """Return the latents (K, n, ...) of each block for K episodes that begin with this view."""
        with torch.inference_mode():
            modules, views = self._modules_and_views(view)
            return self._concat_by_block(type(modules[0]).begin_episode(modules, views, generator))

    def act(self, view: View, exploration: Exploration, generator: Generator) -> list[SampledActions]:
        """Return one `SampledActions` per block for a view with leading axis (B,)."""
        with torch.inference_mode():
            if self._acts_jointly:
                modules, views = self._modules_and_views(view)
                drawn = type(modules[0]).act_jointly(modules, views, exploration, generator)
                fields = [self._concat_by_block(list(parts)) for parts in zip(*drawn, strict=True)]
                return [SampledActions(*parts) for parts in zip(*fields, strict=True)]
            return [self._act(k, view, exploration, generator) for k in range(len(self._by_block))]

    def _modules_and_views(self, view: View) -> tuple[list[JointModule], list[GroupView]]:
        """Return the networks of all groups, and what their agents see."""
        groups = self._spec.groups
        return [self._modules[g.id] for g in groups], self._views(view, groups)

    def _views(self, view: View, groups: Sequence[Group]) -> list[GroupView]:
        """Return what the agents of some groups see."""
        every = JointView.of(self._spec, view)
        return [every.view(group) for group in groups]

    def _concat_by_block(self, parts: Sequence[Any]) -> list[Any]:
        """Concatenate the tensors (B, n, ...) of all groups per block; None where groups have none."""
        if any(part is None for part in parts):
            return [None for _ in self._by_block]
        return [
            self._in_agent_order(
                k, [p for g, p in zip(self._spec.groups, parts, strict=True) if g.block == k]
            )
            for k in range(len(self._by_block))
        ]

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
            views = self._views(view, groups)
            pairs = [self._modules[g.id].forward_recurrent(x) for g, x in zip(groups, views, strict=True)]
            outputs, memory = (self._in_agent_order(block, parts) for parts in zip(*pairs, strict=True))
            return first.head.act(outputs, action_mask, exploration, generator)._replace(memory=memory)
        else:
            outputs = self._gather(block, view)
        return first.head.act(outputs, action_mask, exploration, generator)

    def _gather(self, block: int, view: View) -> Tensor:
        """Return (B, n, P): each group's outputs in the columns of its agents."""
        own = self._by_block[block]
        kind = type(self._modules[own[0].id])
        groups = self._spec.groups if kind.communicates else own
        outputs = kind.policies([self._modules[g.id] for g in groups], self._views(view, groups))
        parts = [part for group, part in zip(groups, outputs, strict=True) if group.block == block]
        return self._in_agent_order(block, parts)

    def _in_agent_order(self, block: int, parts: Sequence[Tensor]) -> Tensor:
        """Return the parts (B, n, ...) of a block's groups in the order of its agents."""
        if len(parts) == 1:
            return parts[0]
        own, joined = self._by_block[block], torch.cat(list(parts), 1)
        places = np.concatenate([np.arange(joined.shape[1])[group.within] for group in own])
        return joined[:, torch.from_numpy(np.argsort(places))]

    @staticmethod
    def _stack(modules: list[JointModule]) -> Callable[[Mapping[str, Tensor]], Tensor] | None:
        """Return a function from the leaves of a block to outputs (B, n, P) in few steps, if there is one."""
        parts = [found for module in modules if (found := module.feedforward_parts())]
        perceptrons = [body for _, body in parts if isinstance(body, nn.Sequential)]
        if len(perceptrons) < len(modules) or not StackedPerceptrons.fits(perceptrons):
            return None
        encoder = parts[0][0]
        if len(modules) == 1:
            return PlacedPerceptron(encoder, perceptrons[0]) if encoder.places else None
        # Of single agents, each of which flattens its observation and no more.
        if any(module.group.size > 1 for module in modules) or not all(each.is_plain for each, _ in parts):
            return None
        stacked = StackedPerceptrons(perceptrons)
        return lambda leaves: stacked(encoder(leaves))
