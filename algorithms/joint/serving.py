"""Policies asked the way RLlib asks a module: observations of single agents in a batch, actions out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import torch
from gymnasium.spaces import Box
from ray.rllib.core.columns import Columns
from torch import Tensor

from algorithms.joint.batch import GroupView
from algorithms.joint.env import CARRIED, MEMORY
from algorithms.joint.spaces import MASK, WRAPPED
from algorithms.joint.spec import Group
from algorithms.parts.distributions import CategoricalHead, Exploration
from algorithms.parts.masking import MASKED_LOGIT

STATE = "memory"
"""Name of the memory in RLlib's columns of states."""


class Question(NamedTuple):
    """A batch as the policy of a group sees it.

    Attributes:
        view: Rows of the group's n agents, of which only those asked about are active.
        rows: Rows (R,) of the view in which the answers are.
        places: The agents (R,) among the n.
        shape: Leading axes of the batch; R is their product.
    """

    view: GroupView
    rows: Tensor
    places: Tensor
    shape: torch.Size


def answer(module: Any, batch: Mapping[str, Any], exploration: Exploration) -> dict[str, Any]:
    """Return RLlib's columns for a batch: actions, and what the module has of densities and memory.

    Args:
        module: The `JointModule`: the policy of a group of n agents.
        batch: `obs`, one observation a row, (M, *shape) or a dict of such leaves, with action masks in
            `action_mask`. A row is an agent alone, the group's first unless `agent_id` names M agents. With
            one more axis, (M, n, *shape), a row is all agents of the group; a recurrent policy takes that
            axis for time, (M, L, *shape), as RLlib does, and its memory from `state_in`. What the sampler
            adds to observations, such as the mean action, may be given under its own name, or is zero.
        exploration: How to act.

    Raises:
        ValueError: `agent_id` names an agent that the policy does not act for.
    """
    question = ask(module.group, batch, recurrent=module.recurrent)
    if module.acts_jointly:
        kind, generator = type(module), torch.default_generator
        acting = kind.act_jointly([module], [question.view], exploration, generator)[0]
        outputs, memory = None, None
    else:
        outputs, memory = (
            module.forward_recurrent(question.view)
            if module.memory_size
            else (module.policy(question.view), None)
        )
        acting = module.head.act(outputs, question.view.action_mask, exploration, torch.default_generator)
    told: dict[str, Any] = {Columns.ACTIONS: _picked(acting.actions, question)}
    if isinstance(module.group.action, Box):
        told[Columns.ACTIONS] = told[Columns.ACTIONS].reshape(*question.shape, *module.group.action.shape)
    if acting.log_prob is not None:
        told[Columns.ACTION_LOGP] = _picked(acting.log_prob, question)
    if isinstance(module.head, CategoricalHead):
        told[Columns.ACTION_DIST_INPUTS] = _picked(acting.distribution, question).log().clamp(MASKED_LOGIT)
    if memory is not None:
        kept = _picked(memory, question)
        told[Columns.STATE_OUT] = {STATE: kept if len(question.shape) == 1 else kept[:, -1]}
    return told


def ask(group: Group, batch: Mapping[str, Any], *, recurrent: bool) -> Question:
    """Return a batch as a group's policy sees it; see `answer`."""
    seen, action_mask = _leaves(group, batch[Columns.OBS])
    name = next(iter(seen))
    axes = seen[name].dim() - len(group.observation[name].shape)
    shape = seen[name].shape[:axes]
    length = shape[1] if recurrent and axes == 2 else 1
    if axes == 2 and not recurrent:
        count, places = shape[0], torch.arange(group.size).repeat(shape[0])
        rows = torch.arange(count).repeat_interleave(group.size)
    else:
        count, places = shape.numel(), _places(group, batch, shape[0]).repeat_interleave(length)
        # Rows of the view are in order of time, then of sequence; those of the batch the other way round.
        rows = torch.arange(count).reshape(length, shape[0]).T.flatten()
    seen |= _carried(group, batch, shape, length)

    def spread(x: Tensor, fill: float = 0) -> Tensor:
        flat = x.flatten(0, axes - 1)
        whole = flat.new_full((count, group.size, *flat.shape[1:]), fill)
        whole[rows, places] = flat
        return whole

    alive = spread(torch.ones(shape, dtype=torch.bool))
    mask = None if action_mask is None else spread(action_mask.bool(), fill=True)
    leaves = {leaf: spread(x) for leaf, x in seen.items()}
    return Question(GroupView(leaves, alive, mask, length=length), rows, places, shape)


def _leaves(group: Group, seen: Any) -> tuple[dict[str, Tensor], Tensor | None]:
    """Return (leaves that come from the environment, action mask or None) of observations."""
    if not isinstance(seen, Mapping):
        return {"": _tensor(seen)}, None
    flat = _flat(seen)
    mask = flat.pop(MASK, None)
    if next(iter(group.observation)) == "" and len(flat) == 1 and next(iter(flat)) in WRAPPED:
        flat = {"": flat.popitem()[1]}
    inner = {name.partition("/")[2]: x for name, x in flat.items() if name.partition("/")[0] in WRAPPED}
    if not flat.keys() <= group.observation.keys():
        flat = inner
    return {name: flat[name] for name in group.observation if name in flat}, mask


def _tensor(leaf: Any) -> Tensor:
    """Return a leaf as networks read it: floating-point numbers are float32."""
    given = torch.as_tensor(leaf)
    return given.float() if given.is_floating_point() else given


def _flat(seen: Mapping[str, Any], path: tuple[str, ...] = ()) -> dict[str, Tensor]:
    flat = {}
    for name, part in seen.items():
        own = (*path, name) if name else path
        flat |= _flat(part, own) if isinstance(part, Mapping) else {"/".join(own): _tensor(part)}
    return flat


def _carried(group: Group, batch: Mapping[str, Any], shape: torch.Size, length: int) -> dict[str, Tensor]:
    """Return the leaves (*shape, ...) that a sampler would add."""
    found = {}
    for name, space in group.observation.items():
        if not name.startswith(CARRIED):
            continue
        given = batch.get(name)
        if name == MEMORY:
            given = (batch.get(Columns.STATE_IN) or {}).get(STATE)
            if given is not None and len(shape) == 2:
                given = torch.as_tensor(given).unsqueeze(1).expand(-1, length, -1)
        found[name] = torch.zeros(*shape, *space.shape) if given is None else torch.as_tensor(given).float()
    return found


def _places(group: Group, batch: Mapping[str, Any], count: int) -> Tensor:
    agents: Sequence[str] | None = batch.get(Columns.AGENT_ID)
    if agents is None:
        return torch.zeros(count, dtype=torch.int64)
    return torch.tensor([group.agents.index(agent) for agent in agents])


def _picked(x: Tensor, question: Question) -> Tensor:
    """Return (*shape, ...) of the agents asked about, of (rows, n, ...)."""
    return x[question.rows, question.places].unflatten(0, question.shape)
