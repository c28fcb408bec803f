"""Policies that `smarts-bench export` has written, by numpy alone.

    python -m smarts_agent_kit smarts_agent_kit.exported:ExportedPolicy --address HOST:PORT --options OPTIONS

serves one; OPTIONS are {"folder": "left_turner"}, and "agent" for another one than the training's first, "*"
for all of them at once.
Sums run in a fixed order and in 64 bits: a vehicle's actions do not depend on the others, nor on the machine.
Axis letters: N agents, d inputs, P outputs, H numbers of a memory.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from smarts_agent_kit.agents import ActionBatch, BatchAgent
from smarts_agent_kit.memory import Memory
from smarts_agent_kit.weights import (
    CONTENT,
    HEAR,
    ExportError,
    content_of,
    layers_of,
    sets_of,
)

TEAM = "*"
"""Stands for any agent's name: agent k of a simulation is the training's agent k."""
JOINT_Q = "joint_q"
"""Key of `policy.json` for values of joint actions, of which agents take their parts."""
TRAINED = "trained"
"""Key of `policy.json`: algorithm, task, scenarios, traffic, environment, seed of the training."""
VECTOR = "observation"
"""The array that the features' numbers are joined in."""
MOST_NUMBERS = 100_000
"""Most numbers of a memory, and of what says which agent a vehicle is."""
MASKED = -1e9
"""Output of an action that is not allowed."""
_LARGEST_EXPONENT = 709.0
"""Largest exponent of e whose power a float can hold."""


