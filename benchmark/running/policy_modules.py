"""The policy networks of a run's checkpoint, without learners and without Ray."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from algorithms.joint.module import LearnerModule
from algorithms.joint.signature import check_signature
from benchmark.experiment.runs import Run
from benchmark.results.files import ResultsError
from benchmark.running.training import check_checkpoint, config_of, unpickled


def checked_modules(run: Run, checkpoint: Path) -> dict[str, Any]:
    """Return the policy networks of a run's checkpoint by group.

    Raises:
        ResultsError: The checkpoint is damaged.
        CheckpointError: The run's algorithm, or a setting of its networks, is another than the checkpoint's.
    """
    check_checkpoint(checkpoint)
    built = unpickled(checkpoint / "env_runner" / "class_and_ctor_args.pkl")["ctor_args_and_kwargs"][1]
    check_signature(built["config"].checkpoint_signature(), config_of(run).checkpoint_signature())
    return policy_modules(checkpoint)


def policy_modules(checkpoint: Path) -> dict[str, Any]:
    """Return the policy networks of a checkpoint by group.

    Raises:
        ResultsError: It is damaged.
    """
    root = checkpoint / "learner_group" / "learner" / "rl_module"
    folders = sorted(root.glob("*/"))
    described = {folder: unpickled(folder / "class_and_ctor_args.pkl") for folder in folders}
    made = {
        folder.name: _module(folder, given)
        for folder, given in described.items()
        if not issubclass(given["class"], LearnerModule)  # critics, mixers
    }
    groups = [group.id for group in next(iter(made.values())).spec.groups] if made else []
    if not made or not {*groups} <= made.keys():
        raise ResultsError("holds no policy of each group", place=str(root), remedy="train it further")
    return {group: made[group] for group in groups}


def _module(folder: Path, described: Mapping[str, Any]) -> Any:
    """Return a network, as it is described, with the weights of a checkpoint."""
    named = described["ctor_args_and_kwargs"][1]
    wanted = {key: named[key] for key in ("observation_space", "action_space", "model_config")}
    with _quiet():
        module = described["class"](**wanted, inference_only=True)
    module.set_state(unpickled(folder / "module_state.pkl"))
    module.eval()
    return module


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep RLlib from warning of what its own constructor of modules does."""
    before = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        yield
    finally:
        logging.disable(before)
