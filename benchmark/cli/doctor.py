"""`smarts-bench doctor` and `smarts-bench compile`: the installation."""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import typer

from smarts.errors import SmartsError

SMALL_DISK = 2e9
"""Free space below which a warning is given [bytes]."""


def doctor() -> None:
    """Check the installation and this machine. Exits with 1 if a check fails."""
    checks: dict[str, Callable[[], str]] = {
        "python": lambda: f"{platform.python_version()} on {platform.platform()}",
        "packages": _packages,
        "processor": _processor,
        "memory": _memory,
        "GPU": _gpu,
        "SUMO": _sumo,
        "Bullet": _bullet,
        "scenarios": _scenarios,
        "kernel cache": _kernel_cache,
        "results": _results,
    }
    failed = 0
    for name, check in checks.items():
        try:
            typer.echo(f"ok      {name:<13}{check()}")
        except Exception as error:  # any error that a broken installation causes
            failed += 1
            kind = "" if isinstance(error, SmartsError) else f"{type(error).__name__}: "
            typer.echo(f"FAILED  {name:<13}{kind}{error}")
    if failed:
        raise typer.Exit(1)


def compile_kernels(
    experiments: Annotated[
        bool, typer.Option("--experiments", help="Only what most experiments use.")
    ] = False,
) -> None:
    """Compile all kernels in advance. Kernels in the cache are skipped."""
    from benchmark.running.compiling import kernel_users
    from smarts.geometry.compiling import Compilations

    runs = kernel_users(only_experiments=experiments)
    with Compilations() as compiled:
        for number, (name, run) in enumerate(runs.items(), start=1):
            before = compiled.count
            run()
            typer.echo(f"{number:>3}/{len(runs)}  {name}: {compiled.count - before} compiled")
    typer.echo(f"{compiled.count} functions compiled, all others were in the cache")


def _packages() -> str:
    names = ("smarts-bench", "ray", "torch", "numpy", "numba", "gymnasium", "pettingzoo", "pybullet")
    return ", ".join(f"{name} {version(name)}" for name in names)


def _processor() -> str:
    from benchmark.running.machine import processor, usable_cores

    return f"{processor()}, {usable_cores():g} of {os.cpu_count()} cores"


def _memory() -> str:
    from benchmark.running.machine import memory_text

    return memory_text()


def _gpu() -> str:
    import torch

    return torch.cuda.get_device_name() if torch.cuda.is_available() else "none (optional)"


def _sumo() -> str:
    from smarts.providers.sumo_library import SumoLibrary

    SumoLibrary().close()
    return f"libsumo {version('libsumo')} loads"


def _bullet() -> str:
    from smarts.dynamics.quiet_pybullet import pybullet

    pybullet.disconnect(pybullet.connect(pybullet.DIRECT))
    return f"pybullet {version('pybullet')} runs without a display"


def _scenarios() -> str:
    from smarts.sstudio.build import build_scenario
    from smarts.sstudio.locating import suite

    built = build_scenario("loop")
    return f"{len(suite())} in the suite; {built.name} is built in {built.directory.parent}"


def _kernel_cache() -> str:
    from smarts.geometry.boxes import slab  # any kernel: numba chooses a folder that can be written to

    folder = Path(slab.stats.cache_path)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder):
        pass
    return f"{folder} is writable; `smarts-bench compile` fills it"


def _results() -> str:
    folder = Path("results")
    here = folder if folder.exists() else Path()
    with tempfile.TemporaryFile(dir=here):
        pass
    free = os.statvfs(here).f_bavail * os.statvfs(here).f_frsize
    warning = " (low)" if free < SMALL_DISK else ""
    return f"{(Path.cwd() / folder)} is writable, {free / 1e9:.0f} GB free{warning}"
