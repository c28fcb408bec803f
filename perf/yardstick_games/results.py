"""The files of runs, and the page and the picture that are made of them."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from algorithms.registry import ALGORITHMS, Paradigm
from benchmark.results.plurals import counted
from perf.yardstick_games.recipes import YARDSTICKS, Published, Yardstick

FOLDER = Path(__file__).resolve().parents[2] / "results" / "yardsticks"
RANDOM = "random"
SEED = "evaluation_seed"
"""In a run's first line: of the evaluations' episodes; without it they are the training seed's own."""


class Evaluation(NamedTuple):
    """Mean scores after so many environment steps.

    Attributes:
        steps: Environment steps of training.
        greedy: Score of greedy play, NaN for random play.
        sampled: Score of play as in training.
        looped: Share of the greedy episodes in which all agents saw again what they had seen before.
        seconds: Processor time of the training so far [s].
    """

    steps: int
    greedy: float
    sampled: float
    looped: float
    seconds: float


class RunFile(NamedTuple):
    """A run: what made it, and its curve.

    Attributes:
        game: Name of the game.
        algorithm: Name of the algorithm, or "random".
        seed: Of the training.
        about: Command, commit and settings.
        curve: Evaluations, the last at the end of the training.
    """

    game: str
    algorithm: str
    seed: int
    about: Mapping[str, Any]
    curve: list[Evaluation]


def file_of(folder: Path, game: str, algorithm: str, seed: int) -> Path:
    """Return where a run lies."""
    return folder / game / f"{algorithm}_{seed}.csv"


def write(folder: Path, run: RunFile) -> None:
    """Write a run; a file is never half written."""
    out = io.StringIO()
    out.write(f"# {json.dumps(dict(run.about))}\n")
    rows = csv.writer(out, lineterminator="\n")
    rows.writerow(Evaluation._fields)
    rows.writerows(
        [e.steps, f"{e.greedy:.4f}", f"{e.sampled:.4f}", f"{e.looped:.3f}", f"{e.seconds:.0f}"]
        for e in run.curve
    )
    file = file_of(folder, run.game, run.algorithm, run.seed)
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_suffix(".part")
    part.write_text(out.getvalue())
    part.replace(file)


def read(file: Path) -> RunFile:
    """Read a run."""
    first, *rest = file.read_text().splitlines()
    algorithm, _, seed = file.stem.rpartition("_")
    rows = csv.DictReader(rest)
    curve = [
        Evaluation(int(row["steps"]), *(float(row[name]) for name in Evaluation._fields[1:])) for row in rows
    ]
    return RunFile(file.parent.name, algorithm, int(seed), json.loads(first.removeprefix("# ")), curve)


def runs_in(folder: Path) -> list[RunFile]:
    """Return all runs, by game in the order of the table, algorithm and seed."""
    games = list(YARDSTICKS)
    found = [read(file) for file in folder.glob("*/*.csv")]
    return sorted(found, key=lambda run: (games.index(run.game), run.algorithm, run.seed))


def page(folder: Path = FOLDER) -> str:
    """Return the Markdown page of all runs."""
    runs = runs_in(folder)
    parts = [HEAD.replace("{episodes}", episodes_of(runs))]
    for name, game in YARDSTICKS.items():
        own = [run for run in runs if run.game == name]
        if own:
            parts.append(section(name, game, own))
    return "\n".join(parts)


HEAD = """# Yardsticks

Games of other publications, played by our algorithms. `python -m perf.yardsticks --games GAME` trains
and writes this page, `python -m perf.yardsticks --page` only writes it. The settings are in
`perf/yardstick_games/recipes.py`, and with the commit in the first line of each run's file.

Scores are means over 200 episodes and over training seeds; in brackets how many seeds, where they
are fewer than three: such a score does not tell how further seeds would turn out, and differences
between them prove nothing. {episodes} "Best" is the highest evaluation of the mean over seeds; it is chosen
on the same episodes, so it is too high by chance. "Last" is at the end. Sampled play explores as at the end
of the training.

Of the runs with one seed in foraging and spread, 27 were made on another processor, and those of 26
November 2026 by a loop over `perf.yardsticks.trained` that does not start Ray: the seconds in their files
compare with no others.

Published rows (in italics) are the largest means over evaluations. EPyMARL evaluates policy gradients by
sampled play (`action_selector: "soft_policies"`, which ignores test mode) and values by greedy play: they
stand in the column of that mode, and ours is to be read in the same one. "Looped" is the share
of greedy episodes in which all agents see again what they saw before: without memory such a team repeats
itself for ever.

Greedy play, thin by seed; curves far below random play are cut.

![curves](curves.png)
"""


