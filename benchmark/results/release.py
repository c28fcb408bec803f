"""Releases and submissions: policies, and what is claimed of them, in a folder with a manifest.

manifest.json    what is claimed: version, commit, digests, scores, digests of episodes
policies/NAME/   an exported policy; see `smarts-bench export`
verdicts.json    in a folder of `smarts-bench verify`: what its own episodes say of the claims
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, PlainSerializer

from benchmark.experiment.values import FolderName
from benchmark.metrics.results import Frame, compute
from benchmark.results.digests import check_files
from benchmark.results.files import ResultsError, read_json
from smarts.config import Section, fitted

RATES = ("completion_rate", "collision_rate")
"""Metrics that every table has, with a number for each agent that took part. Columns of other metrics may be
absent or lack numbers: the metric is n/a then."""

MANIFEST, POLICIES, VERDICTS = "manifest.json", "policies", "verdicts.json"
SUBMISSION = "submission"
"""Key of run.json and verdicts.json: which submission was played. Folder of one that gets its claims."""
CONFIRMED, MARKED, REFUSED = "confirmed", "marked", "refused"
"""Status of an evaluated policy, from good to bad."""
LARGEST_FILE, LARGEST = 1_000_000, 60_000_000
"""Bytes of one file, and of all."""
SEEDS = 3
"""Training seeds that an entry of a version has at least."""
ADDRESS = "tcp://"
_NAMES = ("traffic", "seed", "world", "agent", "outcome", "is_invalid")
_NUMBERS = ("start_x", "start_y", "start_heading", "start_speed", "duration", "distance_travelled")


_Digests = Annotated[
    list[str],
    BeforeValidator(lambda given: given.split() if isinstance(given, str) else given),
    PlainSerializer(" ".join, return_type=str, when_used="json"),
]
"""A list of digests, which a manifest holds as one line."""


class Training(Section):
    """What names a training: in an exported policy, in a manifest and in a verdict."""

    algorithm: FolderName
    task: FolderName
    scenarios: Annotated[list[str], Field(min_length=1)]
    traffic: FolderName
    seed: Annotated[int, Field(ge=0, lt=2**31)]
    benchmark_version: int | None = None

    def __str__(self) -> str:
        return f"{self.condition}, seed {self.seed}"

    @property
    def place(self) -> Path:
        """Folder of its results, within a folder of evaluated submissions."""
        return Path(self.algorithm, self.task, self.traffic, f"seed_{self.seed}")

    @property
    def condition(self) -> str:
        """Algorithm, task and traffic."""
        return f"{self.algorithm}, {self.task}, {self.traffic}"

    @property
    def names(self) -> dict[str, Any]:
        """Names of the training alone."""
        return {name: getattr(self, name) for name in Training.model_fields}


class Entry(Training):
    """A policy, and what is claimed of it."""

    agent: str
    """Folder of an exported policy, relative to the manifest's, or tcp://HOST:PORT."""
    commit: str = ""
    """Commit that trained it."""
    files: dict[str, str] = Field(default_factory=dict)
    """Name -> digest, of the folder."""
    scores: dict[str, Annotated[float, Field(allow_inf_nan=False)]] = Field(default_factory=dict)
    """Metric -> value, of all test episodes that are not held out."""
    episodes: dict[str, _Digests] = Field(default_factory=dict)
    """Scenario -> digest of each test episode, in their order; held-out variations too."""

    @property
    def is_remote(self) -> bool:
        """Whether it acts at an address."""
        return self.agent.startswith(ADDRESS)


class Manifest(Section):
    """What a release or a submission claims."""

    format: Literal[1] = 1
    name: FolderName
    author: str = ""
    benchmark_version: int | None
    program: str = ""
    """Version of the program that wrote it."""
    code: dict[str, str] = Field(default_factory=dict)
    """Part -> digest of the code of observations, rewards and metrics."""
    environment: dict[str, Any] = Field(default_factory=dict)
    scenarios: dict[str, dict[str, str]] = Field(default_factory=dict)
    """Traffic -> scenario -> digest of what was played."""
    missing: list[str] = Field(default_factory=list)
    """What the release lacks, in words."""
    policies: Annotated[list[Entry], Field(min_length=1)]

    def content(self) -> dict[str, Any]:
        """Return it as it is written."""
        return self.model_dump(mode="json")


class Verdict(Training):
    """What is known of a submitted policy after its evaluation, as verdicts.json has it."""

    name: str
    """Name of the submission."""
    author: str
    agent: str
    """Folder of the exported policy, or an address."""
    status: str
    """`CONFIRMED`, `MARKED` or `REFUSED`."""
    reasons: list[str]
    """Why it is marked or refused."""
    claimed: dict[str, float]
    scores: dict[str, float] = Field(default_factory=dict)
    """Scores as re-derived; empty if refused."""
    digests: list[int] = Field(default=[0, 0])
    """Number of episodes as claimed, and of those compared."""
    fresh: dict[str, float] = Field(default_factory=dict)
    """Scores of the fresh episodes; empty without any."""
    knows_test: bool = False
    """Whether the policies of its condition do better in the public test than in fresh episodes."""


def read_manifest(folder: Path) -> Manifest:
    """Return the manifest of a release.

    Raises:
        SmartsError: The manifest is missing, damaged or too large; names each wrong value.
    """
    file = folder / MANIFEST
    if file.exists() and file.stat().st_size > LARGEST_FILE:
        raise ResultsError(
            f"has {file.stat().st_size:,} bytes, and may have {LARGEST_FILE:,}",
            place=str(file),
            remedy="give a folder that `smarts-bench release` has written",
        )
    return fitted(read_json(file, "get it again from where it came"), Manifest, str(file))


def check_released(policy: Path) -> None:
    """Raise if a policy lies in a release, and is not as its manifest says; others are accepted.

    Raises:
        ResultsError: A file has changed, or the manifest is damaged.
    """
    folder = policy.absolute().parent.parent
    if not (folder / MANIFEST).exists():
        return
    name = policy.absolute().relative_to(folder).as_posix()
    for entry in read_manifest(folder).policies:
        if entry.agent == name:
            check_files(policy, entry.files, "get the release again from where it came")


def episode_digests(table: Frame) -> dict[str, list[str]]:
    """Return a digest of each greedy test episode, by scenario, in the order of their indices.

    A digest is of how each agent started and ended, when, and how far it drove [m], to the micrometre: other
    actions give other digests. Invalid episodes have one, too.
    """
    rows = table[table["mode"] == "greedy"]
    names = rows["scenario"].where(rows["variation"] == "", rows["scenario"] + "@" + rows["variation"])
    found: dict[str, list[str]] = {}
    kept = rows[[*_NAMES, *_NUMBERS]]
    for (name, _), episode in kept.groupby([names.rename("_name"), "world"], sort=True):
        found.setdefault(str(name), []).append(_digest_of(episode))
    return found


def _digest_of(episode: Frame) -> str:
    ordered = episode.sort_values("agent")
    lines = [
        [str(each[name]) for name in _NAMES] + [f"{np.float64(each[name]):z.6f}" for name in _NUMBERS]
        for each in ordered.to_dict("records")
    ]
    return hashlib.blake2b(json.dumps(lines).encode(), digest_size=6).hexdigest()


def scores_of(table: Frame) -> dict[str, float]:
    """Return the rates of a test's episodes that are not held out, of those that can be computed."""
    rows = table[(table["split"] != "held_out") & (table["mode"] == "greedy")]
    found = compute(rows, metrics=RATES).to_dict("records")
    return {row["metric"]: round(float(row["value"]), 6) for row in found if np.isfinite(row["value"])}
