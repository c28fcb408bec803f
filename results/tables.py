"""Write the tables of README.md and of the versions' pages from the committed results.

    smarts-bench report results/benchmark_v1 && smarts-bench report results/benchmark_v2
    python results/tables.py [--check]

A table stands between the lines "<!-- table NAME -->" and "<!-- end of table -->". With `--check` nothing is
written; exit code 1 if a file has another table than the results, 2 if it lacks one of these lines.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmark.report.paper import printed
from benchmark.results.files import write_whole
from smarts.errors import SmartsError

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "benchmark_v1"
FILES = {
    "README.md": ("unseen",),
    "docs/guide/benchmark_v1.md": ("paper",),
    "docs/guide/benchmark_v2.md": ("conditions",),
}
"""File -> its tables."""
TASKS, ALONE, SOCIAL = (
    ("two_way", "double_merge", "intersection"),
    "no_social_vehicles",
    "random_social_vehicles",
)
CELLS = [(f"{task}_v1", traffic) for traffic in (ALONE, SOCIAL) for task in TASKS]
TITLES = [
    f"{task.replace('_', '-' if task == 'two_way' else ' ')}{', SV' * (traffic == SOCIAL)}"
    for traffic in (ALONE, SOCIAL)
    for task in TASKS
]
ALGORITHMS = {
    "dqn": "DQN",
    "ppo": "PPO",
    "maac": "MAAC",
    "mf_ac": "MF-AC",
    "networked_q": "Networked Q",
    "commnet": "CommNet",
    "maddpg": "MADDPG",
}
RULES = "gap_acceptance"
CONDITIONS = HERE / "benchmark_v2" / "report" / "conditions.csv"
UNSEEN = {
    "crossings": "intersections, SV",
    "double_merges": "double merges, SV",
    "two_ways": "two-way, SV",
    "on_ramps": "on-ramps, SV",
    "roundabout": "roundabout, SV",
    "left_turns": "left turns of version 1, SV",
}
"""Conditions of version 2 in README."""
BEGIN, END = "<!-- table ", "<!-- end of table -->"

Values = dict[tuple[str, str, str, str, str], dict[str, str]]
"""A row of values.csv by algorithm, task, traffic, mode and metric."""


def read_values() -> Values:
    """Return what the report says."""
    with (RESULTS / "report" / "values.csv").open(newline="") as file:
        return {
            (row["algorithm"], row["task"], row["traffic"], row["mode"], row["metric"]): row
            for row in csv.DictReader(file)
        }


def rates(values: Values, algorithm: str, cell: tuple[str, str], mode: str) -> str:
    """Return "collision / completion", or "" if there is none."""
    found = [values.get((algorithm, *cell, mode, f"{rate}_rate")) for rate in ("collision", "completion")]
    return " / ".join(f"{float(row['value']):.2f}" for row in found if row)


def paper_table(values: Values) -> Iterable[Sequence[str]]:
    """Yield rows of greedy rates, with the paper's in parentheses."""
    yield ("", *TITLES)
    for name, label in ALGORITHMS.items():
        papers = [" / ".join(f"{each:g}" for each in _printed(name, cell)) for cell in CELLS]
        ours = [rates(values, name, cell, "greedy") for cell in CELLS]
        yield (label, *(f"{own} ({paper})" for own, paper in zip(ours, papers, strict=True)))
    yield (f"`{RULES}` (scripted)", *(rates(values, RULES, cell, "scripted") for cell in CELLS))


def _printed(algorithm: str, cell: tuple[str, str]) -> tuple[float, float]:
    first = printed(algorithm, *cell)[0]
    return first.collision, first.completion


def conditions() -> dict[str, dict[str, dict[str, str]]]:
    """Return the rows of version 2's tests by policy and condition."""
    found: dict[str, dict[str, dict[str, str]]] = {}
    with CONDITIONS.open(newline="") as file:
        for row in csv.DictReader(file):
            name = row["algorithm"].replace("MFAC", "MF-AC")  # as the paper writes it
            found.setdefault(name, {})[row["condition"]] = row
    return found


def unseen_table(_: Values) -> Iterable[Sequence[str]]:
    """Yield rows of collision and completion rates on maps that no training has seen."""
    yield ("", *UNSEEN.values())
    for algorithm, rows in conditions().items():
        rates = [[rows[name][rate].split()[0] for rate in ("collision", "completion")] for name in UNSEEN]
        yield (algorithm, *(" / ".join(each) for each in rates))


def conditions_table(_: Values) -> Iterable[Sequence[str]]:
    """Yield a row for each condition of version 2, with intervals."""
    yield ("", "condition", "completion", "collision", "at fault", "share of agents that meet")
    for algorithm, rows in conditions().items():
        for name, row in rows.items():
            rates = [row[each] for each in ("completion", "collision", "at fault")]
            yield (algorithm, name, *rates, row["share that meets"].partition(" ")[0])


TABLES = {"paper": paper_table, "unseen": unseen_table, "conditions": conditions_table}


def lines_of(name: str, values: Values) -> str:
    """Return a table in Markdown."""
    head, *rows = TABLES[name](values)
    written = ["| " + " | ".join(row) + " |" for row in (head, *rows)]
    return "\n".join([written[0], "|---" * len(head) + "|", *written[1:]])


def with_tables(text: str, names: Iterable[str], values: Values, place: str) -> str:
    """Return a file's text with its tables as the results are.

    Args:
        text: Of the file.
        names: Of its tables.
        values: Rows of values.csv.
        place: Name of the file, for errors.

    Raises:
        SmartsError: A table's first or last line is missing, or is there twice.
    """
    for name in names:
        start = f"{BEGIN}{name} -->\n"
        before, rest = _split_once(text, start, place, "once in the file")
        own, more, others = rest.partition(BEGIN)
        _, after = _split_once(own, f"\n{END}", place, f"once behind {start.strip()!r}")
        text = f"{before}{start}{lines_of(name, values)}\n{END}{after}{more}{others}"
    return text


def _split_once(text: str, marker: str, place: str, where: str) -> tuple[str, str]:
    """Return what stands before and behind a line."""
    if (count := text.count(marker)) != 1:
        raise SmartsError(
            f"the line {marker.strip()!r} is there {count} times", place=place, remedy=f"write it {where}"
        )
    before, _, after = text.partition(marker)
    return before, after


def main() -> int:
    """Write the tables, or only compare them; return the exit code."""
    values, differing = read_values(), []
    for name, tables in FILES.items():
        file = HERE.parent / name
        text = file.read_text(encoding="utf-8")
        if (new := with_tables(text, tables, values, name)) != text:
            differing.append(name)
            if "--check" not in sys.argv:
                write_whole(file, lambda partial, new=new: partial.write_text(new, encoding="utf-8"))
    print(f"differing: {', '.join(differing) or 'none'}")
    return int("--check" in sys.argv and bool(differing))


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SmartsError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
