"""Evaluated submissions, as a leaderboard lists them: what was claimed, what came out, and marks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

from algorithms.registry import ALGORITHMS
from benchmark.report.paper import algorithm_label, cell_label
from benchmark.results.files import read_mapping
from benchmark.results.reading import RunResult
from benchmark.results.release import (
    ADDRESS,
    CONFIRMED,
    MARKED,
    REFUSED,
    SEEDS,
    SUBMISSION,
    VERDICTS,
    Verdict,
)

MAY_EXCHANGE = "its vehicles may tell each other what they see"
"""Remark on an agent at an address, and on an unknown algorithm: neither can be checked from outside."""


@dataclass(frozen=True)
class Submitted(Verdict):
    """A policy of a submission after its evaluation."""

    experiment: str
    """Folder of its results."""

    @property
    def label(self) -> str:
        """Name of the algorithm."""
        return algorithm_label(self.algorithm)

    @property
    def key(self) -> tuple[str, str, str, str]:
        """Folder, algorithm, task and traffic."""
        return self.experiment, self.algorithm, self.task, self.traffic

    @property
    def cell(self) -> str:
        """Name of the cell."""
        return cell_label(self.task, self.traffic)

    @property
    def remarks(self) -> list[str]:
        """What is wrong with the policy, and what cannot be checked."""
        is_open = self.agent.startswith(ADDRESS) or self.algorithm not in ALGORITHMS
        return [*self.reasons, MAY_EXCHANGE] if is_open else [*self.reasons]

    @property
    def rates(self) -> Iterator[tuple[str, str]]:
        """Completion and collision rate, as claimed and as re-derived."""
        for name in ("completion_rate", "collision_rate"):
            yield _text(self.claimed.get(name)), _text(self.scores.get(name))


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def has_no_runs(root: Path) -> bool:
    """Return whether a folder holds verdicts of `smarts-bench verify`, and no policy that was played."""
    return (root / VERDICTS).exists() and not any(root.glob("*/*/*/seed_*/run.json"))


def read_submitted(root: Path, experiment: str, runs: Iterable[RunResult]) -> list[Submitted]:
    """Return the policies of a folder that `smarts-bench verify` has written; none of any other folder.

    The verdict on a policy that was played is in its run.json; refused ones are in verdicts.json.

    Args:
        root: The folder.
        experiment: Its name.
        runs: Its finished runs.
    """
    file = root / VERDICTS
    found = [_submitted(run.facts[SUBMISSION], experiment) for run in runs if SUBMISSION in run.facts]
    said = read_mapping(file)["verdicts"] if file.exists() else []
    refused = [_submitted(each, experiment) for each in said if each["status"] == REFUSED]
    played = {(*each.key, each.seed) for each in found}
    return found + [each for each in refused if (*each.key, each.seed) not in played]


def _submitted(said: Mapping[str, Any], experiment: str) -> Submitted:
    return Submitted(**{each.name: said[each.name] for each in fields(Verdict)}, experiment=experiment)


class Mark(NamedTuple):
    """What is known of an algorithm of a submission in a cell."""

    status: str
    """The worst of its seeds."""
    knows_test: bool
    seeds: int
    """Number of its policies."""

    @property
    def is_ranked(self) -> bool:
        """Whether it can have a rank: seeds that were left out cannot be seen otherwise."""
        return self.seeds >= SEEDS and not self.knows_test


def marks_of(submitted: Sequence[Submitted]) -> dict[tuple[str, str, str, str], Mark]:
    """Return the marks by folder, algorithm, task and traffic."""
    order = (CONFIRMED, MARKED, REFUSED)
    found: dict[tuple[str, str, str, str], Mark] = {}
    for each in submitted:
        before = found.get(each.key, Mark(CONFIRMED, knows_test=False, seeds=0))
        worst = max(before.status, each.status, key=order.index)
        found[each.key] = Mark(worst, before.knows_test or each.knows_test, before.seeds + 1)
    return found
