"""Frozen policies of another run, which learners keep near to."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import torch
from ray import cloudpickle

from algorithms.errors import CheckpointError
from algorithms.joint.batch import GroupView
from algorithms.joint.module import JointModule, LearnerModule
from algorithms.joint.spec import Group

DESCRIBED = "class_and_ctor_args.pkl"
"""File in a network's folder, in which RLlib says how it is made."""


class ReferencePolicy:
    """The policies of a run's last checkpoint.

    Args:
        run: Folder of the run, of a checkpoint, or of its networks.
        policies: The ones that learn, by group; each keeps near to the one of its name, or to the only one.
        device: Where they are.

    Raises:
        CheckpointError: There is no checkpoint, or its policies see or do something else.
    """

    def __init__(self, run: str, policies: Mapping[str, JointModule], device: Any) -> None:
        networks = "learner_group/learner/rl_module"
        places = Path(run, "checkpoint", networks), Path(run, networks), Path(run)
        folder = next((place for place in places if place.is_dir()), places[0])
        made = policies_in(file.parent for file in folder.glob(f"*/{DESCRIBED}"))
        only = next(iter(made.values())) if len(made) == 1 else None
        self._modules: dict[str, Any] = {group: made.get(group, only) for group in policies}
        for group, policy in policies.items():
            module = self._modules[group]
            if module is None or not _fits(module, policy):
                problem = "has no checkpoint" if not made else f"has no policy that fits {group!r}"
                remedy = "name a run of bc or ppo with the same observation and action, and `sharing: all`"
                raise CheckpointError(problem, place="kl_to", remedy=remedy)
            module.to(device).requires_grad_(False)

    def distribution(self, groups: Sequence[Group], views: Mapping[str, GroupView], head: Any) -> Any:
        """Return the policy of some groups' agents, side by side; views by group."""
        with torch.no_grad():
            outputs = [self._modules[group.id].policy(views[group.id]) for group in groups]
        masks = [mask for group in groups if (mask := views[group.id].action_mask) is not None]
        return head.distribution(torch.cat(outputs, 1), torch.cat(masks, 1) if masks else None)


def _read(file: Path) -> Any:
    return cloudpickle.loads(file.read_bytes())


def policies_in(networks: Iterable[Path], read: Callable[[Path], Any] = _read) -> dict[str, Any]:
    """Return the policies among a checkpoint's networks by group, with their weights.

    Args:
        networks: Folder of each.
        read: What reads their files.
    """
    found = {}
    for folder in sorted(networks):
        described = read(folder / DESCRIBED)
        if not issubclass(described["class"], LearnerModule):  # critics, mixers
            given = described["ctor_args_and_kwargs"][1]
            wanted = {key: given[key] for key in ("observation_space", "action_space", "model_config")}
            found[folder.name] = module = described["class"](**wanted, inference_only=True)
            module.set_state(read(folder / "module_state.pkl"))
            module.eval()
    return found


def _fits(there: JointModule, here: JointModule) -> bool:
    """Return whether a policy of another run acts for a group's agents, by their own observations alone."""
    shapes = [{name: leaf.shape for name, leaf in each.group.observation.items()} for each in (there, here)]
    is_alone = not (there.recurrent or here.recurrent or there.communicates or there.acts_jointly)
    is_alike = type(there.head) is type(here.head) and there.group.action == here.group.action
    return shapes[0] == shapes[1] and is_alone and is_alike and there.group.places in (1, here.group.places)
