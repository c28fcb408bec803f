"""Policies exported from runs of the benchmark: `smarts-bench export RUN --zoo NAME`.

A folder holds `policy.json` (how it sees and acts), `policy.npz` (its weights) and a module that registers
it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts.agents.benchmark import benchmark_interface
from smarts.agents.interface import AgentInterface
from smarts.agents.policy import ActionBatch, BatchAgent
from smarts.agents.spec import AgentSpec
from smarts.arrays import Floats
from smarts.errors import SmartsError, UnknownNameError, nearest_names
from smarts.geometry.compiling import kernel
from smarts.observations.arrays import VECTOR
from smarts.types.actions import ActionSpaceType
from smarts.zoo.driving import Memory

FORMAT = 1
CONTENT, WEIGHTS = "policy.json", "policy.npz"
"""Files of a folder."""
MASKED = -1e9
"""Output of an action that is not allowed."""


def exported_spec(folder: str | Path, agent: str = "") -> AgentSpec:
    """Return the interface of an exported policy and how it is made.

    Args:
        folder: With the exported files.
        agent: Whose policy, of the agents of the training; by default the first one's.

    Raises:
        SmartsError: The folder does not hold an exported policy.
        UnknownNameError: There was no such agent.
    """
    content = _content(Path(folder))
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


class ExportedPolicy(BatchAgent):
    """Acts greedily by the networks of a training run, each vehicle by itself.

    Sums run in a fixed order and in 64 bits, so that a vehicle's actions do not depend on the others.

    Args:
        folder: With the exported files.
        agent: Whose policy, of the agents of the training; by default the first one's.

    Raises:
        SmartsError: The folder does not hold an exported policy.
        UnknownNameError: There was no such agent.
    """

    def __init__(self, folder: str | Path, agent: str = "") -> None:
        content = _content(Path(folder))
        about = content["agents"][_agent(content, agent)]
        group = content["groups"][about["group"]]
        self.observation = content["observation"]  # pyright: ignore
        self.period = int(content["period"])  # pyright: ignore
        self._leaves, self._index = content["leaves"], content["index"]
        self._number, self._place, self._places = about["number"], about["place"], group["places"]
        self._layers = _layers(Path(folder), about["group"], group["layers"])
        self._head, self._bounds = content["head"], content["bounds"]
        self._memory = Memory(max(1, group["memory"]))

    def act(self, obs: ActionBatch) -> NDArray:
        """Return the actions of the training's action space, shape (N,) or (N, *shape)."""
        outputs = self._outputs(obs)
        if self._head == "best":
            allowed = obs.action_mask if self._bounds["masked"] else np.ones_like(outputs, np.bool_)
            return np.where(allowed, outputs, MASKED).argmax(axis=1) + self._bounds["start"]
        low, high = np.array(self._bounds["low"]), np.array(self._bounds["high"])
        if self._head == "tanh":
            outputs = hyperbolic(outputs)
        actions = outputs[:, : low.size].reshape(len(outputs), *low.shape)
        if np.isfinite(low).all() and np.isfinite(high).all():
            actions = low + (np.clip(actions, -1.0, 1.0) + 1.0) * (high - low) / 2.0
        return np.clip(actions, low, high)

    def _outputs(self, obs: ActionBatch) -> Floats:
        """Return the network's outputs, shape (N, P)."""
        x, memory = self._features(obs), self._memory.of(obs)
        for kind, weights in self._layers:
            if kind == "linear":
                x = linear(x, *weights)
            elif kind == "tanh":
                x = hyperbolic(x)
            elif kind == "relu":
                x = np.maximum(x, 0.0)
            else:
                x = memory = recurrent(x, memory, *weights)
        self._memory.keep(obs, memory)
        return x

    def _features(self, obs: ActionBatch) -> Floats:
        """Return what the network reads, shape (N, d): the observation, and which agent it is."""
        count, parts = len(obs.env_id), []
        for name in self._leaves:
            given = obs.observations[name]
            leaf = given.reshape(count, math.prod(given.shape[1:])).astype(np.float64)
            if name == VECTOR and self._index is not None:
                number = np.zeros((count, self._index["size"]))
                number[:, self._number] = 1.0
                at = self._index["at"]
                leaf = np.concatenate([leaf[:, :at], number, leaf[:, at:]], axis=1)
            parts.append(leaf)
        if self._places:
            place = np.zeros((count, self._places))
            place[:, self._place] = 1.0
            parts.append(place)
        return np.ascontiguousarray(np.concatenate(parts, axis=1))


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


def _content(folder: Path) -> dict[str, Any]:
    try:
        content = json.loads((folder / CONTENT).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SmartsError(
            f"the exported policy cannot be read: {error}",
            place=str(folder / CONTENT),
            remedy="export it again",
        ) from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise SmartsError(
            f"not an exported policy of format {FORMAT}",
            place=str(folder / CONTENT),
            remedy="export it again",
        )
    return content


def _agent(content: Mapping[str, Any], agent: str) -> str:
    names = [*content["agents"]]
    if agent and agent not in names:
        raise UnknownNameError(
            f"the policy was not trained for an agent {agent!r}",
            place="option 'agent'",
            remedy=nearest_names(agent, names),
        )
    return agent or names[0]


def _layers(folder: Path, group: str, kinds: list[str]) -> list[tuple[str, tuple[Floats, ...]]]:
    """Return the layers of a network: kind and weights."""
    try:
        with np.load(folder / WEIGHTS, allow_pickle=False) as file:
            found = []
            for number, kind in enumerate(kinds):
                count = {"linear": 2, "gru": 4}.get(kind, 0)
                names = [f"{group}/{number}/{k}" for k in range(count)]
                found.append((kind, tuple(file[name].astype(np.float64) for name in names)))
            return found
    except (OSError, ValueError, KeyError) as error:
        raise SmartsError(
            f"the weights cannot be read: {error}", place=str(folder / WEIGHTS), remedy="export it again"
        ) from error
