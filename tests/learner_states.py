"""What learners store in a checkpoint, value by value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from ray import cloudpickle

LEARNER = "learner_group"
OTHERWISE = ("weights_seq_no", "metrics_logger")
"""What differs on purpose: restored weights get a new number, and metrics begin with the process."""


def values_in(checkpoint: Path) -> dict[str, Any]:
    """Return all that learners stored in a checkpoint's folder by its place: arrays and single values.

    Raises:
        FileNotFoundError: It holds nothing of a learner.
        TypeError: It holds an object whose parts are not known, so that it could not be compared.
    """
    found = {}
    for file in sorted((checkpoint / LEARNER).rglob("*state.pkl")):
        with file.open("rb") as opened:
            place = file.relative_to(checkpoint).with_suffix("").as_posix()
            found |= dict(_leaves(cloudpickle.load(opened), place))
    if not found:
        raise FileNotFoundError(f"{checkpoint / LEARNER} holds no state of a learner")
    return found


def _leaves(node: Any, place: str) -> Iterator[tuple[str, Any]]:
    if is_dataclass(node) and not isinstance(node, type):
        node = {each.name: getattr(node, each.name) for each in fields(node)}
    if isinstance(node, torch.Tensor):
        node = node.detach().cpu().numpy()
    if isinstance(node, Mapping):
        yield f"{place}/", sorted(map(repr, node))
        for key, value in node.items():
            if key not in OTHERWISE:
                yield from _leaves(value, f"{place}/{key}")
    elif isinstance(node, list | tuple):
        yield f"{place}/", len(node)
        for number, value in enumerate(node):
            yield from _leaves(value, f"{place}/{number}")
    elif node is None or isinstance(node, np.ndarray | np.generic | bool | int | float | str):
        yield place, node
    else:
        raise TypeError(f"{place}: {type(node).__name__} cannot be compared")


def differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Return the places at which two results of `values_in` differ, or which one of them lacks."""
    return [
        place
        for place in sorted({*one, *other})
        if not (place in one and place in other) or not _is_same(one[place], other[place])
    ]


def _is_same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        alike = one.dtype == other.dtype and one.shape == other.shape
        return alike and one.tobytes() == other.tobytes()
    return type(one) is type(other) and repr(one) == repr(other)
