"""`smarts-bench release` and `verify`: trained policies for others, and others' policies."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from benchmark.cli.choices import check_effect
from benchmark.cli.experiments import Import, Parallel


def release(
    results: Annotated[
        Path, typer.Argument(metavar="RESULTS", help="Results folder, results/NAME.", show_default=False)
    ],
    out: Annotated[Path, typer.Option(help="Folder of the release.", show_default=False)],
    author: Annotated[str, typer.Option(help="Named on the leaderboard.")] = "",
    partial: Annotated[
        bool, typer.Option("--partial", help="Release although runs or seeds are missing; they are named.")
    ] = False,
    import_: Import = None,
) -> None:
    """Export the last checkpoint of each run of an experiment, with a manifest of what is claimed of it.

    The folder needs neither the results nor a training: `smarts-bench evaluate OUT/policies/NAME` plays a
    policy, and `smarts-bench verify OUT` compares all with their claims.
    """
    from benchmark.results.release import MANIFEST
    from benchmark.running.experiment import interruptible
    from benchmark.running.releasing import write_release
    from benchmark.running.trained import own_scenarios

    def work() -> int:
        manifest = write_release(results, out, author=author, is_partial=partial, imports=import_ or ())
        sizes = [each.stat().st_size for each in out.rglob("*") if each.is_file()]
        typer.echo(
            f"{out / MANIFEST}: {len(manifest.policies)} policies, {sum(sizes) / 1e6:.1f} MB, "
            f"largest file {max(sizes) / 1e6:.2f} MB"
        )
        for each in manifest.missing:
            typer.echo(f"missing: {each}")
        for each in own_scenarios(name for entry in manifest.policies for name in entry.scenarios):
            typer.echo(
                f"note: the release does not contain the scenario {each}: share it, too; --scenario names it"
            )
        return 0

    raise typer.Exit(interruptible(work, f"{out} is as it was before"))


def verify(
    submission: Annotated[
        str,
        typer.Argument(
            metavar="SUBMISSION",
            help="Folder of a release or of an exported policy, or tcp://HOST:PORT of a served agent.",
            show_default=False,
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder of its results, for `leaderboard`.", show_default=False)],
    episodes: Annotated[int, typer.Option(help="Test episodes of each policy.", min=1)] = 200,
    fresh: Annotated[
        int | None,
        typer.Option(
            help="Further episodes, of a seed that is drawn now; 0: none.",
            min=0,
            show_default="as many as --episodes",
        ),
    ] = None,
    version: Annotated[
        int | None,
        typer.Option(
            "--benchmark-version", help="That an address is of, which has no manifest.", show_default="newest"
        ),
    ] = None,
    scenario: Annotated[
        list[str] | None,
        typer.Option(help="Scenario that an address plays. Repeatable.", show_default="all of the version"),
    ] = None,
    traffic: Annotated[
        list[str] | None,
        typer.Option(help="Traffic that an address plays in. Repeatable.", show_default="all of the version"),
    ] = None,
    address: Annotated[
        list[str] | None,
        typer.Option(
            help="tcp://HOST:PORT that a manifest may name, as you know it. Repeatable.", show_default="none"
        ),
    ] = None,
    parallel: Parallel = None,
) -> None:
    """Play a release or a submission, and compare its scores and episodes with its claims.

    Exit code 0 if every policy is confirmed, 1 if one is marked or refused, 2 if it cannot be evaluated.

    The submission runs no code here, and its agents get no seed. One that claims nothing gets its claims:
    what to submit is then in OUT/submission. Give the same command again to resume.
    """
    from benchmark.results.release import ADDRESS, CONFIRMED, MANIFEST, SUBMISSION
    from benchmark.running.experiment import interruptible
    from benchmark.running.submissions import submitted
    from benchmark.running.verifying import verify as evaluate

    if not submission.startswith(ADDRESS):
        options = {"--benchmark-version": version, "--scenario": scenario, "--traffic": traffic}
        check_effect("a folder, which names its own", options)
    manifest, folder = submitted(
        submission, number=version, scenarios=scenario or (), traffic=traffic or (), addresses=address or ()
    )

    def work() -> int:
        for each in manifest.missing:
            typer.echo(f"missing: {each}")
        verdicts = evaluate(manifest, folder, out, episodes=episodes, fresh=fresh, parallel=parallel)
        for verdict in verdicts:
            scores = ", ".join(f"{name} {value:.3f}" for name, value in verdict.scores.items())
            equal, compared = verdict.digests
            digests = f"{equal} of {compared} episodes as claimed"
            typer.echo(f"{verdict}: {verdict.status}; {scores or 'no scores'}; {digests}")
            for reason in verdict.reasons:
                typer.echo(f"  {reason}")
        if (out / SUBMISSION / MANIFEST).exists():
            typer.echo(f"to be submitted: {out / SUBMISSION}")
        return 0 if all(verdict.status == CONFIRMED for verdict in verdicts) else 1

    raise typer.Exit(interruptible(work, f"give the same command again to resume in {out}"))
