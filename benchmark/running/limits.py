"""What this process may use of the machine: in a container that is less than the machine has."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from smarts.errors import SmartsError

UNLIMITED = 2**60
"""Bytes from which on a limit is none: version 1 of control groups has no word for it."""


class Memory(NamedTuple):
    """In bytes."""

    machine: int
    limit: int | None
    """Of the control groups around this process, None without one."""


def memory(root: Path = Path("/")) -> Memory:
    """Return how much memory there is.

    Args:
        root: Of the files `/proc` and `/sys`.

    Raises:
        SmartsError: The machine does not say.
    """
    file = root / "proc" / "meminfo"
    try:
        lines = dict(line.split(":", 1) for line in file.read_text().splitlines() if ":" in line)
        machine = int(lines["MemTotal"].split()[0]) * 1024
    except (OSError, LookupError, ValueError) as error:
        raise SmartsError("does not say how much memory there is", place=str(file)) from error
    found = [
        int(text)
        for folder in _groups(root, "memory")
        for name in ("memory.max", "memory.limit_in_bytes")
        if (text := _text(folder / name)).isdecimal()
    ]
    return Memory(machine, min((limit for limit in found if limit < UNLIMITED), default=None))


def allowed_cores() -> int:
    """Return how many cores this process may run on at a time, whatever else the machine has."""
    return len(os.sched_getaffinity(0))


def quota(root: Path = Path("/")) -> float | None:
    """Return the time that control groups leave this process, in that of one core; None for no limit.

    Args:
        root: Of the files `/proc` and `/sys`.
    """
    found = []
    for folder in _groups(root, "cpu"):
        limit = _text(folder / "cpu.max").split()
        limit = limit or [_text(folder / f"cpu.cfs_{name}_us") for name in ("quota", "period")]
        if len(limit) == 2 and all(text.isdecimal() for text in limit) and int(limit[1]):
            found.append(int(limit[0]) / int(limit[1]))
    return min(found, default=None)


def _groups(root: Path, controller: str) -> Iterator[Path]:
    """Yield the folders of the control groups around this process, of both versions."""
    own = {}
    for line in _text(root / "proc" / "self" / "cgroup").splitlines():
        _, names, path = line.split(":", 2)
        own |= dict.fromkeys(names.split(","), path)
    for line in _text(root / "proc" / "self" / "mountinfo").splitlines():
        left, _, right = line.partition(" - ")
        name = {"cgroup": controller, "cgroup2": ""}.get(right.split(" ")[0])
        if name not in own:
            continue
        top, mount = left.split(" ")[3:5]
        # A container may see only its own part of the tree, and its path as from outside or as from there.
        inside = Path(own[name])
        inside = inside.relative_to(top if inside.is_relative_to(top) else "/")
        at = root / mount.lstrip("/")
        for part in [inside, *inside.parents]:
            yield at / part


def _text(file: Path) -> str:
    try:
        return file.read_text().strip()
    except OSError:
        return ""


def memory_text(found: Memory) -> str:
    """Return it in words."""
    machine = f"{found.machine / 2**30:.1f} GiB"
    if found.limit is None or found.limit >= found.machine:
        return machine
    return f"{found.limit / 2**30:.1f} GiB, by the limit of its container; the machine has {machine}"


def cores_text(machine: int, allowed: int, quota: float | None) -> str:
    """Return cores in words: how many there are, how many may be used, and for how much time."""
    cores = f"{allowed} cores" if allowed == machine else f"{allowed} of {machine} cores"
    if quota is None or quota >= allowed:
        return cores
    return f"{cores}, with the time of {quota:.1f} by the limit of its container"
