"""Texts of the main table's cells, the same in all files of a report."""

from __future__ import annotations

import json
from collections.abc import Iterable

from benchmark.experiment.runs import SCRIPTED, with_defaults
from benchmark.experiment.version import ENVIRONMENT, versions
from benchmark.report.against_paper import NON_INFERIOR, PASSES, WORDS
from benchmark.report.content import Report, TableCell
from benchmark.report.paper import Printed, algorithm_label, condition_label, counterpart, impossible_sum
from benchmark.report.protocol import described, differing_scenarios, differing_trainings, engine_marks
from benchmark.results.plurals import counted
from benchmark.results.versions import version_lines

MODE_TITLES = {"greedy": "Greedy", "sampled": "Sampled", SCRIPTED: "Scripted"}
MODE_NOTES = {
    "greedy": "Test episodes of the last checkpoint, with the most probable action.",
    "sampled": "Test episodes of the last checkpoint, which draws its actions, as the paper's rollouts did.",
    SCRIPTED: "Test episodes of scripted policies, which act in one way.",
}
INTERVALS = (
    "95% intervals. With three or more training seeds they are of the algorithm: Student's t on the "
    "seeds, rates on the arcsine-root scale. With one or two, marked 'this checkpoint' or 'these "
    "checkpoints', they are of the trained policies and do not cover further seeds. Either way they are "
    "at least as wide as the interval of the pooled episodes: Wilson's at trials / design effect for rates "
    "and ratios of counts, the bootstrap's for others. None where a training seed has "
    "fewer distinct starts than episodes, or where all episodes are alike."
)
ALIKE = "with the start of another"
"""Ends what a comparison says of episodes that begin alike."""
COMPARED = (
    "The unit of comparison is a distinct start of these checkpoints: an algorithm's value there over all "
    "its training seeds, paired with the other's, by Student's t. It does not cover further "
    "training seeds. Beside it, where both have three or more, stands the difference with training seeds as "
    "the unit (Welch's t; at least as wide as the other interval): three seeds prove little. P-values are "
    "corrected after Holm over all conditions, metrics and pairs of learning algorithms of the table; "
    "scripted policies against them are a family of their own. Tie: the corrected p-value is 0.05 or more. "
    "Not compared: fewer than two common starts."
)
AGAINST_PAPER = (
    "Against the paper: d is ours minus the paper's; its interval (MOVER) has the uncertainty of both, the "
    "paper's by Wilson's at 20 trials (40 agent-episodes / a design effect of 2). Better: the two-sided 95% "
    "interval of d excludes 0. Non-inferior: the one-sided 95% pessimistic end is within 0.075. Worse: the "
    "two-sided interval is on the wrong side of 0. Else undecided. A condition has the weaker word of its "
    "two figures. Not counted: conditions that random, keep-lane or parked driving passes (better or "
    "non-inferior), or in which ours passes and that is not known; conditions with social vehicles that "
    "hardly differ from those without; figures that look like misprints; runs that must not be averaged or "
    "compared."
)
COUNTERPARTS = (
    "The tasks of version 1 are not the paper's, whose figures stand beside them: agents meet slow vehicles "
    "and drivers of four kinds, observe rows of neighbours, have another reward and a shorter time limit "
    "(all differences are in a table below)."
)
TASK_DIFFERENCES = {
    "what": "What differs",
    "the paper's, as rebuilt": "In two_way, double_merge and intersection, which are after the paper",
    "version 1": "In the tasks of version 1",
}
TASK_DIFFERENCES_TITLE = "Differences from the paper's tasks"
BEST = "no other learning algorithm's checkpoints are better"
BOLD = f"Bold: in the column, {BEST} (rank 1)."
NO_RUN = "no finished run"


def figures(cell: TableCell) -> str:
    """Return collision / completion rate; empty without a finished run."""
    if cell.collision is None or cell.completion is None:
        return ""
    return f"{cell.collision.text} / {cell.completion.text}"


