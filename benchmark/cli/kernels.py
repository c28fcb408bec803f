"""`smarts-bench compile`: all kernels at once, rather than when they are first called."""

from __future__ import annotations

import typer


def compile_kernels() -> None:
    """Compile all kernels now, rather than when they are first called; what is in the cache is left alone."""
    from benchmark.running.compiling import kernel_users
    from smarts.geometry.compiling import Compilations

    runs = kernel_users()
    with Compilations() as compiled:
        for number, (name, run) in enumerate(runs.items(), start=1):
            before = compiled.count
            run()
            typer.echo(f"{number:>3}/{len(runs)}  {name}: {compiled.count - before} compiled")
    typer.echo(f"{compiled.count} functions compiled, the others were in the cache")
