"""Texts of the main table's cells, the same in all files of a report."""

from __future__ import annotations

import math

from benchmark.metrics.results import THIS_CHECKPOINT
from benchmark.report.content import Report, TableCell
from benchmark.report.paper import Printed, paper
from benchmark.report.protocol import differing_scenarios

MODE_TITLES = {"greedy": "Greedy", "sampled": "Sampled", "scripted": "Scripted"}
MODE_NOTES = {
    "greedy": "Test episodes of the last checkpoint, with the most probable action.",
    "sampled": "Test episodes of the last checkpoint, which draws its actions, as the paper's rollouts did.",
}
NON_INFERIOR, INFERIOR = "non-inferior", "inferior"
INTERVALS = (
    "95% intervals. With three or more training seeds they are of the algorithm: Student's t on the "
    "seeds, rates on the arcsine-root scale. With one or two, marked 'this checkpoint' or 'these "
    "checkpoints', they are of the trained policies and do not cover further seeds. Either way they are "
    "at least as wide as the interval of the pooled episodes: Wilson's at trials / design effect for rates "
    "and ratios of counts, the bootstrap's for others. None where a training seed has "
    "fewer distinct starts than episodes, or where all episodes are alike."
)
COMPARED = (
    "The unit of comparison is a distinct start of these checkpoints: an algorithm's value there over all "
    "its training seeds, paired with the other's, by Student's t. It does not cover further "
    "training seeds; the cells' intervals show how far seeds spread. P-values are "
    "corrected after Holm over the pairs of learning algorithms in a cell and metric; scripted "
    "policies against them are a family of their own. Tie: the corrected p-value is 0.05 or more. Not "
    "compared: fewer than two common starts."
)
NON_INFERIOR_MEANS = (
    "Non-inferior to the paper: the collision rate is not above, and the completion rate not below, the 95% "
    "Wilson bound of the paper's cell at its 40 agent-episodes, on 200 test episodes a seed; cells with "
    "fewer are not marked."
)
BOLD = "Bold: no other learning algorithm of the column is better (rank 1)."
THESE_CHECKPOINTS = "these checkpoints"
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


def interval_meaning(cell: TableCell) -> str:
    """Return what the intervals are of."""
    if cell.completion is None:
        return ""
    note = cell.completion.note
    return note or f"95% interval: {cell.completion.label}"


def printed_text(cells: tuple[Printed, ...]) -> str:
    """Return the paper's figures, both where its two tables differ."""
    texts = [f"{cell.collision:g} / {cell.completion:g}" for cell in cells]
    return f"{texts[0]} (main text {', '.join(texts[1:])})" if len(texts) > 1 else "".join(texts)


def mark(cell: TableCell) -> str:
    """Return how a cell compares with the paper's; empty if one is missing or has too few episodes."""
    if cell.is_non_inferior is None:
        return ""
    return NON_INFERIOR if cell.is_non_inferior else INFERIOR


def mark_meaning(cell: TableCell) -> str:
    """Return the bounds of the mark."""
    if not cell.printed:
        return ""
    bounds = [each.worst for each in cell.printed]
    # Rounded inwards, so that rates within the printed bounds are non-inferior.
    highest = math.floor(1000 * min(bound[0] for bound in bounds)) / 1000
    lowest = math.ceil(1000 * max(bound[1] for bound in bounds)) / 1000
    return f"Non-inferior: collision up to {highest:.3f} and completion from {lowest:.3f}"


def count(cell: TableCell) -> str:
    """Return seeds, episodes and whether intervals are of one checkpoint; empty without a finished run."""
    found = cell.completion
    if found is None:
        return ""
    checkpoints = THIS_CHECKPOINT if found.seeds == 1 else THESE_CHECKPOINTS
    label = f"; {checkpoints}" if found.label == THIS_CHECKPOINT else ""
    return f"{found.seeds} {'seed' if found.seeds == 1 else 'seeds'}, {found.episodes} episodes{label}"


def rank_text(cell: TableCell) -> str:
    """Return the rank, with what it shares; empty without one."""
    if cell.rank is None:
        return ""
    return f"rank {cell.rank}{', tie' if cell.is_tied else ''}"


def standing(report: Report) -> list[str]:
    """Return sentences on comparisons with the paper, and on runs that must not be compared."""
    sentences = differing_scenarios((run, str(run)) for run in report.results.runs)
    for mode in report.modes:
        every = [cell for row in report.main_table(mode) for cell in row.cells]
        marked = [cell.is_non_inferior for cell in every if cell.is_non_inferior is not None]
        if marked:
            where = f"in {sum(marked)} of {len(marked)} cells that the paper has"
            bounds = "by the 95% bounds of its cells, which are of 40 agent-episodes each"
            sentences.append(f"{MODE_TITLES[mode]}: non-inferior to the paper {where}, {bounds}.")
        short = sum(bool(cell.printed) and cell.is_short for cell in every)
        if short:
            asked = f"fewer test episodes than the {paper()['test_episodes']} a seed that this asks for"
            sentences.append(
                f"{MODE_TITLES[mode]}: {short} cells are not compared with the paper's: {asked}."
            )
    return sentences
