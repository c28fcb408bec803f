"""Versions and commits of the runs of an experiment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from benchmark.experiment.environment import Environment
from benchmark.experiment.version import (
    ENVIRONMENT,
    Played,
    changed_code,
    changed_scenarios,
    changed_settings,
    versions,
)
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


def unlike_version(version: int, scenarios: Played, environment: Mapping[str, Any]) -> Iterator[str]:
    """Yield the scenarios, and the settings of an environment, that are not as a version froze them.

    Args:
        version: Version of the benchmark.
        scenarios: Digests of what was played.
        environment: The settings; empty if they are not known.
    """
    for name in changed_scenarios(version, scenarios):
        yield f"scenario {name}"
    try:
        changed = changed_settings(version, fitted(environment, Environment)) if environment else []
    except (ConfigError, RecursionError):
        changed = ["(unreadable)"]
    yield from (f"environment.{name}" for name in changed)


def _named(version: int | None) -> str:
    return NONE if version is None else f"version {version}"


def version_lines(runs: Sequence[RunResult]) -> list[str]:
    """Return sentences on the version and the commits of finished runs, and in what they do not fit it.

    Runs of no version have none.
    """
    finished = [run for run in runs if run.table is not None]
    if not finished:
        return []
    version = finished[0].benchmark_version
    if version is None:
        return []
    commits: dict[str, list[str]] = {}
    for run in finished:
        commits.setdefault(", then ".join(commits_of(run)), []).append(str(run))
    (first, *others) = commits
    if not others and first and "+" not in first and "," not in first:
        return [f"Benchmark version {version}, commit {first}.", *_changed(version, finished)]
    said = "; ".join(f"{commit or 'unknown'}: {', '.join(names)}" for commit, names in commits.items())
    marked = f"These are not of one clean commit (+: with changes that were not committed): {said}."
    return [f"Benchmark version {version}. {marked}", *_changed(version, finished)]


def _changed(version: int, runs: Sequence[RunResult]) -> list[str]:
    if version not in versions():
        return [f"This program does not know what version {version} froze."]
    found: dict[str, list[str]] = {}
    for run in runs:
        environment = run.config.get(ENVIRONMENT) or {}
        for name in unlike_version(version, {run.traffic: run.scenarios}, environment):
            found.setdefault(name, []).append(str(run))
    lines = [f"Not as version {version} froze it: {x} of {', '.join(names)}." for x, names in found.items()]
    if "metrics" in changed_code(version):
        lines.append(f"This report's code of metrics is not as version {version} froze it.")
    return lines
