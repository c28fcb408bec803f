"""Groups whose networks are evaluated as one: one chain of batched products instead of one chain a group."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from algorithms.joint.batch import GroupView
from algorithms.joint.spec import Group
from algorithms.parts.masking import masked_mean
from algorithms.parts.networks import Encoder, StackedPerceptrons

Plain = Callable[[Group], tuple[Encoder, nn.Module] | None]
"""The encoder and body of a group's network, if that is all it consists of."""


@dataclass(frozen=True)
class StackedGroups:
    """All groups of a block, of one agent each, with plain networks of one shape; or any single group.

    Attributes:
        groups: The groups, in the order of their agents.
        whole: Their agents as one group, for `part` and `view` of batches.
    """

    groups: tuple[Group, ...]
    whole: Group

    @property
    def is_stacked(self) -> bool:
        """Whether it holds several groups."""
        return len(self.groups) > 1

    def outputs(self, view: GroupView, plain: Plain) -> Tensor:
        """Return outputs (M, n, P) of several groups' networks, with gradient."""
        networks = [network for group in self.groups if (network := plain(group))]
        bodies = [body for _, body in networks if isinstance(body, nn.Sequential)]
        return StackedPerceptrons(bodies)(networks[0][0](view.observations))

    def means(self, x: Tensor, mask: Tensor) -> Tensor:
        """Return each group's mean over its active agents, (groups,)."""
        if not self.is_stacked:
            return masked_mean(x, mask).unsqueeze(0)
        return torch.where(mask, x, 0).sum(0) / mask.sum(0).clamp(min=1)

    def present(self, alive: Tensor) -> list[Group]:
        """Return the groups with an active agent in any row of `alive` (M, n)."""
        if not self.is_stacked:
            return list(self.groups) if alive.any() else []
        return [group for group, there in zip(self.groups, alive.any(0).tolist(), strict=True) if there]


def stack_groups(groups: Sequence[Group], plain: Plain) -> tuple[StackedGroups, ...]:
    """Return the groups, stacked where they can be, block by block."""
    found: list[StackedGroups] = []
    for block in sorted({group.block for group in groups}):
        own = tuple(group for group in groups if group.block == block)
        if len(own) > 1 and _fit([(group, plain(group)) for group in own]):
            found.append(StackedGroups(own, _joined(own)))
        else:
            found += [StackedGroups((group,), group) for group in own]
    return tuple(found)


def _fit(networks: list[tuple[Group, tuple[Encoder, nn.Module] | None]]) -> bool:
    if any(group.size > 1 or network is None or not network[0].is_plain for group, network in networks):
        return False
    return StackedPerceptrons.fits([network[1] for _, network in networks if network is not None])


def _joined(groups: tuple[Group, ...]) -> Group:
    first, last = groups[0], groups[-1]
    agents = tuple(agent for group in groups for agent in group.agents)
    return replace(
        first,
        id="+".join(group.id for group in groups),
        agents=agents,
        within=_span(first.within, last.within),
        columns=_span(first.columns, last.columns),
    )


def _span(first, last) -> slice:
    """Return the slice from the first to the last of single columns, which follow each other in a block."""
    return slice(first.start, last.stop)
