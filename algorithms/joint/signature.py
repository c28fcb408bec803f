"""What a checkpoint fits: the settings that its networks were built from, agents, spaces and groups."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from algorithms.errors import CheckpointError

SEQUENCES = "sequence_length of the replay buffer"
"""Compared only where both say it: checkpoints without a replay buffer do not."""


def check_signature(stored: Mapping[str, Any], own: Mapping[str, Any]) -> None:
    """Raise if a checkpoint was made with other settings, agents or spaces.

    Args:
        stored: Signature in the checkpoint.
        own: Signature of the training that loads it.

    Raises:
        CheckpointError: They differ; it names where.
    """
    compared = {*stored, *own} - ({SEQUENCES} - (stored.keys() & own.keys()))
    differing = sorted(name for name in compared if stored.get(name) != own.get(name))
    if differing:
        lines = "; ".join(f"{n}: {stored.get(n)} there, {own.get(n)} here" for n in differing)
        raise CheckpointError(
            f"the checkpoint does not fit: {lines}",
            place="checkpoint",
            remedy="build it with the environment and settings that the checkpoint was made with",
        )
