"""Policies that `smarts-bench export` has written, by numpy alone.

    python -m smarts_agent_kit smarts_agent_kit.exported:ExportedPolicy --address HOST:PORT --options OPTIONS

serves one; OPTIONS are {"folder": "left_turner"}, and "agent" for another one than the training's first.
Sums run in a fixed order and in 64 bits: a vehicle's actions do not depend on the others, nor on the machine.
Axis letters: N agents, d inputs, P outputs, H numbers of a memory.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts_agent_kit.agents import ActionBatch, BatchAgent
from smarts_agent_kit.memory import Memory

FORMAT = 1
CONTENT, WEIGHTS = "policy.json", "policy.npz"
"""Files of a folder."""
VECTOR = "observation"
"""The array that the features' numbers are joined in."""
MASKED = -1e9
"""Output of an action that is not allowed."""
_LARGEST_EXPONENT = 709.0
"""Of e, that a number holds."""


class ExportError(ValueError):
    """A folder does not hold an exported policy.

    Args:
        problem: What is wrong.
        place: The file.
    """

    def __init__(self, problem: str, place: str) -> None:
        self.problem, self.place = problem, place
        super().__init__(f"{place}: {problem}; export it again")


class ExportedPolicy(BatchAgent):
    """Acts greedily by the networks of a training run, each vehicle by itself.

    Args:
        folder: With the exported files.
        agent: Whose policy, of the agents of the training; by default the first one's.

    Raises:
        ExportError: The folder does not hold an exported policy, or the training had no such agent.
    """

    def __init__(self, folder: str | Path, agent: str = "") -> None:
        content = content_of(Path(folder))
        if agent and agent not in content["agents"]:
            known = ", ".join(content["agents"])
            raise ExportError(f"the training had no agent {agent!r}, but {known}", str(folder))
        about = content["agents"][agent or next(iter(content["agents"]))]
        group = content["groups"][about["group"]]
        self.observation = content["observation"]  # pyright: ignore
        self.period = int(content["period"])  # pyright: ignore
        self.interface = about.get("interface")  # pyright: ignore
        self._leaves, self._index = content["leaves"], content["index"]
        self._number, self._place, self._places = about["number"], about["place"], group["places"]
        self._layers = layers_of(Path(folder), about["group"], group["layers"])
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
            outputs = self._tanh(outputs)
        actions = outputs[:, : low.size].reshape(len(outputs), *low.shape)
        if np.isfinite(low).all() and np.isfinite(high).all():
            actions = low + (np.clip(actions, -1.0, 1.0) + 1.0) * (high - low) / 2.0
        return np.clip(actions, low, high)

    def _outputs(self, obs: ActionBatch) -> NDArray:
        """Return the network's outputs, shape (N, P)."""
        x, memory = self._features(obs), self._memory.of(obs)
        for kind, weights in self._layers:
            if kind == "linear":
                x = self._linear(x, *weights)
            elif kind == "tanh":
                x = self._tanh(x)
            elif kind == "relu":
                x = np.maximum(x, 0.0)
            else:
                x = memory = self._recurrent(x, memory, *weights)
        self._memory.keep(obs, memory)
        return x

    def _features(self, obs: ActionBatch) -> NDArray:
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

    @staticmethod
    def _linear(x: NDArray, weight: NDArray, bias: NDArray) -> NDArray:
        """Return x W + b, shape (N, P), summed in the order of the inputs; `weight` has the shape (d, P)."""
        out = np.tile(bias, (len(x), 1))
        for i in range(len(weight)):
            out += x[:, i, None] * weight[i]
        return out

    @staticmethod
    def _tanh(x: NDArray) -> NDArray:
        """Return tanh of each number, by the C library: numpy's own differs from it in last bits."""
        return np.array([math.tanh(each) for each in x.ravel().tolist()]).reshape(x.shape)

    def _recurrent(
        self,
        x: NDArray,
        memory: NDArray,
        weight: NDArray,
        bias: NDArray,
        weight_memory: NDArray,
        bias_memory: NDArray,
    ) -> NDArray:
        """Return the memory (N, H) of a gated recurrent unit after inputs (N, d).

        The columns of the weights are those of the reset gate, the update gate and the new content.
        """
        size = memory.shape[1]
        seen, kept = self._linear(x, weight, bias), self._linear(memory, weight_memory, bias_memory)
        gates = _logistic(seen[:, : 2 * size] + kept[:, : 2 * size])
        reset, update = gates[:, :size], gates[:, size:]
        new = self._tanh(seen[:, 2 * size :] + reset * kept[:, 2 * size :])
        return (1.0 - update) * new + update * memory


def _logistic(x: NDArray) -> NDArray:
    powers = [math.exp(-each) if -each < _LARGEST_EXPONENT else math.inf for each in x.ravel().tolist()]
    return 1.0 / (1.0 + np.array(powers).reshape(x.shape))


def content_of(folder: Path) -> dict[str, Any]:
    """Return what `policy.json` holds.

    Raises:
        ExportError: There is none, or it is of another format.
    """
    try:
        content = json.loads((folder / CONTENT).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ExportError(f"the exported policy cannot be read: {error}", str(folder / CONTENT)) from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ExportError(f"not an exported policy of format {FORMAT}", str(folder / CONTENT))
    return content


def layers_of(folder: Path, group: str, kinds: list[str]) -> list[tuple[str, tuple[NDArray, ...]]]:
    """Return the layers of a network: kind and weights.

    Raises:
        ExportError: They cannot be read.
    """
    try:
        with np.load(folder / WEIGHTS, allow_pickle=False) as file:
            found = []
            for number, kind in enumerate(kinds):
                count = {"linear": 2, "gru": 4}.get(kind, 0)
                names = [f"{group}/{number}/{k}" for k in range(count)]
                found.append((kind, tuple(file[name].astype(np.float64) for name in names)))
            return found
    except (OSError, ValueError, KeyError) as error:
        raise ExportError(f"the weights cannot be read: {error}", str(folder / WEIGHTS)) from error
