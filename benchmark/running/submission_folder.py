"""The folder of an evaluated submission: verdicts, runs, and what is to be handed in.

verdicts.json                   digest of the manifest, seed of the fresh episodes, all verdicts
ALGORITHM/TASK/TRAFFIC/seed_N/  a run's folder, whose run.json says in `submission` what it is
submission/                     of a submission without claims: the same with claims
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmark.experiment.version import CODE, ENVIRONMENT, versions
from benchmark.metrics import read_table
from benchmark.results.files import (
    ResultsError,
    locked,
    read_mapping,
    replace_folder,
    write_files,
    write_json,
)
from benchmark.results.release import (
    ADDRESS,
    FRESH_SEED,
    MANIFEST,
    POLICIES,
    SUBMISSION,
    VERDICTS,
    Entry,
    Manifest,
    Verdict,
    episode_digests,
    scores_of,
)
from benchmark.results.run_folder import FINISHED, SCENARIOS, RunFolder
from benchmark.running.submitted_policies import files_of
from smarts_agent_kit.weights import file_digest


def open_evaluation(manifest: Manifest, out: Path) -> int:
    """Begin or resume an evaluation, and return the seed of its fresh episodes.

    Raises:
        ResultsError: The folder holds anything but an evaluation of the same submission.
    """
    file, another = out / VERDICTS, "choose another --out"
    others = sorted(each.name for each in out.glob("[!.]*") if each != file)
    said = read_mapping(file, remedy=another) if file.exists() else {}
    if said.get(SUBMISSION) == _digest_of(manifest):
        return said[FRESH_SEED]
    # Where nothing was played, a wrong address may have been given.
    if others or said.get("verdicts"):
        told = "the evaluation of another submission" if said else f"something else: {', '.join(others[:5])}"
        raise ResultsError(f"holds {told}", place=str(out), remedy=another)
    seed = secrets.randbits(31)
    write_verdicts(manifest, out, seed, ())
    return seed


def _digest_of(manifest: Manifest) -> str:
    return file_digest(json.dumps(manifest.content(), sort_keys=True).encode())


def write_verdicts(manifest: Manifest, out: Path, seed: int, verdicts: Sequence[Verdict]) -> None:
    """Write verdicts.json.

    Args:
        manifest: Of the submission.
        out: The folder.
        seed: Of the fresh episodes.
        verdicts: Of its policies.
    """
    content = {
        "benchmark_version": manifest.benchmark_version,
        SUBMISSION: _digest_of(manifest),
        FRESH_SEED: seed,
        "verdicts": [asdict(each) for each in verdicts],
    }
    write_json(out / VERDICTS, content)


def identity(manifest: Manifest, entry: Entry, folder: Path) -> str:
    """Return a digest of an entry and of the files of its policy as they are now."""
    files = {}
    if not entry.agent.startswith(ADDRESS):
        files = {file.name: file_digest(file.read_bytes()) for file in files_of(folder / entry.agent)}
    return file_digest(repr((_digest_of(manifest), entry.model_dump(), files)).encode())


def write_claims(manifest: Manifest, folder: Path, out: Path) -> Path | None:
    """Write a submission that claims what an evaluation of one without claims gave, and return its folder.

    It holds the policies that were evaluated, and nothing else of their folders.

    Returns:
        None if the submission claims something itself, or a policy was refused or has changed since.

    Raises:
        ResultsError: The folder is in use, or cannot be written to.
    """
    if any(entry.episodes for entry in manifest.policies):
        return None
    target = out / SUBMISSION
    with locked(out):
        for entry in manifest.policies:
            facts = RunFolder(out / entry.place).facts()
            if facts.get("status") != FINISHED:
                return None
            if facts[SUBMISSION]["entry"] != identity(manifest, entry, folder):
                return None
        replace_folder(target, lambda partial: _write_claims(manifest, folder, out, partial))
    return target


def _write_claims(manifest: Manifest, folder: Path, out: Path, partial: Path) -> None:
    number = manifest.benchmark_version
    assert number is not None
    frozen = versions()[number]
    entries: list[Entry] = []
    played: dict[str, dict[str, str]] = {}
    for entry in manifest.policies:
        place = RunFolder(out / entry.place)
        table = read_table(place.table)
        given: dict[str, Any] = {"scores": scores_of(table), "episodes": episode_digests(table)}
        if not entry.agent.startswith(ADDRESS):
            name = f"{POLICIES}/{'_'.join((entry.algorithm, entry.task, entry.traffic, str(entry.seed)))}"
            files = {file.name: file.read_bytes() for file in files_of(folder / entry.agent)}
            write_files(partial / name, files)
            given["agent"] = name
            given["files"] = {each: file_digest(content) for each, content in files.items()}
        entries.append(entry.model_copy(update=given))
        played.setdefault(entry.traffic, {}).update(place.facts()[SCENARIOS])
    claimed = manifest.model_copy(
        update={
            "code": {part: frozen[part] for part in CODE},
            "environment": frozen[ENVIRONMENT],
            "scenarios": played,
            "policies": entries,
        }
    )
    write_json(partial / MANIFEST, claimed.content())
