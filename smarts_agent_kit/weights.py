"""Files of policies that `smarts-bench export` has written, and whether their parts fit together."""

from __future__ import annotations

import hashlib
import io
import itertools
import json
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FORMAT = 1
HEAR = "hear"
"""A layer that reads the mean of the other agents' numbers."""
CONTENT, WEIGHTS = "policy.json", "policy.npz"
"""Files of a folder; the weights of further groups of agents are in policy_1.npz, policy_2.npz, ..."""
DIGESTS = "digests"
"""Key of `policy.json`: file -> digest; those of earlier versions have none."""
ARRAYS = {"linear": 2, HEAR: 3, "gru": 4, "tanh": 0, "relu": 0}
"""Kind of a layer -> how many arrays it has."""


class ExportError(ValueError):
    """A folder does not hold an exported policy.

    Args:
        problem: What is wrong.
        place: The file.
    """

    def __init__(self, problem: str, place: str) -> None:
        self.problem, self.place = problem, place
        super().__init__(f"{place}: {problem}; export it again")


def file_digest(content: bytes) -> str:
    """Return the digest of a file."""
    return hashlib.blake2b(content, digest_size=16).hexdigest()


def policy_digests(folder: Path, content: Mapping[str, Any]) -> dict[str, str]:
    """Return the digests of a policy's files of weights, and of what `policy.json` holds beside them."""
    said = json.dumps({name: each for name, each in content.items() if name != DIGESTS}, sort_keys=True)
    files = {file.name: file_digest(file.read_bytes()) for file in weights_files(folder) if file.exists()}
    return {CONTENT: file_digest(said.encode()), **files}


def content_of(folder: Path) -> dict[str, Any]:
    """Return what `policy.json` holds.

    Raises:
        ExportError: The file is missing or of another format, or a file is not as it was written.
    """
    try:
        content = json.loads((folder / CONTENT).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ExportError(f"the exported policy cannot be read: {error}", str(folder / CONTENT)) from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = content.get("format") if isinstance(content, dict) else None
        raise ExportError(f"its format is {found!r}, not {FORMAT}", str(folder / CONTENT))
    if (found := content.get(DIGESTS)) is not None:
        for name, digest in policy_digests(folder, content).items():
            if not isinstance(found, dict) or found.get(name) != digest:
                raise ExportError("it is not as it was written", str(folder / name))
    return content


def weights_file(folder: Path, number: int) -> Path:
    """Return the file of the weights of a group of agents, by its number."""
    return folder / WEIGHTS if number == 0 else folder / f"policy_{number}.npz"


def weights_files(folder: Path) -> list[Path]:
    """Return all files of weights; the first, whether it is there or not."""
    more = itertools.takewhile(Path.exists, (weights_file(folder, k) for k in itertools.count(1)))
    return [folder / WEIGHTS, *more]


def layers_of(folder: Path, group: str, kinds: Sequence[str]) -> list[tuple[str, tuple[NDArray, ...]]]:
    """Return the layers of a network: kind and weights.

    Raises:
        ExportError: They cannot be read, or there is no such kind.
    """
    if unknown := [kind for kind in kinds if kind not in ARRAYS]:
        raise ExportError(f"there is no layer {unknown[0]!r}, but {', '.join(ARRAYS)}", str(folder / CONTENT))
    return [(kind, _weights(folder, f"{group}/{number}", ARRAYS[kind])) for number, kind in enumerate(kinds)]


def sets_of(folder: Path, group: str, leaves: Sequence[str]) -> dict[str, tuple[NDArray, ...]]:
    """Return the weights of both layers that the rows of each set go through.

    Raises:
        ExportError: They cannot be read.
    """
    return {leaf: _weights(folder, f"{group}/{leaf}", 4) for leaf in leaves}


def _weights(folder: Path, name: str, count: int) -> tuple[NDArray, ...]:
    names = [f"{name}/{k}" for k in range(count)]
    for place in weights_files(folder):
        try:
            with zipfile.ZipFile(place) as archive:
                if not {f"{each}.npy" for each in names} <= {*archive.namelist()}:
                    continue
                found = tuple(_array(archive, f"{each}.npy") for each in names)
        except Exception as error:  # zip, zlib and numpy raise errors of many types
            raise ExportError(f"the weights cannot be read: {error}", str(place)) from error
        if not all(np.isfinite(array).all() for array in found):
            raise ExportError(f"the weights of {name!r} are not finite", str(place))
        return found
    files = ", ".join(place.name for place in weights_files(folder))
    raise ExportError(f"the weights of {name!r} are missing: they are not in {files}", str(folder))


def _array(archive: zipfile.ZipFile, name: str) -> NDArray:
    """Return an array of numbers of 64 bits, by as many bytes as the archive's table says that it has.

    Other methods than these two pack gigabytes into a kilobyte, and `numpy.load` reads what a header says.

    Raises:
        ValueError: It is packed by another method, or holds something else.
    """
    member = archive.getinfo(name)
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{name} is packed by method {member.compress_type}, neither stored nor deflated")
    with archive.open(member) as packed:
        array = np.lib.format.read_array(io.BytesIO(packed.read(member.file_size)), allow_pickle=False)
    if array.dtype not in (np.float32, np.float64):
        raise ValueError(f"{name} holds {array.dtype}, not floats of 32 or 64 bits")
    return np.ascontiguousarray(array.astype(np.float64))
