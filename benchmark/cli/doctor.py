"""`smarts-bench doctor`: whether this machine has all that is needed."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import typer

from smarts.errors import SmartsError

SMALL_DISK = 2e9
"""Free space below which a warning is given [bytes]."""


def doctor() -> None:
    """Check versions, cores, memory, GPU, SUMO, write access, kernel cache; exit with 1 if one fails."""
    checks: dict[str, Callable[[], str]] = {
        "python": _python,
        "packages": _packages,
        "processor": _processor,
        "memory": _memory,
        "GPU": _gpu,
        "SUMO": _sumo,
        "vehicles": _bullet,
        "scenarios": _scenarios,
        "kernel cache": _kernel_cache,
        "results": _results,
    }
    failed = 0
    for name, check in checks.items():
        try:
            typer.echo(f"ok      {name:<13}{check()}")
        except Exception as error:  # whatever a broken installation ends in
            failed += 1
            kind = "" if isinstance(error, SmartsError) else f"{type(error).__name__}: "
            typer.echo(f"FAILED  {name:<13}{kind}{error}")
    if failed:
        raise typer.Exit(1)


def _python() -> str:
    import platform

    return f"{platform.python_version()} on {platform.platform()}"


def _packages() -> str:
    names = ("smarts-bench", "ray", "torch", "numpy", "numba", "gymnasium", "pettingzoo", "pybullet")
    return ", ".join(f"{name} {version(name)}" for name in names)


def _processor() -> str:
    from benchmark.running.limits import allowed_cores, cores_text, quota
    from benchmark.running.machine import processor

    return f"{processor()}, {cores_text(os.cpu_count() or 1, allowed_cores(), quota())}"


def _memory() -> str:
    from benchmark.running.limits import memory, memory_text

    return memory_text(memory())


def _gpu() -> str:
    import torch

    if not torch.cuda.is_available():
        return "none, and none is needed"
    return torch.cuda.get_device_name()


def _sumo() -> str:
    from smarts.providers.sumo_library import SumoLibrary

    library = SumoLibrary()
    library.close()
    return f"libsumo {version('libsumo')} loads"


def _bullet() -> str:
    from smarts.dynamics.quiet_pybullet import pybullet

    client = pybullet.connect(pybullet.DIRECT)
    pybullet.disconnect(client)
    return f"Bullet {version('pybullet')} runs without a display"


def _scenarios() -> str:
    from smarts.sstudio.build import build_scenario
    from smarts.sstudio.locating import suite

    built = build_scenario("loop")
    return f"{len(suite())} in the suite; built in {built.directory.parent}"


def _kernel_cache() -> str:
    import smarts.env.vector  # noqa: F401 - and with it all kernels of a simulation
    from benchmark.running.kernel_cache import kernel_cache

    found = kernel_cache("smarts")
    inside = Path(os.path.commonpath(found.folders))
    return (
        f"in {inside}, can be written; {found.compiled} of {found.kernels} kernels are compiled"
        " for these versions and this processor, others will be when they are first called"
    )


def _results() -> str:
    folder = Path("results")
    here = folder if folder.exists() else Path()
    with tempfile.TemporaryFile(dir=here):
        pass
    free = os.statvfs(here).f_bavail * os.statvfs(here).f_frsize
    warning = ", which is little" if free < SMALL_DISK else ""
    return f"{(Path.cwd() / folder)} can be written, {free / 1e9:.0f} GB free{warning}"
