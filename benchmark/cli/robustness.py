"""`smarts-bench robustness`."""

from __future__ import annotations

from typing import Annotated

import typer

from benchmark.cli.experiments import Import, Parallel
from benchmark.cli.reports import Results

NONE = "none"
"""Word that stands for no scripted policy or no condition."""


def robustness(
    results: Results,
    episodes: Annotated[
        int | None,
        typer.Option(
            help="Episodes of each play: the first ones of the tests.",
            min=1,
            show_default="100, or as many as the tests have",
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Training seed of the policies.", show_default="the smallest")
    ] = None,
    task: Annotated[
        list[str] | None,
        typer.Option(help="Repeatable.", metavar="TASK/TRAFFIC", show_default="all with social vehicles"),
    ] = None,
    algorithm: Annotated[
        list[str] | None, typer.Option(help="Algorithm to play. Repeatable.", show_default="all")
    ] = None,
    partner: Annotated[
        list[str] | None,
        typer.Option(
            help="Scripted policy to play with, or none. Repeatable.", show_default="gap_acceptance"
        ),
    ] = None,
    condition: Annotated[
        list[str] | None,
        typer.Option(
            help="Condition other than in training, or none. Repeatable.",
            show_default="wet_road, latency_100, latency_300, latency_500",
        ),
    ] = None,
    parallel: Parallel = None,
    import_: Import = None,
) -> None:
    """Play trained policies with partners from other algorithms, on a wet road, and with latency.

    Nothing is trained. Give the same command again to resume. The report shows the results.
    """
    from benchmark.report.writing import write_report
    from benchmark.running.experiment import interruptible
    from benchmark.running.robustness import Given, play_robustness

    chosen = {
        name: tuple(each for each in given if each != NONE)
        for name, given in (("partners", partner), ("conditions", condition))
        if given
    }
    given = Given(
        episodes, seed, tuple(task or ()), tuple(algorithm or ()), imports=tuple(import_ or ()), **chosen
    )

    def work() -> int:
        for line in play_robustness(results, given, parallel):
            typer.echo(line, err=True)
        typer.echo(f"report: {write_report(results)}")
        return 0

    left = f"what was played is in {results}; give the same command again to resume"
    raise typer.Exit(interruptible(work, left))
