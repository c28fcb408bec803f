"""The SMARTS paper's figures, and whether a result is non-inferior to them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import yaml

from benchmark.statistics import wilson_interval

FILE = Path(__file__).with_name("paper.yaml")
PLACES: tuple[Literal["appendix", "main_text"], ...] = ("appendix", "main_text")


@dataclass(frozen=True)
class Printed:
    """A cell of one of the paper's two tables."""

    collision: float
    completion: float
    place: str
    """"appendix" or "main_text"."""

    @property
    def worst(self) -> tuple[float, float]:
        """Highest collision and lowest completion rate that the cell's 40 agent-episodes do not exclude.

        Bounds of Wilson's 95% intervals, as if agent-episodes were independent, which favours the paper.
        """
        count = paper()["agent_episodes"]
        highest = wilson_interval(self.collision, count)[1]
        lowest = wilson_interval(self.completion, count)[0]
        return float(highest), float(lowest)

    def is_matched_by(self, collision: float, completion: float) -> bool:
        """Return whether two rates are within the bounds of `worst`."""
        highest, lowest = self.worst
        return collision <= highest and completion >= lowest


@cache
def paper() -> dict[str, Any]:
    """Return the file of the paper's figures and names."""
    content: dict[str, Any] = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    return content


def printed(algorithm: str, task: str, traffic: str) -> tuple[Printed, ...]:
    """Return what the paper prints for a cell: nothing, one pair, or two where its two tables differ."""
    found: dict[tuple[float, float], Printed] = {}
    for place in PLACES:
        pair = paper()[place].get(traffic, {}).get(task, {}).get(algorithm)
        if pair is not None:
            found.setdefault(tuple(pair), Printed(float(pair[0]), float(pair[1]), place))
    return tuple(found.values())


def is_non_inferior(cells: tuple[Printed, ...], collision: float, completion: float) -> bool | None:
    """Return whether two rates are non-inferior to all printed variants of a cell; None without any."""
    return all(cell.is_matched_by(collision, completion) for cell in cells) if cells else None


def algorithm_label(name: str) -> str:
    """Return the paper's name of an algorithm, or its own."""
    return paper()["algorithms"].get(name, name)


def task_label(name: str) -> str:
    """Return the paper's name of a task, or its own in words."""
    return paper()["tasks"].get(name, name.replace("_", " ").capitalize())


def traffic_label(name: str) -> str:
    """Return the paper's name of a kind of traffic, or its own in words."""
    return paper()["traffic"].get(name, name.replace("_", " ").capitalize())
