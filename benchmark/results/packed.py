"""Finished runs and plays of an experiment in few files, as git keeps them; `results/pack.py` writes them.

runs.json         place of a run -> contents of its run.json and config.yaml, counts of its episodes
progress.parquet  lines of all progress.csv
episodes.parquet  agent-episodes of all tests
robustness/       runs.json: place of a play -> content of its play.json; episodes.parquet
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmark.results.files import read_versioned
from benchmark.results.run_folder import BUDGET, RunFolder

RUNS, PROGRESS = "runs.json", "progress.parquet"
PLACE = "place"
"""Column of the run's or play's folder, relative to the experiment's."""


def packed_contents(root: Path) -> dict[str, Any]:
    """Return place -> content of what is packed in a folder."""
    return read_versioned(root / RUNS) if (root / RUNS).exists() else {}


def run_folder(root: Path, place: Path, packed: Mapping[str, Any]) -> RunFolder:
    """Return a run's folder, or what is packed of it, if there is no folder.

    Args:
        root: Of the experiment.
        place: Of the run.
        packed: Of `packed_contents`.
    """
    folder, content = RunFolder(root / place), packed.get(place.as_posix())
    return folder if content is None or folder.run.exists() else PackedRun(folder.path, content)


class PackedRun(RunFolder):
    """A finished run that is packed: what its folder would say of it."""

    def __init__(self, path: Path, content: Mapping[str, Any]) -> None:
        super().__init__(path)
        self._packed = content

    def facts(self) -> dict[str, Any]:
        """Return the content of run.json."""
        return dict(self._packed["run"])

    def read_config(self) -> dict[str, Any]:
        """Return the content of config.yaml."""
        return dict(self._packed["config"])

    @property
    def has_lost_checkpoint(self) -> bool:
        """Whether it was trained."""
        return BUDGET in self._packed["config"]

    @property
    def has_table(self) -> bool:
        """Whether the test's table is there, packed with those of other runs."""
        return True
