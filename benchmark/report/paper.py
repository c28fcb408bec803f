"""The SMARTS paper's figures and names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import yaml

FILE = Path(__file__).with_name("paper.yaml")
PLACES: tuple[Literal["appendix", "main_text"], ...] = ("appendix", "main_text")


@dataclass(frozen=True)
class Printed:
    """A condition of one of the paper's two tables."""

    collision: float
    completion: float
    place: str
    """"appendix" or "main_text"."""


@cache
def paper() -> dict[str, Any]:
    """Return the file of the paper's figures and names."""
    content: dict[str, Any] = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    return content


def printed(algorithm: str, task: str, traffic: str) -> tuple[Printed, ...]:
    """Return what the paper prints for a condition: nothing, one pair, or two where its two tables differ.

    A task of version 1 is compared with its counterpart.
    """
    task = counterpart(task)
    found: dict[tuple[float, float], Printed] = {}
    for place in PLACES:
        pair = paper()[place].get(traffic, {}).get(task, {}).get(algorithm)
        if pair is not None:
            found.setdefault(tuple(pair), Printed(float(pair[0]), float(pair[1]), place))
    return tuple(found.values())


def misprint(algorithm: str, task: str, traffic: str) -> str:
    """Return why a condition of the paper looks like a misprint, "" if it does not."""
    return paper()["misprints"].get(traffic, {}).get(counterpart(task), {}).get(algorithm, "")


def counterpart(task: str) -> str:
    """Return the paper's task that a task of version 1 stands for, or the task itself."""
    return paper()["counterparts"].get(task, [task])[0]


def task_differences() -> list[list[str]]:
    """Return in what version 1 differs from the paper's tasks: what, the paper's, version 1's."""
    return paper()["differences"]


def impossible_sum(cells: Sequence[Printed]) -> str:
    """Return what is odd about two exclusive rates that sum to more than 1, "" if none do."""
    sums = (cell.collision + cell.completion for cell in cells)
    return ", ".join(f"the paper's two rates sum to {each:.2f}" for each in sums if each > 1.0 + 1e-9)


def algorithm_label(name: str) -> str:
    """Return the paper's name of an algorithm, or its own."""
    return paper()["algorithms"].get(name, name)


def task_label(name: str) -> str:
    """Return the paper's name of a task, or its own in words."""
    counterparts = {task: label for task, (_, label) in paper()["counterparts"].items()}
    return {**paper()["tasks"], **counterparts}.get(name, name.replace("_", " ").capitalize())


def condition_label(task: str, traffic: str) -> str:
    """Return the name of a condition: of its task and its traffic."""
    return f"{task_label(task)}, {traffic_label(traffic)}"


def traffic_label(name: str) -> str:
    """Return the paper's name of a kind of traffic, or its own in words."""
    return paper()["traffic"].get(name, name.replace("_", " ").capitalize())