def intervals(cell: TableCell) -> str:
    """Return the intervals of the two; "no interval" where starts repeat."""
    if cell.collision is None or cell.completion is None:
        return ""
    found = [cell.collision.interval, cell.completion.interval]
    return " / ".join(found) if all(found) else "no interval"


def printed_text(cells: tuple[Printed, ...]) -> str:
    """Return the paper's figures, both where its two tables differ."""
    texts = [f"{cell.collision:g} / {cell.completion:g}" for cell in cells]
    return f"{texts[0]} (main text {', '.join(texts[1:])})" if len(texts) > 1 else "".join(texts)


def mark(cell: TableCell) -> str:
    """Return how a condition compares with the paper's; empty if one of the two has no figures."""
    return cell.comparison.word if cell.comparison else ""


def not_counted(cell: TableCell) -> str:
    """Return why the paper's condition does not count, and what else is odd about it; empty if neither."""
    found = ["" if cell.counts else f"not counted: {', '.join(cell.reasons)}", impossible_sum(cell.printed)]
    return "; ".join(filter(None, found))


def mark_meaning(cell: TableCell) -> str:
    """Return the differences behind the word."""
    if not cell.comparison:
        return ""
    gaps = [
        f"{gap.name} {gap.value:+z.2f} [{gap.low:+z.2f}, {gap.high:+z.2f}], "
        f"better by at least {gap.gain:+z.3f}: {gap.word}"
        for gap in cell.comparison.gaps
    ]
    return f"Ours minus the paper's: {'; '.join(gaps)}"


def count(cell: TableCell) -> str:
    """Return seeds, episodes, and what is to be known of them; empty without a finished run."""
    found = cell.completion
    if found is None:
        return ""
    counts = ", ".join(filter(None, (found.seeds_text, counted(found.episodes, "episode"))))
    steps = f"{cell.steps:,} agent-steps, so without a rank" if cell.steps is not None else ""
    return "; ".join(
        filter(None, (counts, found.label if found.is_of_checkpoints else "", steps, cell.unlike))
    )


def rank_text(cell: TableCell) -> str:
    """Return the rank, with what it shares; empty without one."""
    if cell.standing.rank is None:
        return ""
    return f"rank {cell.standing.rank}{', tie' if cell.standing.is_tied else ''}"


def has_counterparts(report: Report) -> bool:
    """Return whether tasks of version 1 stand beside the paper's figures."""
    return report.has_paper and any(counterpart(task) != task for task in report.tasks)


def standing(report: Report) -> list[str]:
    """Return sentences on the version, on runs that must not be compared, and on the paper."""
    runs = report.results.runs
    sentences = version_lines(runs) + differing_scenarios((run, str(run)) for run in runs)
    sentences += differing_trainings(runs) + _protocols(report) + _apart(report)
    sentences += [
        f"Figures are of another traffic than SUMO's where there stands: {mark}."
        for mark in sorted({*engine_marks(report.results.finished).values()})
    ]
    sentences += _environments(report)
    if has_counterparts(report):
        sentences.append(COUNTERPARTS)
    return sentences + [line for mode in report.modes for line in _against_paper(report, mode)]


def _protocols(report: Report) -> list[str]:
    """Return in which conditions the protocols of algorithms differ, and in what."""
    said: dict[str, list[str]] = {}
    for column in report.columns:
        entries: dict[str, list[str]] = {}
        for (name, *cell), protocol in report.protocols.items():
            if (*cell,) == column:
                entries.setdefault(protocol, []).append(algorithm_label(name))
        if len(entries) > 1:
            parts = zip(entries.values(), described([*entries]), strict=True)
            text = "; ".join(f"{', '.join(sorted(names))}: {what}" for names, what in parts)
            said.setdefault(text, []).append(condition_label(*column))
    return [
        f"Ranks hold within one protocol only, and there are several in {'; '.join(cells)}: {text}."
        for text, cells in said.items()
    ]


