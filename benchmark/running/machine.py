"""The machine: versions, commit and hardware of a result, and what a container leaves this process of it."""

from __future__ import annotations

import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

PACKAGES = ("smarts-bench", "ray", "torch", "numpy", "numba", "libsumo", "pybullet", "gymnasium")
UNLIMITED = 2**60
"""Memory limit [bytes] that means none: control groups of version 1 have no word for it."""
ROOT = Path("/")
"""Of the files `/proc` and `/sys`; tests give another one."""


def command() -> str:
    """Return the command line of this process."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


def machine() -> dict[str, Any]:
    """Return versions, commit and hardware, for run.json."""
    return {
        "commit": commit(),
        "python": platform.python_version(),
        "versions": {name: _version(name) for name in PACKAGES},
        "system": platform.platform(),
        "processor": processor(),
        "cores": usable_cores(),
    }


def commit() -> str | None:
    """Return the commit of the source tree, with a plus if it was changed; None outside of one."""
    tree = Path(__file__).parents[2]
    try:
        found = subprocess.run(
            ["git", "-C", str(tree), "describe", "--always", "--abbrev=12", "--dirty=+"],
            capture_output=True,
            text=True,
            timeout=10,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return found.stdout.strip()


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def processor() -> str:
    """Return the name of the processor."""
    lines = _text(Path("/proc/cpuinfo")).splitlines()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor())


def usable_cores() -> int:
    """Return how many cores this process may run on at a time."""
    return len(os.sched_getaffinity(0))


def total_memory() -> int:
    """Return the machine's memory [bytes]."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def memory_limit(root: Path = ROOT) -> int | None:
    """Return the memory limit of the control groups around this process [bytes], None without one."""
    found = [
        int(text)
        for folder in _groups(root, "memory")
        for name in ("memory.max", "memory.limit_in_bytes")
        if (text := _text(folder / name)).isdecimal()
    ]
    return min((limit for limit in found if limit < UNLIMITED), default=None)


def cpu_quota(root: Path = ROOT) -> float | None:
    """Return the CPU time limit of the control groups around this process [cores], None without one."""
    found = []
    for folder in _groups(root, "cpu"):
        limit = _text(folder / "cpu.max").split()
        limit = limit or [_text(folder / f"cpu.cfs_{name}_us") for name in ("quota", "period")]
        if len(limit) == 2 and all(text.isdecimal() for text in limit) and int(limit[1]):
            found.append(int(limit[0]) / int(limit[1]))
    return min(found, default=None)


def _groups(root: Path, controller: str) -> Iterator[Path]:
    """Yield the folders of the control groups around this process, of versions 1 and 2."""
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
        # A container may see only its own part of the tree; its path is given from outside or from there.
        inside = Path(own[name])
        inside = inside.relative_to(top if inside.is_relative_to(top) else "/")
        at = root / mount.lstrip("/")
        for part in [inside, *inside.parents]:
            yield at / part


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8").strip()
    except OSError:
        return ""


def memory_text(machine: int, limit: int | None) -> str:
    """Return the memory that may be used, in words."""
    whole = f"{machine / 2**30:.1f} GiB"
    if limit is None or limit >= machine:
        return whole
    return f"{limit / 2**30:.1f} GiB (container limit; the machine has {whole})"


def cores_text(machine: int, usable: int, quota: float | None) -> str:
    """Return the cores that may be used, in words: how many, and for how much time."""
    cores = f"{usable} cores" if usable == machine else f"{usable} of {machine} cores"
    return (
        cores
        if quota is None or quota >= usable
        else f"{cores}, {quota:.1f} cores of CPU time (container limit)"
    )
