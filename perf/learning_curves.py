"""A learning curve of each algorithm at the intersection, of trainings that are killed and continued.

    python -m perf.learning_curves [--algorithms ppo ...] [--steps 300000] [--out results]
    python -m perf.learning_curves --page

Trains each algorithm by `smarts-bench run configs/all_algorithms.yaml` with this budget. Once there is a
checkpoint and a line of progress after it, the command and all its processes get SIGKILL. The checkpoint then
has to be restored whole into a new algorithm, which `perf.checkpoints` compares value by value, and the same
command trains to the end. The lines of progress before the checkpoint must still be there, and the next has
to follow it; the agent-steps at each point go into results/all_algorithms/continued.csv. Algorithms that it
has are left out: the same command resumes. Then docs/learning_curves.png and docs/algorithms_table.md are
made again. Exit code 1: a checkpoint was not restored, or a training did not continue where it was.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from algorithms.registry import ALGORITHMS, Paradigm
from benchmark.experiment.config import EMPTY_ROADS
from benchmark.report.style import PALETTE
from benchmark.results.progress import read_progress
from benchmark.results.run_folder import CONTINUED, FINISHED, RunFolder
from perf import algorithms_table
from perf.algorithms_table import CONTINUATIONS
from perf.checkpoints import check_apart
from perf.endurance import PATIENCE, Training

ROOT = Path(__file__).resolve().parents[1]
CONFIG, FIGURE = ROOT / "configs" / "all_algorithms.yaml", ROOT / "docs" / "learning_curves.png"
EXPERIMENT = CONFIG.stem
PANEL = 7
"""Most curves of a panel."""


class Continuation(NamedTuple):
    """Agent-steps of a training that was killed and continued."""

    algorithm: str
    killed: int
    """Last line of progress before the kill."""
    checkpoint: int
    """What was saved then."""
    next_line: int
    """First line of progress after the checkpoint, of the continued training."""
    end: int
    restored: int
    """Values that were equal after the checkpoint was restored."""


def run_folder(out: Path, algorithm: str) -> Path:
    """Return the folder of an algorithm's run."""
    return out / EXPERIMENT / algorithm / "intersection" / EMPTY_ROADS / "seed_1"


def kill_and_continue(algorithm: str, steps: int, out: Path) -> Continuation:
    """Train an algorithm with a kill in between.

    Raises:
        RuntimeError: A command ended early, the checkpoint is not restored whole, or the training did not
            continue where it was.
    """
    folder = run_folder(out, algorithm)
    if RunFolder(folder).status == FINISHED:
        raise RuntimeError(f"{folder}: it was finished before it was killed; remove it to train again")
    chosen = (f"algorithms=[{algorithm}]", f"budget.agent_steps={steps}")
    arguments = ["run", os.path.relpath(CONFIG), "--out", os.path.relpath(out)]
    arguments += [part for value in chosen for part in ("--set", value)]
    training = Training(arguments, folder, out / f".{EXPERIMENT}.log")
    training.start()
    training.wait(lambda: training.steps() > training.saved() > 0)
    training.process.send_signal(signal.SIGKILL)  # first, so that it starts no worker again
    for process in training.processes(""):
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
    training.interrupt(signal.SIGKILL)
    before = read_progress(folder / "progress.csv").to_dict("records")
    state = json.loads((folder / "checkpoint" / "training.json").read_text())
    restored = check_apart(folder)
    training.start()
    code = training.process.wait(PATIENCE)
    if code:
        raise RuntimeError(
            f"{algorithm}: the continued command ended with exit code {code}, see {training.log}"
        )
    after = read_progress(folder / "progress.csv").to_dict("records")
    found = continuation(algorithm, before, state, after, restored.values)
    if len(RunFolder(folder).facts().get(CONTINUED, ())) < 1:
        raise RuntimeError(f"{folder}: run.json does not say that the run was continued")
    return found


