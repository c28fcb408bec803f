"""The main table in LaTeX, to be put into a paper that uses booktabs."""

from __future__ import annotations

from itertools import groupby

from benchmark.report import wording
from benchmark.report.against_paper import BETTER, NON_INFERIOR
from benchmark.report.content import Report, TableCell
from benchmark.report.paper import algorithm_label, task_label, traffic_label

SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
}


def escaped(text: str) -> str:
    """Return a text as LaTeX prints it."""
    return "".join(SPECIAL.get(sign, sign) for sign in text)


def main_table(report: Report, mode: str) -> str:
    """Return the main table: collision / completion rate, below them intervals and the paper's figures."""
    columns = report.columns
    groups = [(traffic, len([*group])) for traffic, group in groupby(columns, key=lambda column: column[1])]
    titles = [rf"\multicolumn{{{width}}}{{c}}{{{escaped(traffic_label(name))}}}" for name, width in groups]
    rules, first = [], 2
    for _, width in groups:
        rules.append(rf"\cmidrule(lr){{{first}-{first + width - 1}}}")
        first += width
    lines = [
        "% Needs \\usepackage{booktabs}. Collision / completion rate, their 95% intervals, the paper's.",
        f"% {wording.BOLD} Asterisks: two better than the paper, one non-inferior; in brackets not counted.",
        f"% {wording.AGAINST_PAPER}",
        f"% {wording.INTERVALS}",
        f"% {wording.COMPARED}",
        *(f"% {' '.join(line.split())}" for line in wording.standing(report)),
        r"\begin{tabular}{l" + "c" * len(columns) + "}",
        r"\toprule",
        " & ".join(["", *titles]).strip() + r" \\",
        " ".join(rules),
        " & ".join(["Algorithm", *(escaped(task_label(task)) for task, _ in columns)]) + r" \\",
        r"\midrule",
    ]
    was_scripted = False
    for row in report.main_table(mode):
        if row.is_scripted and not was_scripted:
            lines.append(r"\midrule")
            was_scripted = True
        lines.append(
            " & ".join([escaped(algorithm_label(row.algorithm)), *map(_figures, row.cells)]) + r" \\"
        )
        lines.append(" & ".join(["", *map(_intervals, row.cells)]).strip() + r" \\")
        if any(cell.printed for cell in row.cells):
            lines.append(" & ".join([r"\quad\small paper", *map(_printed, row.cells)]) + r" \\")
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _figures(cell: TableCell) -> str:
    text = wording.figures(cell) or "--"
    return rf"\textbf{{{text}}}" if cell.is_best else text


def _intervals(cell: TableCell) -> str:
    # In braces, since a bracket after a row's end is an argument of it.
    if not wording.figures(cell):
        return ""
    return rf"{{\scriptsize {wording.intervals(cell)}}} {{\tiny ({wording.count(cell)})}}"


def _printed(cell: TableCell) -> str:
    if not cell.printed:
        return ""
    stars = {BETTER: r"\ast\ast", NON_INFERIOR: r"\ast"}.get(wording.mark(cell), "")
    mark = f"$^{{{f'({stars})' if not cell.counts else stars}}}$" if stars else ""
    return rf"{{\small {wording.printed_text(cell.printed)}{mark}}}"
