"""The version of the benchmark that results are of: one for all, from one clean commit, as it was frozen."""

from __future__ import annotations

from collections.abc import Sequence

from benchmark.experiment.version import (
    ENVIRONMENT,
    changed_code,
    changed_scenarios,
    versions,
)
from benchmark.results.reading import RunResult
from benchmark.results.versions import commits_of, unlike_version


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
        for scenario in changed_scenarios(version, {run.traffic: run.scenarios}):
            found.setdefault(f"the scenario {scenario}", []).append(str(run))
        for name in unlike_version(version, run.config.get(ENVIRONMENT) or {}):
            found.setdefault(f"environment.{name}", []).append(str(run))
    lines = [f"Not as version {version} froze it: {x} of {', '.join(names)}." for x, names in found.items()]
    if "metrics" in changed_code(version):
        lines.append(f"This report's code of metrics is not as version {version} froze it.")
    return lines
