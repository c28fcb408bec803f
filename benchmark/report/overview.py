"""A line for each algorithm and condition: ways of acting, distance to rules, worst held-out variation."""

from __future__ import annotations

import math
from collections.abc import Callable

from benchmark.report.content import Report, TableCell
from benchmark.report.paper import algorithm_label, task_label, traffic_label
from benchmark.report.values import GENERALIZATION, Value
from benchmark.report.wording import figures, rank_text

RULE_BASED = "gap_acceptance"
COLUMNS = {
    "task": "What is driven",
    "traffic": "Social vehicles on the road",
    "algorithm": "Or the rule-based policy",
    "rank": "Among the learning algorithms of the condition",
    "seeds": "Training seeds",
    "greedy": "Collision rate / completion rate of the most probable actions",
    "sampled": "Collision rate / completion rate of drawn actions",
    "greedy - sampled": "Difference of the completion rates",
    f"- {RULE_BASED}": "Collision rate / completion rate less those of the rule-based policy",
    "worst held out": "Collision rate / completion rate of the held-out variation in which the policy is "
    "farthest behind its training",
}
LEFT = (0, 1, 2, 9)
"""Columns of words."""
NOTE = (
    "Collision rate / completion rate, of algorithms and of the rule-based policy where it was played. Rank, "
    "distance to the rule-based policy and the held-out variation are of {} acting. Worst held out: the "
    "variation in which a policy is farthest behind its training; n/a where it completes less than 0.5 in "
    "training. Differences have no interval here: see the main tables, and differences.csv."
)


def note(report: Report) -> str:
    """Return what stands above the table."""
    return NOTE.format(report.modes[0])


def overview_rows(report: Report) -> list[list[str]]:
    """Return a row for each algorithm, and the rule-based policy, that has finished a condition."""
    main, others = report.modes[0], {mode: _by_place(report, mode) for mode in report.modes}
    rows = []
    for task, traffic in report.columns:
        for name, is_scripted in report.names:
            cells = {mode: found[name, task, traffic] for mode, found in others.items()}
            first, rules = cells[main], others[main].get((RULE_BASED, task, traffic))
            if first.completion is None or (is_scripted and name != RULE_BASED):
                continue
            greedy = first if is_scripted else cells.get("greedy")  # scripted policies act in one way
            sampled = None if is_scripted else cells.get("sampled")
            reached = report.value(name, task, traffic, main, GENERALIZATION)
            rows.append(
                [
                    *(task_label(task), traffic_label(traffic)),
                    algorithm_label(name) + (f" ({first.unlike})" if first.unlike else ""),
                    *(rank_text(first).removeprefix("rank "), str(first.completion.seeds or "")),
                    *(figures(acting) if acting else "" for acting in (greedy, sampled)),
                    _less(greedy, sampled, lambda cell: (cell.completion,)),
                    "" if name == RULE_BASED else _less(first, rules, lambda x: (x.collision, x.completion)),
                    _worst(reached),
                ]
            )
    return rows


def _by_place(report: Report, mode: str) -> dict[tuple[str, str, str], TableCell]:
    return {
        (row.algorithm, cell.task, cell.traffic): cell
        for row in report.main_table(mode)
        for cell in row.cells
    }


def _less(
    first: TableCell | None, second: TableCell | None, rates: Callable[[TableCell], tuple[Value | None, ...]]
) -> str:
    """Return differences of rates, first minus second; empty where one is missing."""
    pairs = [*zip(rates(first), rates(second), strict=True)] if first and second else []
    texts = [
        f"{one.value - other.value:+z.2f}"
        for one, other in pairs
        if one and other and one.is_known and other.is_known
    ]
    return " / ".join(texts)


def _worst(reached: Value | None) -> str:
    """Return collision / completion in the worst held-out variation, and its name; empty without one."""
    if reached is None or math.isnan(reached.terms["held_out_completion"]):
        return ""
    if not reached.is_known:
        return reached.text
    collision = round(1.0 - reached.terms["held_out_non_collision"], 12)  # a share of whole numbers again
    completion = reached.terms["held_out_completion"]
    return f"{collision:z.2f} / {completion:z.2f} {reached.worst.partition('@')[2]}"