def _apart(report: Report) -> list[str]:
    """Return in which conditions no algorithm has a rank, since all were trained for other agent-steps."""
    cells = []
    for column in report.columns:
        places = [place for place in report.protocols if place[1:] == column]
        if len(places) > 1 and {*places} <= {*report.other_steps}:
            cells.append(condition_label(*column))
    return [f"No ranks, since all trained for different agent-steps: {'; '.join(cells)}."] if cells else []


def _environments(report: Report) -> list[str]:
    """Return in what the environment of runs beside the paper's figures is not that of the paper's tasks."""
    said: dict[str, list[str]] = {}
    for run in report.results.finished:
        if run.is_scripted or not report.printed(run.algorithm, run.task, run.traffic):
            continue
        is_version_1 = counterpart(run.task) != run.task
        usual = versions()[1][ENVIRONMENT] if is_version_1 else {}
        both = (
            with_defaults({ENVIRONMENT: x})[ENVIRONMENT] for x in (run.config.get(ENVIRONMENT, {}), usual)
        )
        found, rebuilt = described([json.dumps(each, sort_keys=True) for each in both])
        if found != rebuilt:
            text = f"driven with {found}, where the tasks after the paper have {rebuilt}"
            said.setdefault(text, []).append(condition_label(run.task, run.traffic))
    return [f"{'; '.join(dict.fromkeys(cells))}: {text}." for text, cells in said.items()]


def _against_paper(report: Report, mode: str) -> list[str]:
    """Return how many conditions have which word, and which do not count."""
    every = [(row, cell) for row in report.main_table(mode) for cell in row.cells if mark(cell)]
    if not every:
        return []
    found = [mark(cell) for _, cell in every if cell.counts]
    passed = sum(word in PASSES for word in found)
    words = ", ".join(f"{word} in {found.count(word)}" for word in reversed(WORDS))
    title = MODE_TITLES[mode]
    share = f"{passed} of {len(found)} conditions that count ({words})"
    lines = [
        f"{title}: better than or {NON_INFERIOR} to the paper in {share}."
        if found
        else f"{title}: no condition counts against the paper."
    ]
    left_out: dict[tuple[str, str], list[str]] = {}
    for row, cell in every:
        if not cell.counts:
            place = condition_label(cell.task, cell.traffic)
            named = left_out.setdefault((place, ", ".join(cell.reasons)), [])
            named.append(algorithm_label(row.algorithm))
    if left_out:
        named = [f"{place}: {', '.join(names)} ({reason})" for (place, reason), names in left_out.items()]
        lines.append(f"{title}: not counted: {'; '.join(named)}.")
    return lines


def left_out(report: Report) -> list[str]:
    """Return what is not compared: runs that must not be, and pairs of different protocols."""
    entries: dict[str, list[str]] = {}
    for (name, *cell), reason in report.unlike.items():
        entries.setdefault(reason, []).append(f"{algorithm_label(name)} in {condition_label(*cell)}")
    said = [f"Left out, since {reason}: {'; '.join(names)}." for reason, names in entries.items()]
    cells = []
    for column in report.columns:
        protocols = {protocol for (_, *cell), protocol in report.compared.items() if (*cell,) == column}
        cells += [condition_label(*column)] if len(protocols) > 1 else []
    return said + ([f"Pairs of different protocols are left out in {'; '.join(cells)}."] if cells else [])


def pairs_notes(notes: Iterable[str]) -> list[str]:
    """Return what comparisons say of episodes that are no pair of their own, each once.

    Args:
        notes: Notes of `benchmark.metrics.compare`.
    """
    said: dict[str, None] = {}
    for note in notes:
        alike = [part for part in note.split(", ") if part.endswith(ALIKE)]
        other = [part for part in note.split(", ") if part and part not in alike]
        for part in alike:
            said[
                f"{part.removesuffix(ALIKE)}begin as another does, and count together with it; with one "
                "start there is no interval: vary the starts, by the scenario's `start_variation`"
            ] = None
        if other:
            said[f"left out: {', '.join(other)}"] = None
    return [*said]
