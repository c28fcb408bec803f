"""Neighbours of each agent: by the environment's graph, by distance, or fixed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from algorithms.errors import SpaceError, nearest_names
from algorithms.joint.batch import JointView
from algorithms.joint.env import JointSpaces
from algorithms.parts.communication import others
from algorithms.parts.graph import complete, ring, within
from algorithms.setting_kinds import Near
from algorithms.settings import Graph


class Neighbourhood:
    """Computes the neighbour graph at each step.

    Args:
        spaces: Agents and what they see.
        graph: What makes neighbours.

    Raises:
        SpaceError: The graph names what the environment does not have.
    """

    def __init__(self, spaces: JointSpaces, graph: Graph) -> None:
        if graph == "auto":
            graph = "environment" if spaces.has_graph else "all"
        agents = tuple(agent for block in spaces.blocks for agent in block.agents)
        self._near = graph if isinstance(graph, Near) else None
        self.fixed: Tensor | None = None
        """The links (N, N) of a graph that never changes."""
        if graph == "environment":
            if not spaces.has_graph:
                raise SpaceError(
                    "the environment has no communication graph",
                    place="training(graph='environment')",
                    remedy="use 'all', 'ring', Near(radius) or pairs of agents",
                )
        elif isinstance(graph, Near):
            for block in spaces.blocks:
                if graph.leaf not in block.observation:
                    raise SpaceError(
                        f"agent {block.agents[0]!r} observes no leaf {graph.leaf!r}",
                        place="training(graph=Near(...))",
                        remedy=nearest_names(graph.leaf, block.observation),
                    )
        else:
            self.fixed = _fixed(graph, agents)

    def __call__(self, alive: Tensor, graph: Any, observations: Sequence[Mapping[str, Tensor]]) -> Tensor:
        """Return the neighbours (..., N, N): `[i, j]` is True if j is an active neighbour of i.

        Args:
            alive: (..., N).
            graph: The environment's graph (..., N, N), or None where another makes neighbours.
            observations: Per block, leaves (..., n, ...).
        """
        if self.fixed is not None:
            links = self.fixed.to(alive.device)
        elif self._near is not None:
            leaves = [each[self._near.leaf].flatten(alive.dim()) for each in observations]
            places = torch.cat([leaf[..., list(self._near.components)] for leaf in leaves], -2)
            links = within(places.float(), self._near.radius)
        else:
            links = graph
        return links & others(alive) & alive.unsqueeze(-1)

    def of(self, view: JointView) -> Tensor:
        """Return the neighbours at the moments of a view."""
        return self(view.alive, view.graph, view.observations)


def _fixed(graph: str | Sequence[tuple[str, str]], agents: tuple[str, ...]) -> Tensor:
    if graph == "all":
        return complete(len(agents))
    if graph == "ring":
        return ring(len(agents))
    links = torch.zeros(len(agents), len(agents), dtype=torch.bool)
    for pair in graph:
        for agent in pair:
            if agent not in agents:
                raise SpaceError(
                    f"the graph links {agent!r}, which the environment does not have",
                    place="training(graph=...)",
                    remedy=nearest_names(agent, agents),
                )
        i, j = (agents.index(agent) for agent in pair)
        links[i, j] = links[j, i] = True
    return links
