"""Groups whose networks are evaluated as one: one chain of batched products instead of one chain a group."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from algorithms.joint.batch import GroupView
from algorithms.joint.spec import Group
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

    def sums(self, x: Tensor, mask: Tensor) -> Tensor:
        """Return each group's sum of `x` (M, n) over its active agents, (groups,)."""
        own = torch.where(mask, x, 0)
        return own.sum(0) if self.is_stacked else own.sum().unsqueeze(0)

    def counts(self, mask: Tensor) -> Tensor:
        """Return each group's number of active agents in all rows, (groups,)."""
        return mask.sum(0) if self.is_stacked else mask.sum().unsqueeze(0)

    def present(self, absent: Collection[str]) -> list[Group]:
        """Return the groups that are not absent."""
        return [group for group in self.groups if group.id not in absent]


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