class ExportedPolicy(BatchAgent):
    """Acts greedily by the networks of a training run.

    Each vehicle acts by itself, except where the training's agents talk: those hear the vehicles of the same
    simulation that are asked in the same step.

    Args:
        folder: With the exported files.
        agent: Whose policy, of the agents of the training; by default the first one's. `TEAM`: all of them.

    Raises:
        ExportError: The folder does not hold an exported policy, or the training had no such agent.
    """

    def __init__(self, folder: str | Path, agent: str = "") -> None:
        try:
            self._read(content_of(Path(folder)), folder, agent)
        except ExportError:
            raise
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise ExportError(
                f"its parts do not fit together: {error!r}", str(Path(folder) / CONTENT)
            ) from error

    def _read(self, content: dict[str, Any], folder: str | Path, agent: str) -> None:
        agents = content["agents"]
        if agent and agent != TEAM and agent not in agents:
            raise ExportError(f"the training had no agent {agent!r}, but {', '.join(agents)}", str(folder))
        names = [*agents] if agent == TEAM else [agent or next(iter(agents))]
        self._cast = [agents[name] for name in names]
        self._trained = [*agents.values()]
        self.observation = content["observation"]  # pyright: ignore
        self.period = int(content["period"])  # pyright: ignore
        self.interface = self._cast[0].get("interface")  # pyright: ignore
        self._leaves, self._index = content["leaves"], content["index"]
        self._groups = content["groups"]
        used = dict.fromkeys(each["group"] for each in self._cast)
        self._layers = {name: layers_of(Path(folder), name, self._groups[name]["layers"]) for name in used}
        self._sets = {name: sets_of(Path(folder), name, self._groups[name].get("sets", ())) for name in used}
        self._head, self._bounds = content["head"], content["bounds"]
        self._is_joint = bool(content.get(JOINT_Q))
        memory = max(self._groups[name]["memory"] for name in used)
        sizes = [memory, *(self._groups[name]["places"] for name in used)]
        sizes += [self._index["size"]] if self._index is not None else []
        if max(sizes) > MOST_NUMBERS:
            raise ExportError(f"it reads {max(sizes)} numbers, of at most {MOST_NUMBERS}", str(folder))
        self._memory = Memory(max(1, memory))

    @property
    def talks(self) -> bool:
        """Whether its vehicles act on what others see."""
        heard = (arrays[2] for layers in self._layers.values() for kind, arrays in layers if kind == HEAR)
        return self._is_joint or any(each.any() for each in heard)

    def weights(self) -> Iterator[NDArray]:
        """Yield all weights, in the order in which the networks read them."""
        for name, layers in self._layers.items():
            for arrays in self._sets[name].values():
                yield from arrays
            for _, arrays in layers:
                yield from arrays

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
        """Return the networks' outputs, shape (N, P)."""
        who = self._who(obs)
        rows = {name: np.flatnonzero([self._cast[k]["group"] == name for k in who]) for name in self._layers}
        rows = {name: each for name, each in rows.items() if len(each)}
        if self._is_joint:
            return self._best_parts(obs, who, rows)
        numbers = {name: self._features(obs, each, who[each], name) for name, each in rows.items()}
        memory = self._memory.of(obs)
        kept = memory.copy()
        depth = max((len(self._layers[name]) for name in rows), default=0)
        for number in range(depth):
            heard = self._heard(obs, rows, numbers, number)
            for name, each in rows.items():
                kind, weights = self._layers[name][number]
                numbers[name] = self._applied(kind, weights, numbers[name], memory[each], heard.get(name))
                if kind == "gru":
                    kept[each] = numbers[name]
        self._memory.keep(obs, kept)
        return _joined(len(who), rows, numbers)

    def _applied(
        self, kind: str, weights: Sequence[NDArray], x: NDArray, memory: NDArray, heard: NDArray | None
    ) -> NDArray:
        """Return a layer's outputs for inputs `x`, shape (N, P)."""
        if kind == "linear":
            weight, bias = weights
            return self._linear(*_fitting(x, weight, bias))
        if kind == "tanh":
            return self._tanh(x)
        if kind == "relu":
            return np.maximum(x, 0.0)
        if heard is not None:
            weight, bias, weight_heard = weights
            of_others = _fitting(heard, weight_heard, np.zeros(len(bias)))
            return self._tanh(self._linear(*_fitting(x, weight, bias)) + self._linear(*of_others))
        weight, bias, weight_memory, bias_memory = weights
        _fitting(x, weight, bias, 3 * memory.shape[1])
        _fitting(memory, weight_memory, bias_memory, 3 * memory.shape[1])
        return self._recurrent(x, memory, *weights)

    def _heard(
        self, obs: ActionBatch, rows: Mapping[str, NDArray], numbers: Mapping[str, NDArray], layer: int
    ) -> dict[str, NDArray]:
        """Return what each group's vehicles hear before a layer: the mean of the others' numbers."""
        if all(self._layers[name][layer][0] != HEAR for name in rows):
            return {}
        spoken = _joined(len(obs.env_id), rows, numbers)
        means = np.zeros_like(spoken)
        for env in np.unique(obs.env_id):
            there = np.flatnonzero(obs.env_id == env)
            for row in there:
                others = [each for each in there if each != row]
                for each in others:
                    means[row] += spoken[each] / len(others)
        return {name: np.ascontiguousarray(means[each]) for name, each in rows.items()}

    def _best_parts(self, obs: ActionBatch, who: NDArray, rows: Mapping[str, NDArray]) -> NDArray:
        """Return 1 for each vehicle's part of its simulation's best joint action, shape (N, actions).

        A vehicle of a single policy is alone: the training's other agents are not there.
        """
        count = obs.action_mask.shape[1]
        parts = np.zeros((len(who), count))
        are_together = len(self._cast) > 1
        scenes = obs.env_id if are_together else np.arange(len(who))
        for scene in np.unique(scenes):
            there = np.flatnonzero(scenes == scene)
            for name, own in rows.items():
                mine = np.intersect1d(there, own)
                if not len(mine):
                    continue
                values, masks = self._joint_state(obs, there, who[there], name)
                for kind, weights in self._layers[name]:
                    values = self._applied(kind, weights, values, values, None)
                table = values.reshape([count] * len(masks))
                for place, mask in enumerate(masks):
                    shape = [1] * len(masks)
                    shape[place] = count
                    table = np.where(mask.reshape(shape), table, MASKED)
                best = np.unravel_index(int(table.argmax()), table.shape)
                for row in mine:
                    parts[row, best[self._order().index(self._cast[who[row]]["number"])]] = 1.0
        return parts

    def _order(self) -> list[int]:
        """Return the numbers of the training's agents in the order of the groups."""
        return [each["number"] for name in self._groups for each in self._trained if each["group"] == name]

    def _joint_state(
        self, obs: ActionBatch, rows: NDArray, who: NDArray, reader: str
    ) -> tuple[NDArray, list[NDArray]]:
        """Return what a group reads of all agents and which are there, (1, d); and each agent's mask.

        Only the first action is open to an agent that is not there.
        """
        seen = self._features(obs, rows, who, reader)
        at = {self._cast[k]["number"]: row for row, k in enumerate(who.tolist())}
        parts, masks = [], []
        absent = np.arange(obs.action_mask.shape[1]) == 0
        for name in self._groups:
            members = [each["number"] for each in self._trained if each["group"] == name]
            parts += [seen[at[number]] if number in at else np.zeros(seen.shape[1]) for number in members]
            parts.append(np.array([float(number in at) for number in members]))
            allowed = obs.action_mask if self._bounds["masked"] else np.ones_like(obs.action_mask)
            masks += [allowed[rows[at[number]]] if number in at else absent for number in members]
        return np.concatenate(parts)[None], masks

    def _who(self, obs: ActionBatch) -> NDArray[np.intp]:
        """Return which of the cast each vehicle is, shape (N,).

        Raises:
            ValueError: There are more vehicles than the training had agents.
        """
        if len(self._cast) == 1:
            return np.zeros(len(obs.env_id), np.intp)
        if np.max(obs.agent_id, initial=0) >= len(self._cast):
            raise ValueError(
                f"the policies are of {len(self._cast)} agents; there are more in the simulation"
            )
        return obs.agent_id.astype(np.intp)

    def _features(self, obs: ActionBatch, rows: NDArray, who: NDArray, group: str) -> NDArray:
        """Return what a group's network reads of some rows: the observation, and which agent it is."""
        count, parts = len(rows), []
        cast = [self._cast[k] for k in who.tolist()]
        sets = self._sets[group]
        for name in self._leaves:
            given = obs.observations[name][rows]
            if name in sets:
                parts.append(self._of_set(given.astype(np.float64), *sets[name]))
                continue
            leaf = given.reshape(count, math.prod(given.shape[1:])).astype(np.float64)
            if name == VECTOR and self._index is not None:
                number = _one_hot([each["number"] for each in cast], self._index["size"])
                at = self._index["at"]
                leaf = np.concatenate([leaf[:, :at], number, leaf[:, at:]], axis=1)
            parts.append(leaf)
        places = self._groups[group]["places"]
        if places:
            parts.append(_one_hot([each["place"] for each in cast], places))
        return np.ascontiguousarray(np.concatenate(parts, axis=1))

    def _of_set(
        self, rows: NDArray, weight: NDArray, bias: NDArray, weight_2: NDArray, bias_2: NDArray
    ) -> NDArray:
        """Return the largest and the mean value of each unit over the rows of sets, (N, K, F) to (N, 2 P).

        A row of zeros is an empty place, whose units are zero.
        """
        count, places, numbers = rows.shape
        flat = rows.reshape(count * places, numbers)
        units = np.maximum(self._linear(*_fitting(flat, weight, bias)), 0.0)
        units = np.maximum(self._linear(*_fitting(units, weight_2, bias_2)), 0.0)
        units = units.reshape(count, places, len(bias_2))
        units = units * (rows != 0).any(axis=2, keepdims=True)
        total = np.zeros((count, len(bias_2)))
        for place in range(places):
            total += units[:, place]
        return np.concatenate([units.max(axis=1), total / places], axis=1)

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


