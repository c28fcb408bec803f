"""`smarts-bench scripted`: what can be reached without learning."""

from __future__ import annotations

import csv
import itertools
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmark.cli.experiments import Import
from benchmark.results.files import write_whole

if TYPE_CHECKING:
    from benchmark.scripted.play import Tally

SCENARIOS = ("two_way", "double_merge", "intersection")
SHOWN = ("collision", "goal", "off_road", "off_route", "missed_goal", "not_moving", "time_out")
WITH_INTERVAL = ("collision", "goal")
COLUMNS = (
    "policy",
    "scenario",
    "traffic",
    "episodes",
    "agent_episodes",
    "seconds",
    *SHOWN,
    *(f"{name}_{end}" for name in WITH_INTERVAL for end in ("low", "high")),
)


def scripted(
    policies: Annotated[
        list[str] | None, typer.Argument(metavar="POLICY", help="Policies to play.", show_default="all")
    ] = None,
    scenario: Annotated[
        list[str] | None,
        typer.Option(help="Scenario name or folder. Repeatable.", show_default=", ".join(SCENARIOS)),
    ] = None,
    episodes: Annotated[
        int, typer.Option(help="Number of episodes for each policy, scenario and traffic.", min=1)
    ] = 50,
    agents: Annotated[
        int, typer.Option(help="Number of agents, at most the scenario's missions.", min=1, max=64)
    ] = 4,
    seed: Annotated[int, typer.Option(help="Random seed.", min=0, max=2**63 - 1)] = 42,
    out: Annotated[Path | None, typer.Option(help="CSV file to write.", show_default=False)] = None,
    record: Annotated[
        Path | None, typer.Option(help="Folder to record the episodes to.", show_default=False)
    ] = None,
    import_: Import = None,
) -> None:
    """Play scripted policies and print the shares of their outcomes.

    Shares are of agent-episodes; those of collision and goal have 95% intervals.
    """
    from benchmark.running.importing import named_own_code
    from benchmark.scripted import SCRIPTED_POLICIES
    from benchmark.scripted.play import play
    from smarts.registry import file_name, import_own
    from smarts.sstudio.locating import locate

    import_own(import_ or ())
    chosen, scenarios = policies or (*SCRIPTED_POLICIES,), scenario or SCENARIOS
    for policy in chosen:
        SCRIPTED_POLICIES[policy]  # raises where there is none
    for name in scenarios:
        locate(name)
    header: str | None = _line(COLUMNS[:3], COLUMNS[3], "s", SHOWN)
    lines: list[Sequence[str]] = [COLUMNS]
    for policy, name in itertools.product(chosen, scenarios):
        folder = None if record is None else record / file_name(policy) / Path(name).name
        with named_own_code(f"the policy {policy!r}"):
            for tally in play(policy, name, episodes=episodes, agents=agents, seed=seed, record=folder):
                if header is not None:  # below it is a line, not an error
                    typer.echo(header)
                    header = None
                typer.echo(_shown(tally))
                lines.append(_row(tally))
                if out is not None:
                    write_whole(out, partial(_write, lines))
    if out is not None:
        typer.echo(f"wrote {out}")


def _write(lines: Sequence[Sequence[str]], file: Path) -> None:
    """Write all lines of the table again, so that an interrupted command loses none."""
    with file.open("w", newline="") as out:
        csv.writer(out, lineterminator="\n").writerows(lines)


def _row(tally: Tally) -> tuple[str, ...]:
    """Return a line of the table, in the order of `COLUMNS`."""
    ends = [end for name in WITH_INTERVAL for end in tally.interval(name)]
    return (
        tally.policy,
        tally.scenario,
        tally.traffic,
        str(tally.episodes),
        str(tally.outcomes.total()),
        f"{tally.seconds:.1f}",
        *(f"{value:.3f}" for value in [*map(tally.share, SHOWN), *ends]),
    )


def _shown(tally: Tally) -> str:
    shares = []
    for name in SHOWN:
        low, high = tally.interval(name)
        interval = f" [{low:.2f}, {high:.2f}]" if name in WITH_INTERVAL else ""
        shares.append(f"{tally.share(name):.2f}{interval}")
    names = tally.policy, Path(tally.scenario).name, tally.traffic
    return _line(names, str(tally.episodes), f"{tally.seconds:.0f}", shares)


def _line(names: Sequence[str], episodes: str, seconds: str, shares: Sequence[str]) -> str:
    policy, scenario, traffic = names
    return f"{policy:<16}{scenario:<18}{traffic:<24}{episodes:>8}{seconds:>5}" + "".join(
        f"{share:>{20 if name in WITH_INTERVAL else 12}}" for name, share in zip(SHOWN, shares, strict=True)
    )