def section(name: str, game: Yardstick, runs: Sequence[RunFile]) -> str:
    """Return the part of the page about one game."""
    lines = [
        f"## {name}\n",
        f"{game.measure[0].upper()}{game.measure[1:]}.\n",
        "| algorithm | seeds | steps | greedy, last | by seed | greedy, best | sampled, last | sampled, best "
        "| looped |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for algorithm in dict.fromkeys(run.algorithm for run in runs):
        own = [run for run in runs if run.algorithm == algorithm]
        lines.append(row(algorithm, own))
    lines += [published(each) for each in game.published]
    return "\n".join(lines) + "\n"


def published(score: Published) -> str:
    """Return the line of a score from elsewhere, in the column of its mode."""
    best = {mode: f"*{score.score:.2f}*" if mode == score.mode else "" for mode in ("greedy", "sampled")}
    named = f"*{score.algorithm}, {score.source}*"
    return f"| {named} | | *{score.steps:,}* | | | {best['greedy']} | | {best['sampled']} | |"


def episodes_of(runs: Sequence[RunFile]) -> str:
    """Return in words which episodes the runs' evaluations play."""
    own = sum(SEED not in run.about for run in runs if run.algorithm != RANDOM)
    fixed = "The episodes are the same for all training seeds"
    if not own:
        return f"{fixed}."
    all_runs = sum(run.algorithm != RANDOM for run in runs)
    if own == all_runs:
        return "Episodes are each training seed's own."
    where = f"the {own} of {all_runs} runs without `{SEED}` in their first line"
    return f"{fixed}, but each training seed's own in {where}."


def row(algorithm: str, runs: Sequence[RunFile]) -> str:
    """Return the line of an algorithm's runs."""
    ends = [run.curve[-1] for run in runs]
    means = (float(np.mean([getattr(e, name) for e in ends])) for name in ("greedy", "sampled"))
    greedy, sampled = (scored(mean, runs) for mean in means)
    if algorithm == RANDOM:
        return f"| `{algorithm}` | | | | | | {np.mean([e.sampled for e in ends]):.2f} | | |"
    steps = " ".join(f"{count:,}" for count in dict.fromkeys(end.steps for end in ends))
    seeds = ", ".join(f"{run.seed}: {end.greedy:.2f}" for run, end in zip(runs, ends, strict=True))
    looped = f"{np.mean([e.looped for e in ends]):.2f}"
    cells = (
        str(len(runs)),
        steps,
        greedy,
        seeds,
        scored(best(runs), runs),
        sampled,
        scored(best(runs, "sampled"), runs),
        looped,
    )
    return f"| `{algorithm}` | {' | '.join(cells)} |"


def scored(score: float, runs: Sequence[RunFile]) -> str:
    """Return a score, with the number of training seeds behind it where they are fewer than three."""
    return f"{score:.2f}" + (f" ({seeds_of(runs)})" if len(runs) < 3 else "")


def seeds_of(runs: Sequence[RunFile]) -> str:
    """Return how many training seeds there are, in words."""
    return counted(len(runs), "seed")


def best(runs: Sequence[RunFile], mode: Literal["greedy", "sampled"] = "greedy") -> float:
    """Return the highest evaluation of the mean over runs."""
    shortest = min(len(run.curve) for run in runs)
    return float(np.mean([[getattr(e, mode) for e in run.curve[:shortest]] for run in runs], 0).max())


def draw(folder: Path = FOLDER) -> None:
    """Draw the greedy curves, a row for each game and a column for each paradigm."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    runs = runs_in(folder)
    games = [game for game in YARDSTICKS if any(run.game == game and run.algorithm != RANDOM for run in runs)]
    paradigms = tuple(Paradigm)
    figure = Figure(figsize=(6 * len(paradigms), 4 * max(len(games), 1)), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(max(len(games), 1), len(paradigms), squeeze=False, sharey="row")
    for game, row in zip(games, panels, strict=False):
        for paradigm, axes in zip(paradigms, row, strict=True):
            axes.set(title=f"{game}, {paradigm.value}", xlabel="environment steps")
            _draw_curves(axes, [run for run in runs if run.game == game and _paradigm_of(run) == paradigm])
        row[0].set_ylabel("score, greedy")
        by_chance = [run.curve[-1].sampled for run in runs if run.game == game and run.algorithm == RANDOM]
        if by_chance:  # what is far below random play would flatten all else
            top = max(
                e.greedy for run in runs if run.game == game and run.algorithm != RANDOM for e in run.curve
            )
            row[0].set_ylim(by_chance[0] - 0.15 * (top - by_chance[0]), top + 0.05 * (top - by_chance[0]))
    figure.savefig(folder / "curves.png", dpi=80, metadata={"Software": None})


def _paradigm_of(run: RunFile) -> Paradigm | None:
    found = ALGORITHMS.get(run.algorithm.partition("-")[0])
    return None if found is None else found.paradigm


def _draw_curves(axes: Any, runs: Sequence[RunFile]) -> None:
    """Draw each run of some algorithms thinly, and each algorithm's mean over its seeds."""
    for number, name in enumerate(dict.fromkeys(run.algorithm for run in runs)):
        style = {"color": f"C{number % 10}", "linestyle": ("-", "--")[number // 10 % 2]}
        own = [run.curve for run in runs if run.algorithm == name]
        shared = min(map(len, own))
        steps = [e.steps for e in own[0][:shared]]
        scores = np.array([[e.greedy for e in curve[:shared]] for curve in own])
        if len(own) > 1:
            axes.plot(steps, scores.T, linewidth=0.5, **style)
        axes.plot(steps, scores.mean(0), label=f"{name} ({counted(len(own), 'seed')})", **style)
    if runs:
        axes.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