def _fitting(
    x: NDArray, weight: NDArray, bias: NDArray, units: int | None = None
) -> tuple[NDArray, NDArray, NDArray]:
    """Return inputs (N, d), weights (d, P) and biases (P,): compiled code would read beside others.

    Raises:
        ValueError: They do not fit together, or P is not `units`.
    """
    units = len(bias) if units is None else units
    if weight.shape != (x.shape[1], units) or bias.shape != (units,):
        raise ValueError(
            f"a layer with arrays of the shapes {weight.shape} and {bias.shape} is given {x.shape[1]} numbers"
        )
    return x, weight, bias


def _one_hot(numbers: Sequence[int], size: int) -> NDArray:
    """Return a row for each number, shape (N, size): 1 in its column, and else 0."""
    out = np.zeros((len(numbers), size))
    out[np.arange(len(numbers)), numbers] = 1.0
    return out


def _joined(count: int, rows: Mapping[str, NDArray], numbers: Mapping[str, NDArray]) -> NDArray:
    """Return the numbers of all rows, of those of each group, shape (N, P)."""
    whole = np.zeros((count, next((each.shape[1] for each in numbers.values()), 1)))
    for name, each in rows.items():
        whole[each] = numbers[name]
    return whole


def _logistic(x: NDArray) -> NDArray:
    powers = [math.exp(-each) if -each < _LARGEST_EXPONENT else math.inf for each in x.ravel().tolist()]
    return 1.0 / (1.0 + np.array(powers).reshape(x.shape))
