"""The leaderboard as a page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmark.metrics import METRICS
from benchmark.report.html import fill
from benchmark.report.leaderboard import Leaderboard, make_leaderboard
from benchmark.report.paper import task_label, traffic_label
from benchmark.report.ranking import RANKED_BY
from benchmark.report.wording import COMPARED
from benchmark.results.files import write_whole

Column = tuple[str, str, bool]
"""Title, meaning, whether it is left-aligned."""

PROTOCOL: Column = ("protocol", "Environment and budget; ranks hold within one only", True)
EXPERIMENT: Column = ("experiment", "Folder of its results", True)
PARADIGM: Column = ("paradigm", "What agents know in training and execution", True)
ALGORITHM: Column = ("algorithm", "Algorithm or scripted policy", True)
STATUS: Column = (
    "evaluated",
    "Of a release or a submission: the worst of its seeds; fewer than three have no rank",
    True,
)
SUBMITTED_COLUMNS: list[Column] = [
    ("submission", "Name and author", True),
    ALGORITHM,
    ("cell", "Task and traffic", True),
    ("seed", "Of training", False),
    ("completion", "Completion rate: claimed / of the episodes played here", False),
    ("collision", "Collision rate: claimed / of the episodes played here", False),
    ("digests", "Played episodes with the claimed digest, of those claimed", False),
    ("evaluated", "Confirmed, marked or refused", True),
    ("why", "Why it is marked or refused", True),
]


def write_leaderboard(roots: Sequence[Path], out: Path, mode: str) -> None:
    """Write the leaderboard of several experiments.

    Raises:
        ResultsError: One is not there or given twice, or the page cannot be written.
    """
    page = leaderboard_page(make_leaderboard(roots, mode))
    write_whole(out, lambda file: file.write_text(page, encoding="utf-8"))


def leaderboard_page(board: Leaderboard) -> str:
    """Return a leaderboard as an HTML page."""
    submitted, has_status = board.submitted, any(place.status for place in board.places)
    several = [PROTOCOL] if len(board.protocols) > 1 else []
    rates, own = _columns(RANKED_BY), _columns(board.own_metrics)
    means = _columns(RANKED_BY, "Interquartile mean of: ")
    columns: list[Column] = [
        ("cell", "Task and traffic", True),
        *several,
        ("rank", "In the cell, among the same protocol", False),
        *(ALGORITHM, EXPERIMENT, PARADIGM),
        *rates,
        *own,
        ("seeds", "Number of training seeds", False),
        ("episodes", "Of the test, all seeds together", False),
        *([STATUS] if has_status else []),
    ]
    summary_columns: list[Column] = [
        *(ALGORITHM, *several, EXPERIMENT, PARADIGM),
        *means,
        ("cells", "Number of cells", False),
    ]
    places = board.places
    return fill(
        "leaderboard.html.j2",
        mode=board.mode,
        compared=COMPARED,
        problems=board.problems,
        protocols=list(board.protocols.items()),
        places=places,
        summaries=board.summaries,
        columns=columns,
        summary_columns=summary_columns,
        letters=[(letter, letter) for letter in board.protocols],
        tasks=[(name, task_label(name)) for name in dict.fromkeys(each.task for each in places)],
        traffics=[(name, traffic_label(name)) for name in dict.fromkeys(each.traffic for each in places)],
        paradigms=[(name, name) for name in sorted({each.paradigm for each in places})],
        submitted=submitted,
        has_status=has_status,
        submitted_columns=SUBMITTED_COLUMNS,
        metrics=[METRICS[name] for name in (*RANKED_BY, *board.own_metrics)],
    )


def _columns(metrics: Iterable[str], before: str = "") -> list[Column]:
    """Return the columns of metrics; `before` begins their meaning."""
    return [(METRICS[name].label, before + METRICS[name].meaning, False) for name in metrics]
