"""Evaluated submissions, as a leaderboard lists them: what was claimed, what came out, and marks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmark.report.paper import algorithm_label, task_label, traffic_label
from benchmark.results.files import ResultsError, read_mapping
from benchmark.results.release import CONFIRMED, MARKED, REFUSED, VERDICTS


@dataclass(frozen=True)
class Submitted:
    """A policy of a submission after its evaluation."""

    experiment: str
    """Folder of its results."""
    name: str
    author: str
    algorithm: str
    task: str
    traffic: str
    seed: int
    status: str
    """confirmed, marked or refused."""
    reasons: tuple[str, ...]
    claimed: Mapping[str, float]
    scores: Mapping[str, float]
    digests: tuple[int, int]
    """Equal ones, of those compared."""

    @property
    def label(self) -> str:
        """Name of the algorithm."""
        return algorithm_label(self.algorithm)

    @property
    def cell(self) -> str:
        """Name of the cell."""
        return f"{task_label(self.task)}, {traffic_label(self.traffic)}"

    @property
    def rates(self) -> Iterator[tuple[str, str]]:
        """Completion and collision rate, as claimed and as re-derived."""
        for name in ("completion_rate", "collision_rate"):
            yield _text(self.claimed.get(name)), _text(self.scores.get(name))


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def read_submitted(root: Path, experiment: str) -> list[Submitted]:
    """Return the policies of a folder that `smarts-bench verify` has written; none of any other folder.

    Raises:
        ResultsError: The verdicts are damaged.
    """
    file = root / VERDICTS
    if not file.exists():
        return []
    try:
        return [_submitted(each, experiment) for each in read_mapping(file)["verdicts"]]
    except (KeyError, TypeError, ValueError) as error:
        raise ResultsError(
            f"damaged: {type(error).__name__}: {error}", place=str(file), remedy="verify the submission again"
        ) from error


def _submitted(said: Mapping[str, Any], experiment: str) -> Submitted:
    names = ("name", "author", "algorithm", "task", "traffic", "seed", "status")
    equal, compared = said["digests"]
    return Submitted(
        experiment,
        **{name: said[name] for name in names},
        reasons=tuple(map(str, said["reasons"])),
        claimed=dict(said["claimed"]),
        scores=dict(said["scores"]),
        digests=(int(equal), int(compared)),
    )


def statuses(submitted: Sequence[Submitted]) -> dict[tuple[str, str, str, str], str]:
    """Return by folder, algorithm, task and traffic the worst status of the seeds."""
    order = (CONFIRMED, MARKED, REFUSED)
    found: dict[tuple[str, str, str, str], str] = {}
    for each in submitted:
        key = each.experiment, each.algorithm, each.task, each.traffic
        found[key] = max(found.get(key, order[0]), each.status, key=order.index)
    return found
