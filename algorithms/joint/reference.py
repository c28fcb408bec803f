"""Frozen policies of another run, which learners keep near to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from ray import cloudpickle

from algorithms.errors import CheckpointError
from algorithms.joint.batch import GroupView
from algorithms.joint.module import LearnerModule, without_memory
from algorithms.joint.spec import Group


class ReferencePolicy:
    """The policies of a run's last checkpoint.

    Args:
        run: Folder of the run, or of a checkpoint.
        groups: The agents that learn; each keeps near to the policy of its name, or to the only one.
        device: Where they are.

    Raises:
        CheckpointError: There is no checkpoint, or its policies see or do something else.
    """

    def __init__(self, run: str, groups: Sequence[Group], device: Any) -> None:
        folder = Path(run, "checkpoint") if Path(run, "checkpoint").is_dir() else Path(run)
        found = sorted((folder / "learner_group/learner/rl_module").glob("*/class_and_ctor_args.pkl"))
        described = {file.parent: cloudpickle.loads(file.read_bytes()) for file in found}
        made = {
            place.name: _module(place, given)
            for place, given in described.items()
            if not issubclass(given["class"], LearnerModule)
        }
        only = next(iter(made.values())) if len(made) == 1 else None
        self._modules: dict[str, Any] = {group.id: made.get(group.id, only) for group in groups}
        for group in groups:
            module = self._modules[group.id]
            if module is None or not _fits(module.group, group):
                problem = "has no checkpoint" if not made else f"has no policy that fits {group.id!r}"
                remedy = "name a run with the same observation and action, and `sharing: all`"
                raise CheckpointError(problem, place=f"kl_to {run!r}", remedy=remedy)
            module.to(device).requires_grad_(False)

    def distribution(self, groups: Sequence[Group], views: Mapping[str, GroupView], head: Any) -> Any:
        """Return the policy of some groups' agents, side by side; views by group."""
        with torch.no_grad():
            outputs = [self._modules[group.id].policy(views[group.id]) for group in groups]
        masks = [mask for group in groups if (mask := views[group.id].action_mask) is not None]
        return head.distribution(torch.cat(outputs, 1), torch.cat(masks, 1) if masks else None)


def _module(folder: Path, described: Mapping[str, Any]) -> Any:
    given = described["ctor_args_and_kwargs"][1]
    wanted = {key: given[key] for key in ("observation_space", "action_space", "model_config")}
    module = described["class"](**wanted, inference_only=True)
    module.set_state(cloudpickle.loads((folder / "module_state.pkl").read_bytes()))
    return module


def _fits(there: Group, here: Group) -> bool:
    """Return whether a policy of another run acts for a group's agents."""
    shapes = [
        {name: leaf.shape for name, leaf in without_memory(each.observation).items()}
        for each in (there, here)
    ]
    return shapes[0] == shapes[1] and there.action == here.action and there.places in (1, here.places)
