"""Evaluated submissions, as a leaderboard lists them: what was claimed, what came out, and marks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from algorithms.registry import ALGORITHMS
from benchmark.report.paper import algorithm_label, cell_label
from benchmark.results.files import read_mapping
from benchmark.results.release import ADDRESS, CONFIRMED, MARKED, RATES, REFUSED, SEEDS, VERDICTS, Verdict

MAY_EXCHANGE = "its vehicles may tell each other what they see"
"""Remark on an agent at an address, and on an unknown algorithm: neither can be checked from outside."""


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
    def condition(self) -> str:
        """Label of task and traffic."""
        return cell_label(self.task, self.traffic)

    @property
    def remarks(self) -> list[str]:
        """What is wrong with the policy, and what cannot be checked."""
        is_open = self.agent.startswith(ADDRESS) or self.algorithm not in ALGORITHMS
        return [*self.reasons, MAY_EXCHANGE] if is_open else [*self.reasons]

    @property
    def rates(self) -> Iterator[tuple[str, str]]:
        """Completion and collision rate, as claimed and as re-derived."""
        for name in RATES:
            given = self.claimed.get(name), self.scores.get(name)
            claimed, derived = ("-" if value is None else f"{value:.3f}" for value in given)
            yield claimed, derived


def read_submitted(root: Path, experiment: str) -> list[Submitted]:
    """Return the policies of a folder that `smarts-bench verify` has written; none of any other folder.

    Args:
        root: The folder.
        experiment: Its name.
    """
    said = read_mapping(root / VERDICTS)["verdicts"] if (root / VERDICTS).exists() else []
    return [Submitted(**each, experiment=experiment) for each in said]


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
