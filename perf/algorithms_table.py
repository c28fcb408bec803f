"""The table of all algorithms, docs/algorithms_table.md, from the registry, the tests and committed results.

    python -m perf.algorithms_table

Its columns: paradigm and M-level of the registry; the number of tests that docs/algorithms.md names as
oracles, each of which must exist; scores on the algorithm's own games, of the same page; the best greedy
evaluations of results/yardsticks; the end of the curve at the intersection of results/all_algorithms.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path
from statistics import fmean

from algorithms.registry import ALGORITHMS
from benchmark.experiment.config import EMPTY_ROADS
from benchmark.metrics.results import Frame
from benchmark.results.packed import PROGRESS
from benchmark.results.plurals import counted
from benchmark.results.progress import read_progress
from benchmark.results.reading import packed_rows
from perf.yardstick_games import results
from perf.yardstick_games.recipes import AS_PUBLISHED, YARDSTICKS
from perf.yardstick_games.results import RunFile

ROOT = Path(__file__).resolve().parents[1]
SOURCE, TABLE = ROOT / "docs" / "algorithms.md", ROOT / "docs" / "algorithms_table.md"
TESTS = ROOT / "tests" / "unit" / "algorithms"
CURVES = ROOT / "results" / "all_algorithms"
"""Experiment with curves at the intersection."""
CONTINUATIONS = "continued.csv"
"""File with the agent-steps of trainings that were killed and continued (`perf.learning_curves`)."""
CURVE_COLUMNS = ("completion", "collision", "agent_steps")

HEAD = """# All algorithms

