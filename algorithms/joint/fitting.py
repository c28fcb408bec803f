"""Weights of one network for another: of another task, or of another number of agents that share it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from algorithms.joint.spec import JointSpec

Weights = Mapping[str, NDArray]


class Agents(NamedTuple):
    """For how many agents a network is."""

    all: int
    """In the environment: of which an observation may have the agent's number, one-hot."""
    sharing: int
    """Agents that the network tells apart: its inputs end in the agent's place, one-hot (`Encoder`)."""

    @classmethod
    def of(cls, spec: JointSpec, group: str | None) -> Agents:
        """Return the agents of a group's network, or of a network of all agents."""
        return cls(len(spec.agents), next((each.places for each in spec.groups if each.id == group), 1))


def fitted_weights(
    own: Weights, given: Weights, here: Agents, there: Agents, index: int | None = None
) -> tuple[dict[str, Any], list[str]]:
    """Return a network's weights with those of another that fit, and the names of those that do not.

    Each agent begins as the one of its number there, and further ones as the first ones.

    Args:
        own: Name -> weights as they are.
        given: The same of the other network.
        here: Agents of the network.
        there: Agents of the other one.
        index: Input at which the agent's number begins, if it is observed.
    """
    taken: dict[str, Any] = {name: array for name, array in given.items() if name in own}
    for name, array in given.items():
        if name in taken and np.ndim(array) == 2 and np.shape(own[name]) != array.shape:
            columns = _columns(array.shape[1], here, there, index)
            if np.shape(own[name]) == (len(array), len(columns)):
                taken[name] = np.where(columns < 0, 0, array[:, columns])
                bias = name.removesuffix("weight") + "bias"
                if here.sharing == 1 < there.sharing and bias in taken:  # its place is always the first
                    taken[bias] = given[bias] + array[:, -there.sharing]
    fits = {name: array for name, array in taken.items() if np.shape(array) == np.shape(own[name])}
    return {**own, **fits}, [name for name in own if name not in fits]


def _columns(width: int, here: Agents, there: Agents, index: int | None) -> NDArray[np.intp]:
    """Return for each input its number among so many of the other network, -1 for one that was not there."""
    places, wanted = (count.sharing if count.sharing > 1 else 0 for count in (there, here))
    added = np.arange(wanted) % places + width - places if places else np.full(wanted, -1)
    columns = np.concatenate([np.arange(width - places), added])
    if index is None:
        return columns
    numbers = index + np.arange(here.all) % there.all
    return np.concatenate([columns[:index], numbers, columns[index + there.all :]])
