"""Which scenario files of a folder can be played: a table of what each is built and reset to.

    python -m perf.scenario_files path/to/SMARTS/scenarios

Every `scenario.py` below the folder is built, beside itself where that can be written, reset once with an ego
for every mission (with one, where missions start in one place), and then played for 10 s with one ego, social
agents and bubbles. The table has a row for each: "plays", "plays, but" with the builder's warnings, or the
error. It ends with how many of each there are.
"""

from __future__ import annotations

import argparse
import logging
from collections import Counter
from contextlib import closing
from pathlib import Path

import numpy as np

from smarts.env import VectorHiWayEnv
from smarts.errors import SmartsError
from smarts.sim.moments import reset_moment
from smarts.sstudio.build import build_scenario

SEED, DECISIONS = 42, 20
KEEP_LANE = np.zeros((1, 1), int)


def outcome(folder: Path) -> tuple[str, str]:
    """Return how a scenario fares, and why."""
    try:
        built = build_scenario(folder)
        reset_moment(built, next(iter(built.traffic), None))
        _play(folder)
    except SmartsError as error:
        return "refused", f"{error.problem} ({error.place})"
    return ("plays, but", "; ".join(built.warnings)) if built.warnings else ("plays", "")


def _play(folder: Path) -> None:
    with closing(VectorHiWayEnv(1, [folder], 1)) as env:
        env.reset(SEED)
        for _ in range(DECISIONS):
            failures = env.step([KEEP_LANE]).social_failures
            if failures:
                raise SmartsError(f"social agents fail: {failures[0]}", place=str(folder))


def main() -> None:
    """Print the table of all scenario files below the folder that the command line names."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("root", type=Path)
    root = parser.parse_args().root
    logging.disable(logging.WARNING)  # the table has them
    counts = Counter[str]()
    print("| scenario | | |\n|---|---|---|")
    for script in sorted(root.rglob("scenario.py")):
        kind, why = outcome(script.parent)
        counts[kind] += 1
        name = script.parent.relative_to(root).as_posix()
        print(f"| {name} | {kind} | {why.replace(str(root.resolve()), '')} |", flush=True)
    print("\n" + ", ".join(f"{count} {kind}" for kind, count in sorted(counts.items())))


if __name__ == "__main__":
    main()
