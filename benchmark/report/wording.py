"""How cells of the main table are put into words and numbers, the same in all files of a report."""

from __future__ import annotations

from benchmark.report.content import Cell, Report
from benchmark.report.paper import Printed, paper

MODE_TITLES = {"greedy": "Greedy", "sampled": "Sampled", "scripted": "Scripted"}
MODE_NOTES = {
    "greedy": "Test episodes of the last checkpoint, which takes its likeliest action.",
    "sampled": "Test episodes of the last checkpoint, which draws its actions, as the paper's rollouts did.",
}
AS_GOOD, WORSE = "as good", "worse"
NO_RUN = "no finished run"


def figures(cell: Cell) -> str:
    """Return collision / completion rate; empty without a finished run."""
    if cell.collision is None or cell.completion is None:
        return ""
    return f"{cell.collision.text} / {cell.completion.text}"


def intervals(cell: Cell) -> str:
    """Return the intervals of the two; "no interval" where starts repeat."""
    if cell.collision is None or cell.completion is None:
        return ""
    found = [cell.collision.interval, cell.completion.interval]
    return " / ".join(found) if all(found) else "no interval"


def interval_meaning(cell: Cell) -> str:
    """Return what the intervals are of."""
    if cell.completion is None:
        return ""
    note = cell.completion.note
    return note or f"95% interval: {cell.completion.label}"


def printed_text(cells: tuple[Printed, ...]) -> str:
    """Return the paper's figures, both where its two tables differ."""
    texts = [f"{cell.collision:g} / {cell.completion:g}" for cell in cells]
    return f"{texts[0]} (main text {', '.join(texts[1:])})" if len(texts) > 1 else "".join(texts)


def mark(cell: Cell) -> str:
    """Return how a cell compares to the paper's; empty where one of the two is missing."""
    if cell.is_as_good is None:
        return ""
    return AS_GOOD if cell.is_as_good else WORSE


def mark_meaning(cell: Cell) -> str:
    """Return what the mark rests on."""
    if not cell.printed:
        return ""
    highest, lowest = cell.printed[0].worst
    asked = f"; fewer than {paper()['test_episodes']} test episodes a seed" if cell.is_short else ""
    return f"As good: collision up to {highest:.2f} and completion from {lowest:.2f}{asked}"


def count(cell: Cell) -> str:
    """Return seeds and episodes; empty without a finished run."""
    found = cell.completion
    if found is None:
        return ""
    return f"{found.seeds} {'seed' if found.seeds == 1 else 'seeds'}, {found.episodes} episodes"


def rank_text(cell: Cell) -> str:
    """Return the rank, with what it shares; empty without one."""
    if cell.rank is None:
        return ""
    return f"rank {cell.rank}{', tie' if cell.is_tied else ''}"


def standing(report: Report) -> list[str]:
    """Return sentences on how the results compare to the paper's."""
    sentences = []
    for mode in report.modes:
        cells = [cell for row in report.main_table(mode) for cell in row.cells if cell.is_as_good is not None]
        if not cells:
            continue
        good = sum(bool(cell.is_as_good) for cell in cells)
        short = any(cell.is_short for cell in cells)
        text = f"{MODE_TITLES[mode]}: as good as the paper in {good} of {len(cells)} cells that it has too"
        sentences.append(
            f"{text}, on fewer test episodes than the {paper()['test_episodes']} a seed that this asks for."
            if short
            else f"{text}."
        )
    return sentences
