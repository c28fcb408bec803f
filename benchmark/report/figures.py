"""The pictures beside report.md: one SVG file a kind of plot, of all conditions, drawn as the page's."""

from __future__ import annotations

from dataclasses import dataclass

from benchmark.report.content import Report
from benchmark.report.paper import task_label, traffic_label
from benchmark.report.wording import MODE_NOTES

SHORT_TRAFFIC = {"no_social_vehicles": "No SV", "random_social_vehicles": "SV"}


@dataclass(frozen=True)
class Kind:
    """A kind of plot."""

    name: str
    """Name of the plot's file."""
    title: str
    note: str
    """What one has to know to read it; {}: which episodes are shown."""
    size: tuple[int, int]
    """Width and height of a condition's plot; bars add theirs."""


KINDS = (
    Kind(
        "radar",
        "Behaviour",
        "{} All scales go from 0 to 1 in every plot; a gap is a metric with nothing to measure. Diversity "
        "describes, more of it is not better.",
        (340, 310),
    ),
    Kind(
        "radar_all",
        "All indices",
        "As above, with all of the paper's metrics; of rates that are better when lower, 1 minus the value. "
        "Diversity, stochasticity and cut-ins describe or have few cases: look at the counts in the table.",
        (420, 330),
    ),
    Kind(
        "learning_curves",
        "Learning curves",
        "Line: mean over training seeds of the last training episodes, which explore, as far as all seeds "
        "are there; thin lines: each seed. Band: from the lowest seed to the highest. Dots: greedy "
        "validation episodes of each seed.",
        (340, 620),
    ),
    Kind("outcomes", "Outcomes", "{} Each agent-episode has one outcome; shares add up to 1.", (400, 60)),
)
PROFILE = Kind(
    "performance_profile",
    "Performance profile",
    "Share of training seeds and conditions with a completion rate above a threshold; band: 95%, pointwise, "
    "of 500 resamples.",
    (560, 330),
)


def note_of(kind: Kind, report: Report) -> str:
    """Return what one has to know to read a kind of plot."""
    return kind.note.format(MODE_NOTES[report.modes[0]])


def cell_title(task: str, traffic: str) -> str:
    """Return the name of a condition as the paper's plots have it."""
    return f"{task_label(task)}: {SHORT_TRAFFIC.get(traffic, traffic_label(traffic))}"
