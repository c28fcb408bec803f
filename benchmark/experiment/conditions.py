"""Conditions that policies did not meet in training: what differs from the experiment's environment."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from benchmark.experiment.environment import Environment
from smarts.config import Section, fitted
from smarts.errors import UnknownNameError, nearest_names

FILE = Path(__file__).with_name("conditions.yaml")
AS_TRAINED = "as_trained"
"""Condition of cross-play: the environment is that of the training."""


class Condition(Section):
    """An entry of `conditions.yaml`."""

    label: str
    """Label in tables."""
    meaning: str
    environment: dict[str, Any]
    """Keys of an experiment's `environment` that differ."""

    def of(self, environment: Environment) -> Environment:
        """Return an environment under this condition.

        Raises:
            ConfigError: A key is unknown, or its value does not fit.
        """
        return fitted({**environment.model_dump(mode="json"), **self.environment}, Environment)


@cache
def conditions() -> Mapping[str, Condition]:
    """Return all conditions by name, in the order of the file.

    Raises:
        ConfigError: An entry does not fit.
    """
    entries = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    return {name: fitted(entry, Condition, name) for name, entry in entries.items()}


def condition(name: str) -> Condition:
    """Return a condition.

    Raises:
        UnknownNameError: No condition has this name.
    """
    if name not in conditions():
        raise UnknownNameError(
            f"there is no condition {name!r}", place="--condition", remedy=nearest_names(name, conditions())
        )
    return conditions()[name]
