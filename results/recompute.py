"""Recompute the rates of a table from its raw rows, without the project's code, and compare with its report.

    smarts-bench report results/benchmark_v1 && python results/recompute.py results/benchmark_v1

Of packed results, or of every finished run's `episodes.parquet`, it counts how agent-episodes ended: test
episodes of the training's variations that are valid, by algorithm, cell and mode, over all training seeds. It
prints how many rates it compared with `report/values.csv` and the largest difference, and exits with 1 if
that is more than rounding (six digits) explains, if a rate is on one side only, or if there is nothing to
compare.
"""

import csv
import json
import sys
from collections import Counter
from pathlib import Path

import pyarrow.parquet as pq

RATES = {"goal": "completion_rate", "collision": "collision_rate"}
"""Outcome -> metric; the others are "ended_" and the outcome."""
ROUNDED = 1e-6
COLUMNS = ("algorithm", "task", "task_traffic", "mode", "split", "outcome", "is_invalid", "agents")


def is_finished(folder: Path) -> bool:
    """Return whether a run is finished, or a folder holds packed ones; reports leave others out."""
    file = folder / "run.json"
    run = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    return (folder / "runs.json").exists() or run.get("status") == "finished"


def counted(root: Path) -> dict[tuple[str, str, str, str], Counter]:
    """Return how often each outcome was there, by algorithm, task, traffic and mode."""
    found: dict[tuple[str, str, str, str], Counter] = {}
    for file in (root / "episodes.parquet", *sorted(root.glob("*/*/*/*/episodes.parquet"))):
        if not is_finished(file.parent):
            continue
        for row in pq.read_table(file, columns=list(COLUMNS)).to_pylist():
            if row["split"] != "held_out" and not row["is_invalid"] and row["agents"] > 0:
                key = row["algorithm"], row["task"], row["task_traffic"], row["mode"]
                found.setdefault(key, Counter())[row["outcome"]] += 1
    return found


def reported(root: Path) -> dict[tuple[str, str, str, str], dict[str, float]]:
    """Return what the report says, by algorithm, task, traffic and mode."""
    found: dict[tuple[str, str, str, str], dict[str, float]] = {}
    with (root / "report" / "values.csv").open() as file:
        for row in csv.DictReader(file):
            if row["metric"] in RATES.values() or row["metric"].startswith("ended_"):
                key = row["algorithm"], row["task"], row["traffic"], row["mode"]
                found.setdefault(key, {})[row["metric"]] = float(row["value"])
    return found


def main(root: Path) -> int:
    """Compare, print, and return the exit code."""
    ours, theirs = counted(root), reported(root)
    if not ours and not theirs:
        print(f"nothing to compare: {root} has no finished run, and its report no rate")
        return 1
    largest, compared, faults = 0.0, 0, sorted(map(str, ours.keys() ^ theirs.keys()))
    for key in ours.keys() & theirs.keys():
        total, left = sum(ours[key].values()), dict(theirs[key])
        for outcome, count in ours[key].items():
            name = RATES.get(outcome, f"ended_{outcome}")
            if name not in left:
                faults.append(f"{key}: {count} ended by {outcome}, of which the report says nothing")
                continue
            largest, compared = max(largest, abs(count / total - left.pop(name))), compared + 1
        faults += [f"{key}: {name} is {value}, there is none" for name, value in left.items() if value]
        compared += sum(not value for value in left.values())
    for fault in faults:
        print(fault)
    print(f"{compared} rates of {len(ours)} cells compared, largest difference {largest:.2g}")
    return int(bool(faults) or largest > ROUNDED)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
