"""Results of one version of the benchmark."""

from __future__ import annotations

from collections.abc import Sequence

from benchmark.results.files import ResultsError
from benchmark.results.reading import RunResult

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


def _named(version: int | None) -> str:
    return NONE if version is None else f"version {version}"
