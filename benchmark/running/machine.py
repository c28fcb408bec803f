"""The machine: versions, commit and hardware of a result, and what a container leaves this process of it."""

from __future__ import annotations

import os
import platform
import shlex
import subprocess
import sys
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from ray._common.utils import get_system_memory
from ray._private.utils import get_current_node_cpu_model_name, get_num_cpus

COMMIT = "shipped/commit"
"""File that names the commit of code that another machine has shipped, beside the packages."""
CODE = tuple(
    f"{folder}/*.{kind}"
    for folder in ("algorithms", "benchmark", "smarts", "smarts_agent_kit")
    for kind in ("py", "yaml")
)
"""Files of the program, at any depth: modules, and vehicles, tyres and the like."""
PACKAGES = ("smarts-bench", "ray", "torch", "numpy", "numba", "libsumo", "pybullet", "gymnasium")


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
    """Return the commit of the source tree, with a plus if it was changed; None outside of one.

    New files count in the folders of the program alone: scenarios and own code are named by their digests.
    """
    tree = Path(__file__).parents[2]
    if (shipped := tree / COMMIT).is_file():
        return shipped.read_text(encoding="utf-8") or None
    try:
        # An installation may lie in the repository of another project, which knows nothing of its files.
        _git(tree, "ls-files", "--error-unmatch", str(Path(__file__).relative_to(tree)))
        found = _git(tree, "describe", "--always", "--abbrev=12", "--dirty=+")
        new = (
            ""
            if found.endswith("+")
            else _git(tree, "ls-files", "--others", "--exclude-standard", "--", *CODE)
        )
        return f"{found}+" if new else found
    except (OSError, subprocess.SubprocessError):
        return None


def _git(tree: Path, *words: str) -> str:
    found = subprocess.run(
        ["git", "-C", str(tree), *words], capture_output=True, text=True, timeout=10, check=True
    )
    return found.stdout.strip()


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def processor() -> str:
    """Return the name of the processor."""
    return get_current_node_cpu_model_name() or platform.processor()


def usable_cores() -> float:
    """Return how many cores this process may use, by its affinity and the limits of its container."""
    return min(len(os.sched_getaffinity(0)), get_num_cpus(True, truncate=False))


def memory_text() -> str:
    """Return the memory that may be used, in words: the machine's, or the limit of the container."""
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    machine, usable = (f"{size / 2**30:.1f} GiB" for size in (whole, min(whole, get_system_memory())))
    return machine if usable == machine else f"{usable} (container limit; the machine has {machine})"
