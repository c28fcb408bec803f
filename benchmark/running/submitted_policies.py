"""Checks the files of a submitted policy, of which nothing is run: arrays, and a description of them."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path
from typing import NamedTuple

from benchmark.results.release import LARGEST_FILE, Entry
from benchmark.running.trained import trained_on
from smarts.errors import SmartsError, shown
from smarts.zoo.exported import ExportedPolicy
from smarts_agent_kit.exported import TEAM
from smarts_agent_kit.weights import CONTENT, file_digest, weights_files

UNPACKED = 64_000_000
"""Bytes of a policy's weights in memory."""
SAME = ("algorithm", "task", "scenarios", "traffic", "seed")
"""What a policy and its entry in the manifest both name."""


class RefusedError(SmartsError):
    """An entry of a submission is not evaluated, or its evaluation has failed."""


class Policy(NamedTuple):
    """What a check of a policy's files has found."""

    size: int
    """Of the files [bytes]."""
    digest: str
    """Of its weights, however they are packed."""
    talks: bool
    """Whether its vehicles act on what others see."""


def check_policy(entry: Entry, folder: Path, number: int) -> Policy:
    """Return what the files of an entry's policy hold.

    Args:
        entry: Of the manifest.
        folder: Of the manifest.
        number: Version of the benchmark.

    Raises:
        RefusedError: They are not those of the manifest, too large, of another training or version, or hold
            no policy; names what is wrong.
    """
    place = (folder / entry.agent).resolve()
    if not place.is_relative_to(folder.resolve()):
        raise _refused(entry, f"its policy {entry.agent} is outside of the submission")
    files = files_of(place)
    size = sum(_size_of(entry, file) for file in files)
    try:
        _check_training(entry, place, number)
        unpacked = sum(map(_unpacked, files[1:]))
        if unpacked > UNPACKED:
            raise _refused(
                entry, f"{entry.agent}: its weights have {unpacked:,} bytes, of at most {UNPACKED:,}"
            )
        policy = ExportedPolicy(place, TEAM)
    except RefusedError:
        raise
    except SmartsError as error:
        raise _refused(entry, f"{entry.agent}: {error.problem}") from error
    except Exception as error:  # of zip, of numpy or of a value of a wrong type
        raise _refused(
            entry, f"{entry.agent}: not as `smarts-bench export` writes it ({type(error).__name__}: {error})"
        ) from error
    found = hashlib.blake2b(digest_size=16)
    for array in policy.weights():
        found.update(str(array.shape).encode() + array.tobytes())
    return Policy(size, found.hexdigest(), policy.talks)


def files_of(place: Path) -> list[Path]:
    """Return the files of an exported policy: its description, then its weights."""
    return [place / CONTENT, *weights_files(place)]


def _size_of(entry: Entry, file: Path) -> int:
    """Return the bytes of a file that is the one which its manifest describes."""
    name = f"{entry.agent}/{file.name}"
    if not file.is_file() or file.is_symlink():
        raise _refused(entry, f"there is no file {name}")
    size = file.stat().st_size
    if size > LARGEST_FILE:
        raise _refused(entry, f"{name} has more than {LARGEST_FILE:,} bytes")
    claims = entry.files or entry.scores or entry.episodes
    if claims and entry.files.get(file.name) != file_digest(file.read_bytes()):
        raise _refused(entry, f"{name} is not the file that its manifest describes")
    return size


def _check_training(entry: Entry, place: Path, number: int) -> None:
    """Raise if a policy is of another training than its entry says."""
    trained = trained_on(place)
    if trained.benchmark_version != number:
        said = "none" if trained.benchmark_version is None else trained.benchmark_version
        raise _refused(entry, f"mixed versions of the benchmark: its policy was trained under {said}")
    for name in SAME:
        given, found = getattr(entry, name), getattr(trained, name)
        if given != found:
            raise _refused(entry, f"its policy was trained with {name} {shown(found)}, not {shown(given)}")


def _unpacked(file: Path) -> int:
    """Return the bytes of all members by the archive's table: `smarts_agent_kit.weights` reads no more."""
    with zipfile.ZipFile(file) as archive:
        return sum(member.file_size for member in archive.infolist())


def _refused(entry: Entry, problem: str) -> RefusedError:
    return RefusedError(problem, place=str(entry), remedy="submit what `smarts-bench release` has written")
