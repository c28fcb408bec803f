"""Versions and commits of the runs of an experiment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmark.experiment.environment import Environment
from benchmark.experiment.version import changed_settings
from benchmark.results.files import ResultsError
from benchmark.results.reading import RunResult
from benchmark.results.run_folder import CONTINUED
from smarts.config import ConfigError, fitted

NONE = "of no version"


def check_one_version(runs: Sequence[RunResult], place: str) -> None:
    """Check that all finished runs are of one version of the benchmark.

    Args:
        runs: Finished or not.
        place: Named in the error.

    Raises:
        ResultsError: They are not; names the runs of each version.
    """
    found: dict[int | None, list[str]] = {}
    for run in runs:
        if run.table is not None:
            found.setdefault(run.benchmark_version, []).append(str(run))
    if len(found) > 1:
        said = "; ".join(f"{_named(version)}: {', '.join(names)}" for version, names in found.items())
        raise ResultsError(
            f"results of several versions of the benchmark are not mixed: {said}",
            place=place,
            remedy="keep each version in a folder of its own",
        )


def commits_of(run: RunResult) -> list[str]:
    """Return the distinct commits of a run, that of its beginning first."""
    facts = (run.facts, *run.facts.get(CONTINUED, ()))
    return [*dict.fromkeys(str(each.get("commit") or "") for each in facts)]


def unlike_version(version: int, environment: Mapping[str, Any]) -> list[str]:
    """Return the settings of an environment that are not as a version froze them; none of an empty one."""
    if not environment:
        return []
    try:
        return changed_settings(version, fitted(environment, Environment))
    except (ConfigError, RecursionError):
        return ["(unreadable)"]


def _named(version: int | None) -> str:
    return NONE if version is None else f"version {version}"
