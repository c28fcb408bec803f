"""What an exported policy says that it was trained on."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain
from pathlib import Path
from typing import Any

from pydantic import Field

from benchmark.experiment.own_code import names_in
from benchmark.experiment.values import FolderName
from benchmark.results.release import Training
from smarts.config import ConfigError, Section, fitted
from smarts.errors import SmartsError, shown
from smarts.sstudio.locating import VARIATION_MARK, suite
from smarts_agent_kit.exported import TRAINED
from smarts_agent_kit.weights import CONTENT, ExportError, content_of

PROJECT = "smarts.zoo:"
"""Begins the locators of the project's own agents."""


class Tested(Section):
    """A condition of a test, whose scenarios are names of strangers: nothing is looked up or run yet."""

    name: FolderName
    scenarios: list[str]
    traffic: str | None = None
    seen: bool = False


class Trained(Training):
    """What a policy was trained on; `benchmark.running.exporting.trained_content` writes it."""

    environment: dict[str, Any]
    test: list[Tested] = Field(default_factory=list)
    """Conditions of its test, as `TaskSetting.test_content` has them."""


def trained_on(path: Path) -> Trained:
    """Return what an exported policy was trained on.

    Raises:
        SmartsError: The folder does not say, as those that earlier versions of `export` wrote; or it names
            code or files of this machine.
    """
    try:
        content = content_of(path)
        trained = fitted(content.get(TRAINED) or {}, Trained, TRAINED)
    except (ExportError, ConfigError) as error:
        raise SmartsError(
            f"does not say what the policy was trained on: {error}", place=str(path), remedy="export it again"
        ) from error
    if foreign := names_in([content.get("observation"), trained.environment], _is_foreign):
        raise SmartsError(
            f"names code or files of its author: {shown(foreign[0])}",
            place=str(path / CONTENT),
            remedy="of a training with own code, evaluate the run's folder instead",
        )
    return trained


def _is_foreign(text: str) -> bool:
    """Return whether a text may name code or files: "module:Class", "folder/file"."""
    return not text.startswith(PROJECT) and any(each in text for each in ":/\\")


def check_suite(trained: Trained, path: Path) -> None:
    """Raise if a policy names folders as scenarios: their files are programs, which would run here.

    Raises:
        SmartsError: It does.
    """
    tested = chain(*(each.scenarios for each in trained.test))
    if foreign := own_scenarios([*trained.scenarios, *tested]):
        raise SmartsError(
            f"was trained on {shown(foreign[0])}, which is no scenario of the suite",
            place=str(path / CONTENT),
            remedy="name the scenario yourself, by --scenario: a scenario's files are programs",
        )


def own_scenarios(names: Iterable[str]) -> list[str]:
    """Return those of some scenarios that are no part of the suite, each once."""
    return [*dict.fromkeys(name for name in names if name.partition(VARIATION_MARK)[0] not in suite())]
