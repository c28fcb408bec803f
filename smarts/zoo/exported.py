"""Policies exported from runs of the benchmark: `smarts-bench export RUN --zoo NAME`.

A folder holds `policy.json` (how it sees and acts), `policy.npz` (its weights) and a module that registers
it. What it does is that of `smarts_agent_kit.exported`, bit by bit, in less time.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from smarts.agents.benchmark import benchmark_interface
from smarts.agents.interface import AgentInterface
from smarts.agents.spec import AgentSpec
from smarts.arrays import Floats
from smarts.errors import SmartsError, UnknownNameError, nearest_names
from smarts.geometry.compiling import kernel
from smarts.types.actions import ActionSpaceType
from smarts_agent_kit import exported
from smarts_agent_kit.weights import ExportError, content_of


def exported_spec(folder: str | Path, agent: str = "") -> AgentSpec:
    """Return the interface of an exported policy and how it is made.

    Args:
        folder: With the exported files.
        agent: Whose policy, of the agents of the training; by default the first one's. "*": all of them.

    Raises:
        SmartsError: The folder does not hold an exported policy.
        UnknownNameError: There was no such agent.
    """
    content = _content(folder)
    interface = interface_of(content["agents"][_agent(content, agent)], content["action"])
    return AgentSpec(interface, ExportedPolicy, {"folder": str(folder), "agent": agent})


def interface_of(vehicle: Mapping[str, Any], action: str) -> AgentInterface:
    """Return the interface of an agent of the training, without a limit of steps."""
    return benchmark_interface(
        action=ActionSpaceType[action],
        max_episode_steps=None,
        vehicle_class=vehicle["vehicle"],
        vehicle_model=vehicle["vehicle_model"],
        tyre_model=vehicle["tyre_model"],
        flat_tyres=tuple(vehicle["flat_tyres"]),
    )


@kernel
def linear(x: Floats, weight: Floats, bias: Floats) -> Floats:
    """Return x W + b, shape (N, P), summed in the order of the inputs; `weight` has the shape (d, P)."""
    out = np.empty((len(x), len(bias)))
    for n in range(len(x)):
        for j in range(len(bias)):
            out[n, j] = bias[j]
        for i in range(len(weight)):
            for j in range(len(bias)):
                out[n, j] += x[n, i] * weight[i, j]
    return out


@kernel
def hyperbolic(x: Floats) -> Floats:
    """Return tanh of each number, shape (N, P)."""
    out = np.empty(x.shape)
    for n in range(x.shape[0]):
        for j in range(x.shape[1]):
            out[n, j] = math.tanh(x[n, j])
    return out


@kernel
def recurrent(
    x: Floats, memory: Floats, weight: Floats, bias: Floats, weight_memory: Floats, bias_memory: Floats
) -> Floats:
    """Return the memory (N, H) of a gated recurrent unit after inputs (N, d).

    The columns of the weights are those of the reset gate, the update gate and the new content.
    """
    size = memory.shape[1]
    seen, kept = linear(x, weight, bias), linear(memory, weight_memory, bias_memory)
    out = np.empty(memory.shape)
    for n in range(len(x)):
        for j in range(size):
            reset = 1.0 / (1.0 + math.exp(-(seen[n, j] + kept[n, j])))
            update = 1.0 / (1.0 + math.exp(-(seen[n, size + j] + kept[n, size + j])))
            new = math.tanh(seen[n, 2 * size + j] + reset * kept[n, 2 * size + j])
            out[n, j] = (1.0 - update) * new + update * memory[n, j]
    return out


class ExportedPolicy(exported.ExportedPolicy):
    """Acts greedily by the networks of a training run, by compiled kernels.

    Args:
        folder: With the exported files.
        agent: Whose policy, of the agents of the training; by default the first one's. "*": all of them.

    Raises:
        SmartsError: The folder does not hold an exported policy, or there was no such agent.
    """

    _linear, _tanh, _recurrent = staticmethod(linear), staticmethod(hyperbolic), staticmethod(recurrent)

    def __init__(self, folder: str | Path, agent: str = "") -> None:
        try:
            super().__init__(folder, agent)
        except ExportError as error:
            raise SmartsError(error.problem, place=error.place, remedy="export it again") from error


def _content(folder: str | Path) -> dict[str, Any]:
    try:
        return content_of(Path(folder))
    except ExportError as error:
        raise SmartsError(error.problem, place=error.place, remedy="export it again") from error


def _agent(content: Mapping[str, Any], agent: str) -> str:
    names = [*content["agents"]]
    if agent and agent != exported.TEAM and agent not in names:
        raise UnknownNameError(
            f"the policy was not trained for an agent {agent!r}",
            place="option 'agent'",
            remedy=nearest_names(agent, names),
        )
    return names[0] if agent in ("", exported.TEAM) else agent