def continuation(
    algorithm: str,
    before: Sequence[Mapping[Any, Any]],
    state: Mapping[str, Any],
    after: Sequence[Mapping[Any, Any]],
    restored: int,
) -> Continuation:
    """Check that a training continued from its checkpoint, and return its counts.

    Args:
        algorithm: Its name.
        before: Lines of progress at the kill.
        state: Of training, in the checkpoint at the kill.
        after: Lines of progress at the end.
        restored: Values that were equal after the checkpoint was restored.

    Raises:
        RuntimeError: Lines of before the checkpoint were lost or changed, or later ones do not follow it.
    """
    kept = state["iteration"]
    problem = ""
    if not 0 < kept < len(after):
        problem = f"the checkpoint is of iteration {kept}, and there are {len(after)} lines"
    elif [str(line) for line in after[:kept]] != [str(line) for line in before[:kept]]:
        problem = "lines of before the checkpoint have changed"
    elif after[kept - 1]["agent_steps"] != state["agent_steps"]:
        problem = f"line {kept} is not of the checkpoint's {state['agent_steps']} agent-steps"
    elif [line["iteration"] for line in after] != [*range(1, len(after) + 1)]:
        problem = "iterations are missing or repeated"
    elif any(one["agent_steps"] >= other["agent_steps"] for one, other in pairwise(after)):
        problem = "agent-steps do not grow"
    if problem:
        raise RuntimeError(f"{algorithm}: {problem}")
    counts = (lines[k]["agent_steps"] for lines, k in ((before, -1), (after, kept), (after, -1)))
    killed, following, end = map(int, counts)
    return Continuation(algorithm, killed, int(state["agent_steps"]), following, end, restored)


def read(file: Path) -> list[Continuation]:
    """Return the continuations of a table, none if there is none."""
    if not file.exists():
        return []
    with file.open(newline="") as opened:
        rows = csv.DictReader(opened)
        return [
            Continuation(row["algorithm"], *(int(row[name]) for name in Continuation._fields[1:]))
            for row in rows
        ]


def write(found: Sequence[Continuation], file: Path) -> None:
    """Write continuations in the order of the registry."""
    order = list(ALGORITHMS)
    ordered = sorted(found, key=lambda each: order.index(each.algorithm))
    with file.open("w", newline="") as opened:
        rows = csv.writer(opened, lineterminator="\n")
        rows.writerows([Continuation._fields, *ordered])


def panels(names: Sequence[str]) -> dict[str, list[str]]:
    """Return the curves of each panel by its title, not more than `PANEL` in one."""
    by_paradigm = {
        paradigm: [name for name in names if ALGORITHMS[name].paradigm == paradigm] for paradigm in Paradigm
    }
    found: dict[str, list[str]] = {}
    for paradigm, own in by_paradigm.items():
        parts = -(-len(own) // PANEL)
        for part in range(parts):
            title = str(paradigm.value) + (f" ({part + 1} of {parts})" if parts > 1 else "")
            size = -(-len(own) // parts)
            found[title] = own[part * size : (part + 1) * size]
    return found


def draw(out: Path, names: Sequence[str], file: Path) -> None:
    """Draw completion in training over agent-steps, and write the picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    groups = panels(names)
    columns = min(len(groups), 3)
    rows = -(-len(groups) // columns)
    figure = Figure(figsize=(4.2 * columns, 3.2 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).flat
    curves = algorithms_table.curves_in(out / EXPERIMENT)
    for place, (title, own) in zip(axes, groups.items(), strict=False):
        for number, name in enumerate(own):
            lines = curves[run_folder(Path(), name).relative_to(EXPERIMENT).as_posix()]
            place.plot(
                lines["agent_steps"] / 1000,
                lines["completion"],
                color=PALETTE[number],
                label=name,
                linewidth=1.3,
            )
        place.set_title(title, fontsize=9)
        place.set(ylim=(-0.02, 1.02), xlabel="thousand agent-steps", ylabel="completion")
        place.grid(color="#e3e3e3", linewidth=0.6)
        place.legend(fontsize=7)
    for place in [*axes][len(groups) :]:
        place.remove()
    figure.savefig(file, dpi=90, metadata={"Software": None})


def main() -> int:
    """Train what is missing, and draw; return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--algorithms", nargs="+", choices=[*ALGORITHMS], default=[*ALGORITHMS])
    parser.add_argument("--steps", type=int, default=300_000, help="agent-steps of each (default 300000)")
    parser.add_argument("--out", type=Path, default=ROOT / "results", help="folder of the experiment")
    parser.add_argument("--figure", type=Path, default=FIGURE)
    parser.add_argument("--page", action="store_true", help="only draw, and make the table again")
    given = parser.parse_args()
    file = given.out / EXPERIMENT / CONTINUATIONS
    found, code = read(file), 0
    known = {each.algorithm for each in found}
    for name in [] if given.page else given.algorithms:
        if name in known:
            continue
        try:
            found.append(kill_and_continue(name, given.steps, given.out))
        except RuntimeError as error:
            print(f"{name}: FAILED: {error}", flush=True)
            code = 1
            continue
        print(found[-1], flush=True)
        write(found, file)
    if found:
        draw(given.out, [each.algorithm for each in read(file)], given.figure)
    if given.out.resolve() == ROOT / "results":
        algorithms_table.main()
    return code


if __name__ == "__main__":
    sys.exit(main())
