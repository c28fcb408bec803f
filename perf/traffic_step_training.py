"""Whether policies that are trained with a longer step of the traffic drive as well as others.

    python -m perf.traffic_step_training [--step 0.5] [--out FOLDER] [--set KEY=VALUE ...]
    python -m perf.traffic_step_training --page

Runs the experiment configs/traffic_step.yaml twice, with exact traffic and with `environment.traffic_step`,
seed by seed; the same command resumes. Tests run at 0.1 s in both. Writes the rates of each run to
results/traffic_step.csv and prints, for each scenario and mode of acting, the means over training seeds and
their difference with the interval of reports (Welch's t). The words are those of the benchmark against the
paper: "worse" or "better" if the two-sided 95% interval excludes 0, "non-inferior" if the one-sided 95%
interval ends within 0.075, else "undecided". Beside them stand the one-sided ends: Welch's, by which the
words are; that from intervals of both on the arcsine-root scale, as the benchmark has them of rates; and that
of pairs of equal seeds. Exit code 1: a greedy rate is worse.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Sequence
from pathlib import Path
from statistics import fmean
from typing import NamedTuple, get_type_hints

import numpy as np

from benchmark.experiment.config import read_experiment
from benchmark.report.seed_differences import welch
from benchmark.results.reading import RunResult
from benchmark.running.api import run
from benchmark.statistics import arcsine_interval, mover_interval, seed_interval
from smarts.errors import SmartsError

ROOT = Path(__file__).resolve().parents[1]
CONFIG, CSV = ROOT / "configs" / "traffic_step.yaml", ROOT / "results" / "traffic_step.csv"
RATES = {"completion": 1, "collision": -1}
"""Compared rates, and 1 where more is better."""
MARGIN = 0.075
"""What a non-inferior policy may be worse by."""
ONE_SIDED = 0.90
"""Level of the interval whose ends are one-sided 95% ends."""


class Row(NamedTuple):
    """The test of one run in one mode."""

    task: str
    seed: int
    traffic_step: float
    """In training [s]."""
    mode: str
    completion: float
    collision: float
    agent_episodes: int
    agent_steps: int
    """Of training."""
    commit: str


class Gap(NamedTuple):
    """Mean of the second sample minus that of the first."""

    value: float
    error: float
    """Standard error."""
    low: float
    high: float
    """Two-sided 95% interval."""
    gain: float
    """Pessimistic end, one-sided 95%, of how much better the second sample is."""
    word: str


def gap(exact: Sequence[float], longer: Sequence[float], sign: int) -> Gap:
    """Compare the rates of two samples of training seeds by Welch's t.

    Args:
        exact: Rate of each seed, trained with exact traffic; two or more.
        longer: The same, trained with the longer step.
        sign: 1 if a larger rate is better, else -1.
    """
    found = welch(longer, exact)
    value, reach = found.value, found.reach()
    gain = sign * value - found.reach(ONE_SIDED)
    if sign * value + reach < 0:
        word = "worse"
    elif sign * value - reach > 0:
        word = "better"
    else:
        word = "non-inferior" if gain >= -MARGIN else "undecided"
    return Gap(value, found.error, value - reach, value + reach, gain, word)


def gain_of_rates(exact: Sequence[float], longer: Sequence[float], sign: int, trials: int) -> float:
    """Return the pessimistic end, as `Gap.gain`, from intervals of both on the arcsine-root scale (MOVER).

    Args:
        exact: As in `gap`.
        longer: As in `gap`.
        sign: As in `gap`.
        trials: Agent-episodes behind each rate.
    """
    ends = []
    for rates in (exact, longer):
        low, high = arcsine_interval(rates, np.full(len(rates), trials), ONE_SIDED)
        ends.append((float(low), float(high)))
    low, high = mover_interval(fmean(longer), ends[1], fmean(exact), ends[0])
    return float(low if sign > 0 else -high)


def gain_by_seed(exact: Sequence[float], longer: Sequence[float], sign: int) -> float:
    """Return the pessimistic end, as `Gap.gain`, of pairs of equal seeds.

    Args:
        exact: As in `gap`.
        longer: As in `gap`, in the same order of seeds.
        sign: As in `gap`.
    """
    return float(seed_interval(sign * np.subtract(longer, exact), ONE_SIDED)[0])


def rows_of(result: RunResult, step: float) -> list[Row]:
    """Return the rates of a run's test without held-out variations; empty unless the run is finished."""
    if result.table is None or result.progress is None:
        return []
    columns = {name: result.table[name].to_numpy() for name in ("mode", "agents", "goals", "collisions")}
    counted = (result.table["split"] == "train").to_numpy() & ~result.table["is_invalid"].to_numpy()
    rows, commit = [], str(result.facts.get("commit"))
    for mode in ("greedy", "sampled"):
        played = counted & (columns["mode"] == mode)
        agents, goals, collisions = (
            float(columns[name][played].sum()) for name in ("agents", "goals", "collisions")
        )
        completion, collision = (round(count / agents, 4) for count in (goals, collisions))
        end = int(result.progress["agent_steps"].to_numpy()[-1])
        rows.append(
            Row(result.task, result.seed, step, mode, completion, collision, int(agents), end, commit)
        )
    return rows


