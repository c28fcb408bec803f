"""Digests of files, by which checkpoints and released policies are known to be as they were written."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from benchmark.results.files import ResultsError, read_json
from smarts_agent_kit.weights import file_digest

DIGESTS = "digests.json"
"""A checkpoint's file with path -> digest of each other file."""
OTHER_CHECKPOINT = "test the other one, --checkpoint last or best, or remove this one to train from the start"
"""Remedy of a damaged checkpoint."""


def with_digests(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return files of a folder, given by their paths in it, and one that holds the digest of each."""
    digests = {name: file_digest(content) for name, content in files.items()}
    return {**files, DIGESTS: json.dumps(digests, indent=1).encode()}


def digest_of(files: Mapping[str, bytes]) -> str:
    """Return one digest of several files, given by their paths in a folder."""
    return file_digest(with_digests(dict(sorted(files.items())))[DIGESTS])


def check_digests(folder: Path, remedy: str) -> None:
    """Raise if files are not as `with_digests` has described them; a folder without digests is accepted.

    Raises:
        ResultsError: A file has changed.
    """
    if (folder / DIGESTS).exists():
        check_files(folder, read_json(folder / DIGESTS, remedy), remedy)


def check_files(folder: Path, digests: Mapping[str, str], remedy: str) -> None:
    """Raise if a folder's files, given by their paths in it, have other digests.

    Raises:
        ResultsError: One has changed; what is missing is not needed, or is named where it is.
    """
    for name, digest in digests.items():
        file = folder / name
        if file.exists() and file_digest(file.read_bytes()) != digest:
            raise ResultsError("is not as it was written", place=str(file), remedy=remedy)
