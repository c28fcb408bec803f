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
NEEDED = ("agents", "groups", "observation", "index", "leaves", "period", "head", "bounds")
"""What `policy.json` holds beside the format."""
HEADS = ("best", "mean", "tanh")
"""How actions are made of outputs."""
ARRAYS = {"linear": 2, HEAR: 3, "gru": 4, "tanh": 0, "relu": 0}
"""Kind of a layer -> how many arrays it has."""

Layers = Sequence[tuple[str, tuple[NDArray, ...]]]
"""Kind and arrays of each layer."""


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
    if absent := [name for name in NEEDED if name not in content]:
        raise ExportError(f"there is no {absent[0]!r}", str(folder / CONTENT))
    if not isinstance(content["agents"], dict) or not content["agents"]:
        raise ExportError("it has no agents", str(folder / CONTENT))
    if not _has_sound_bounds(content["head"], content["bounds"]):
        raise ExportError("its bounds are not those of its head", str(folder / CONTENT))
    if (found := content.get(DIGESTS)) is not None:
        for name, digest in policy_digests(folder, content).items():
            if not isinstance(found, dict) or found.get(name) != digest:
                raise ExportError("it is not as it was written", str(folder / name))
    return content


def _has_sound_bounds(head: Any, bounds: Any) -> bool:
    """Return whether it is known how actions are made of outputs, with bounds that fit."""
    try:
        if head == "best":
            return type(bounds["start"]) is int and type(bounds["masked"]) is bool
        low, high = (np.array(bounds[name]) for name in ("low", "high"))
        are_numbers = {low.dtype.kind, high.dtype.kind} <= {"i", "u", "f"}
        return head in HEADS and are_numbers and low.shape == high.shape != () and bool((low <= high).all())
    except (KeyError, TypeError, ValueError):
        return False


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


def check_network(
    layers: Layers,
    sets: Mapping[str, tuple[NDArray, ...]],
    memory: int,
    narrow: Mapping[str, int],
    place: str,
) -> int:
    """Return how many numbers a network gives.

    Args:
        layers: Layers of the network.
        sets: Both layers of each set of rows.
        memory: Numbers that the policy keeps of a vehicle.
        narrow: What -> how many numbers the first layer reads of it at least.
        place: For errors.

    Raises:
        ExportError: Its arrays do not fit together, as what one layer gives the next one reads; names the
            layer.
    """
    for name, arrays in sets.items():
        first = check_layer(f"the set {name!r}", "linear", arrays[:2], 0, place)
        check_layer(f"the set {name!r}", "linear", arrays[2:], 0, place, first)
    width = None
    for number, (kind, arrays) in enumerate(layers):
        if not arrays:
            continue
        is_first = width is None
        width = check_layer(f"layer {number} ({kind})", kind, arrays, memory, place, width)
        for what, count in narrow.items() if is_first else ():
            if not 0 <= count <= len(arrays[0]):
                raise ExportError(f"{what} {count} is more than its first layer reads", place)
    if width is None:
        raise ExportError("its network has no weights", place)
    return width


def check_layer(
    name: str, kind: str, arrays: Sequence[NDArray], memory: int, place: str, width: int | None = None
) -> int:
    """Return how many numbers a layer gives.

    Args:
        name: For errors.
        kind: Kind of the layer.
        arrays: Its weights.
        memory: Numbers that the policy keeps of a vehicle.
        place: For errors.
        width: How many numbers it reads; None: as many as it has rows.

    Raises:
        ExportError: Its arrays do not fit to each other, to the memory, or to what it reads.
    """
    shapes = [each.shape for each in arrays]
    rows = width if width is not None else (shapes[0][:1] or (0,))[0]
    units = memory if kind == "gru" else (shapes[0][1:] or (0,))[0]
    wanted = {
        "linear": [(rows, units), (units,)],
        HEAR: [(rows, units), (units,), (rows, units)],
        "gru": [(rows, 3 * units), (3 * units,), (units, 3 * units), (3 * units,)],
    }[kind]
    if shapes != wanted or not rows or not units:
        raise ExportError(f"{name} has arrays of the shapes {shapes}, where {wanted} fit", place)
    return units


def check_width(x: NDArray, weight: NDArray) -> None:
    """Raise if inputs (N, d) are not as many as weights (d, P) read.

    Raises:
        ExportError: They are more or fewer.
    """
    if x.shape[1] != len(weight):
        raise ExportError(
            f"a layer reads {len(weight)} numbers and is given {x.shape[1]}: it is not of this {CONTENT}",
            WEIGHTS,
        )
