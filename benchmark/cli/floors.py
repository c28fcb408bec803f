"""`smarts-bench floors`: what can be reached without learning."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from benchmark.cli.run import Import
from benchmark.results.files import ResultsError, try_writing, write_whole
from smarts.errors import SmartsError, UnknownNameError, nearest_names

if TYPE_CHECKING:
    from benchmark.floors.tally import Tally

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


def floors(
    policies: Annotated[
        list[str] | None,
        typer.Argument(metavar="[POLICY]...", help="Which; by default all.", show_default=False),
    ] = None,
    scenario: Annotated[
        list[str] | None,
        typer.Option(
            help="Name of the suite, or folder; may be repeated.", show_default=", ".join(SCENARIOS)
        ),
    ] = None,
    episodes: Annotated[int, typer.Option(help="Of each policy, scenario and traffic.", min=1)] = 50,
    seed: Annotated[int, typer.Option(help="Of the run.", min=0, max=2**63 - 1)] = 42,
    out: Annotated[Path | None, typer.Option(help="Table to write, as .csv.", show_default=False)] = None,
    record: Annotated[
        Path | None, typer.Option(help="Folder to record the episodes to.", show_default=False)
    ] = None,
    import_: Import = None,
) -> None:
    """Play scripted drivers in the benchmark's scenarios and say how they end.

    Shares of agent-episodes; behind collision and goal their 95% intervals.
    """
    from benchmark.floors import FLOORS, SUMO_DRIVER
    from benchmark.floors.run import play
    from smarts.registry import file_name, import_own, is_own_name
    from smarts.sstudio.locating import locate

    import_own(import_ or ())
    known = (*FLOORS, SUMO_DRIVER)
    chosen = policies or known
    for policy in chosen:
        if is_own_name(policy):
            FLOORS[policy]
        elif policy not in known:
            raise UnknownNameError(f"there is no floor {policy!r}", remedy=nearest_names(policy, known))
    for name in scenario or SCENARIOS:
        locate(name)
    _check_table(out)
    typer.echo(_line(COLUMNS[:3], COLUMNS[3], "s", SHOWN))
    table = None if out is None else Table(out)
    for policy in chosen:
        for name in scenario or SCENARIOS:
            folder = None if record is None else record / file_name(policy) / Path(name).name
            for tally in play(policy, name, episodes=episodes, seed=seed, record=folder):
                typer.echo(_shown(tally))
                if table is not None:
                    table.add(_row(tally))
    if table is not None:
        table.finish()
        typer.echo(f"wrote {out}")


class Table:
    """A file that has all lines that were added, whatever ends the command; if it can be written to.

    Args:
        file: Its name; a file that is there is replaced with the first line.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._lines: list[Sequence[str]] = [COLUMNS]
        self._failure: ResultsError | None = None

    def add(self, line: Sequence[str]) -> None:
        """Add a line. A disk that is full says so once: what is played meanwhile may find room again."""
        self._lines.append(line)
        try:
            write_whole(self._file, self._write)
        except ResultsError as error:
            if self._failure is None:
                typer.echo(f"note: {error.place}: {error.problem}; it is tried again", err=True)
            self._failure = error
        else:
            self._failure = None

    def finish(self) -> None:
        """See that all lines are written.

        Raises:
            ResultsError: They cannot be.
        """
        if self._failure is not None:
            raise ResultsError(
                self._failure.problem,
                place=self._failure.place,
                remedy="all lines are above; make room before the same command plays everything again",
            )

    def _write(self, file: Path) -> None:
        with file.open("w", newline="") as out:
            csv.writer(out, lineterminator="\n").writerows(self._lines)


def _row(tally: Tally) -> list[str]:
    """Return a line of the table, in the order of `COLUMNS`."""
    ends = [end for name in WITH_INTERVAL for end in tally.interval(name)]
    return [
        tally.policy,
        tally.scenario,
        tally.traffic,
        str(tally.episodes),
        str(tally.outcomes.total()),
        f"{tally.seconds:.1f}",
        *(f"{value:.3f}" for value in [*map(tally.share, SHOWN), *ends]),
    ]


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
    return f"{policy:<13}{scenario:<14}{traffic:<24}{episodes:>8}{seconds:>5}" + "".join(
        f"{share:>{20 if name in WITH_INTERVAL else 12}}" for name, share in zip(SHOWN, shares, strict=True)
    )


def _check_table(out: Path | None) -> None:
    """Refuse a table that cannot be written before the work is done, not after."""
    if out is None:
        return
    if out.suffix != ".csv":
        raise SmartsError(f"a table is not called {out.name!r}", place="--out", remedy="end it in .csv")
    if out.is_dir() or any(parent.is_file() for parent in out.parents):
        raise SmartsError(
            "there is a folder or a file in the way", place=str(out), remedy="choose another --out"
        )
    try_writing(out)