def train(steps: Sequence[float], out: Path, overrides: Sequence[str]) -> list[Row]:
    """Train and test what is missing, seed by seed; return the rows of all finished runs."""
    rows: list[Row] = []
    for seed in read_experiment(CONFIG, overrides).seeds:
        for step in steps:
            name = f"traffic_step_{step:g}"
            length = "null" if step == min(steps) else f"{step}"
            given = [*overrides, f"name={name}", f"environment.traffic_step={length}", f"seeds=[{seed}]"]
            results = run(read_experiment(CONFIG, given), out)
            rows += [
                row
                for result in results.runs
                if not result.is_scripted and result.seed == seed
                for row in rows_of(result, step)
            ]
    return rows


def write(rows: Sequence[Row], file: Path) -> None:
    """Write the table of the runs."""
    with file.open("w", newline="") as opened:
        writer = csv.writer(opened, lineterminator="\n")
        writer.writerows([Row._fields, *rows])


def read(file: Path) -> list[Row]:
    """Read the table of the runs."""
    kinds = get_type_hints(Row)
    with file.open(newline="") as opened:
        return [
            Row(**{name: kinds[name](text) for name, text in row.items()}) for row in csv.DictReader(opened)
        ]


def page(rows: Sequence[Row]) -> tuple[str, bool]:
    """Return a Markdown table of the comparison, and whether a greedy rate is worse."""
    exact, longer = sorted({row.traffic_step for row in rows})
    head = ["task", "mode", "rate", f"{exact:g} s, by seed", f"{longer:g} s, by seed", "means"]
    head += ["difference (s.e.) [95% interval]", "one-sided ends: Welch, arcsine-root, by seed", "word"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    is_worse = False
    for task, mode in dict.fromkeys((row.task, row.mode) for row in rows):
        cell = sorted((row for row in rows if (row.task, row.mode) == (task, mode)), key=lambda row: row.seed)
        for rate, sign in RATES.items():
            runs = [[row for row in cell if row.traffic_step == step] for step in (exact, longer)]
            one, other = ([getattr(row, rate) for row in rows] for rows in runs)
            if min(len(one), len(other)) < 2:
                continue
            found = gap(one, other, sign)
            trials = min(row.agent_episodes for row in cell)
            ends = [f"{found.gain:+.3f}", f"{gain_of_rates(one, other, sign, trials):+.3f}"]
            is_paired = [row.seed for row in runs[0]] == [row.seed for row in runs[1]]
            ends.append(f"{gain_by_seed(one, other, sign):+.3f}" if is_paired else "n/a")
            is_worse |= mode == "greedy" and found.word == "worse"
            seeds = (", ".join(f"{value:.2f}" for value in values) for values in (one, other))
            interval = f"{found.value:+.3f} ({found.error:.3f}) [{found.low:+.3f}, {found.high:+.3f}]"
            means = f"{fmean(one):.3f}, {fmean(other):.3f}"
            columns = [task, mode, rate, *seeds, means, interval, ", ".join(ends), found.word]
            lines.append("| " + " | ".join(columns) + " |")
    return "\n".join(lines), is_worse


def main() -> None:
    """Train what is missing, and compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--step", type=float, default=0.5, help="of the traffic [s] (default 0.5)")
    parser.add_argument("--out", type=Path, default=ROOT / "results", help="folder of the two experiments")
    parser.add_argument("--csv", type=Path, default=CSV, help="table of the runs")
    parser.add_argument("--set", nargs="*", default=(), metavar="KEY=VALUE", help="of the experiment")
    parser.add_argument("--page", action="store_true", help="only compare what the table has")
    options = parser.parse_args()
    try:
        if not options.page:
            write(train((0.1, options.step), options.out, options.set), options.csv)
    except SmartsError as error:
        sys.exit(f"perf.traffic_step_training: {error}")
    text, is_worse = page(read(options.csv))
    print(text)
    sys.exit(1 if is_worse else 0)


if __name__ == "__main__":
    main()