Made by `python -m perf.algorithms_table` from the registry, [the algorithms' page](algorithms.md) and
committed results.

- **M-level**: the multi-agent intelligence that the SMARTS paper grants this kind of algorithm.
- **Checks**: tests against the definition, named as oracles on the page.
- **Own games**: scores after few steps, in brackets that of a worse baseline or of a wrong implementation.
- **foraging, spread, matrices**: [yardsticks](algorithms.md#yardsticks), the best greedy evaluation of
  the mean over seeds (policy gradients sample in publications, see there), in brackets the number of
  seeds and the environment steps; `gru`: with memory; `as_published`: with standardised rewards and the
  time limit as a termination, as in EPyMARL. One seed does not tell
  how others would turn out: small differences between such scores prove nothing.
- **Intersection**: completion / collision of the last 100 episodes of sampled play, mean over seeds, in
  brackets their number and the agent-steps, no traffic: shared networks and otherwise default settings
  (`results/all_algorithms`, if it is there; `happo` and `networked_q` with a network for each agent),
  else of the paper's table, where `ppo` and `maddpg` are tuned.

"""

CONTINUED = """
## Killed and continued

![learning curves](learning_curves.png)

`python -m perf.learning_curves` trains each algorithm at the intersection by `smarts-bench run`, one seed,
shared networks (`happo` and `networked_q`: one for each agent) and otherwise default settings; kills
the command and all its processes (SIGKILL) after a checkpoint; and gives the same
command again. {count} of {all} algorithms so far. Curves are completion in training, with sampled actions; so
short a training ranks nothing.

Agent-steps show that the second command went on from the checkpoint's count, and no more. "Restored values":
in between, the checkpoint was restored into a new algorithm by the code with which the command continues, and
so many values that learners store (arrays of weights, targets, optimisers, random generators, ...) were equal
to those saved, bit by bit; `python -m perf.checkpoints RUN_FOLDER` compares any run's. Replay buffers are
left out of these checkpoints. That what is stored suffices is tested for every algorithm, replay included:
restored in another process, it trains one more iteration to the same values
(`tests/unit/algorithms/joint/test_whole_registry.py`).

| algorithm | killed at | of the checkpoint | next line after the checkpoint | end | restored values |
|---|---|---|---|---|---|
"""


def page(experiment: Path = CURVES, yardsticks: Path = results.FOLDER) -> str:
    """Return the page."""
    sections, failing = sections_of(SOURCE.read_text()), failing_scores(SOURCE.read_text())
    runs, curves = results.runs_in(yardsticks), curves_in(experiment)
    head = ["algorithm", "paradigm", "M-level", "checks", "own games", *YARDSTICKS, "intersection"]
    lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for name, entry in ALGORITHMS.items():
        cells = [
            f"[`{name}`](algorithms.md#{name})",
            str(entry.paradigm),
            entry.level,
            str(len(checks_of(sections[name]))),
            own_games(sections[name]["Score"], failing),
            *(yardstick(runs, game, name) for game in YARDSTICKS),
            intersection(curves, name),
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return HEAD + "\n".join(lines) + "\n" + continued(experiment / CONTINUATIONS)


def continued(file: Path) -> str:
    """Return the section of trainings that were killed and continued, empty without their table."""
    if not file.exists():
        return ""
    with file.open(newline="") as opened:
        rows = [*csv.DictReader(opened)]
    lines = []
    for row in rows:
        cells = [f"`{row.pop('algorithm')}`", *(f"{int(count):,}" for count in row.values())]
        lines.append("| " + " | ".join(cells) + " |")
    return CONTINUED.format(count=len(rows), all=len(ALGORITHMS)) + "\n".join(lines) + "\n"


def sections_of(text: str) -> dict[str, dict[str, str]]:
    """Return {algorithm: {bullet: text}} of the page's sections."""
    found = {}
    for part in re.split(r"^### ", text, flags=re.MULTILINE)[1:]:
        name = part.partition("\n")[0].strip("` ")
        body = re.split(r"^## ", part, flags=re.MULTILINE)[0]
        bullets = re.findall(r"^- \*\*(.+?)\*\*: (.+?)(?=^- \*\*|\Z)", body, re.MULTILINE | re.DOTALL)
        found[name] = {bullet: " ".join(words.split()) for bullet, words in bullets}
    return found


def failing_scores(text: str) -> dict[str, str]:
    """Return {game: score of the failing baseline} of the page's table of games."""
    rows = re.findall(r"^\| ([a-z ]+) \| .+ \| .+ \| (.+) \|$", text, re.MULTILINE)
    return {game: baseline.partition(":")[0] for game, baseline in rows}


def checks_of(section: Mapping[str, str]) -> set[str]:
    """Return the tests that a section names as oracles.

    Raises:
        LookupError: One of them does not exist.
    """
    named = set(re.findall(r"`([\w/]+\.py::\w+)`", section.get("Oracle", "")))
    for place in sorted(named):
        file, _, test = place.partition("::")
        if f"def {test}(" not in (TESTS / file).read_text():
            raise LookupError(f"there is no {test} in {TESTS / file}: correct {SOURCE}")
    return named


def own_games(scores: str, failing: Mapping[str, str]) -> str:
    """Return "game score (worse score)" of each game in a section's line of scores."""
    games: list[list[str]] = []
    for clause in scores.rstrip(".").split("; "):
        begun = re.fullmatch(r"(.+?), [\d,]+(?: steps)?[^:]*: (-?[\d.]+)(?:, )?(.*)", clause)
        if begun is None:  # a comparison of the game before
            games[-1][2] = ", ".join(filter(None, (games[-1][2], clause)))
        else:
            games.append(list(begun.groups()))
    shown = []
    for game, score, worse in games:
        baseline = worse if "`" in worse else failing[re.sub(" with .*", "", game)]
        shown.append(f"{game} {score} ({baseline})")
    return "; ".join(shown)


def yardstick(runs: list[RunFile], game: str, name: str) -> str:
    """Return the best greedy evaluation on a game, seeds, steps; then with memory and as published."""
    shown = []
    for choice in ("", "gru", AS_PUBLISHED):
        recipe = f"{name}-{choice}" if choice else name
        own = [run for run in runs if (run.game, run.algorithm) == (game, recipe)]
        if own:
            steps = min(run.curve[-1].steps for run in own)
            noted = f", {choice}" if choice else ""
            score = f"{results.best(own):.2f} ({results.seeds_of(own)}, {steps / 1e6:.2g}M{noted})"
            shown.append(score)
    return "; ".join(shown)


def curves_in(experiment: Path) -> dict[str, Frame]:
    """Return the progress of each run by its place."""
    files = experiment.glob("*/*/*/*/progress.csv")
    found = {file.parent.relative_to(experiment).as_posix(): read_progress(file) for file in files}
    return packed_rows(experiment, PROGRESS) | found


def intersection(curves: Mapping[str, Frame], name: str) -> str:
    """Return completion / collision at the end of an algorithm's curves, mean over seeds."""
    cell = f"{name}/intersection/{EMPTY_ROADS}/"
    shown = [lines.dropna(subset="completion") for place, lines in curves.items() if place.startswith(cell)]
    ends = [lines.iloc[-1][[*CURVE_COLUMNS]].astype(float) for lines in shown if len(lines)]
    if not ends:
        return ""
    completion, collision, steps = (fmean(column) for column in zip(*ends, strict=True))
    seeds = counted(len(ends), "seed")
    return f"{completion:.2f} / {collision:.2f} ({seeds}, {steps / 1e6:.2g}M)"


def main() -> None:
    """Write the page."""
    TABLE.write_text(page())
    print(f"wrote {TABLE}")


if __name__ == "__main__":
    main()
