"""A condition against the paper's, in four words, from the uncertainties of both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from benchmark.report.paper import Printed, paper
from benchmark.report.values import Value
from benchmark.statistics import mover_interval, wilson_interval

WORSE, UNDECIDED, NON_INFERIOR, BETTER = "worse", "undecided", "non-inferior", "better"
WORDS = (WORSE, UNDECIDED, NON_INFERIOR, BETTER)
"""Verdicts from the weakest to the strongest."""
PASSES = (NON_INFERIOR, BETTER)
ONE_SIDED = 0.90
"""Level of the interval whose ends are one-sided 95% ends."""
DEGENERATE = ("random", "keep_lane", "parked")
"""Scripted policies that do not drive to win: a paper's condition that one of them passes does not count."""


@dataclass(frozen=True)
class Gap:
    """One figure's difference to the paper's, ours minus theirs."""

    name: str
    """"collision" or "completion"."""
    value: float
    low: float
    """Lower end of the two-sided 95% interval, as `high` is the upper one."""
    high: float
    gain: float
    """Pessimistic end, one-sided 95%, of how much better ours is."""
    word: str


@dataclass(frozen=True)
class Comparison:
    """A condition against one that the paper prints."""

    gaps: tuple[Gap, Gap]

    @property
    def word(self) -> str:
        """The weaker of the two figures' words."""
        return min((gap.word for gap in self.gaps), key=WORDS.index)


Figures = tuple[Value, Value]
"""Collision and completion rate."""
BothLevels = tuple[Figures, Figures]
"""Figures with 95% intervals, and with intervals of the level `ONE_SIDED`."""


def compare_with(theirs: Sequence[Printed], ours: Figures, one_sided: Figures) -> Comparison | None:
    """Return the comparison with the printed variant of a condition that gives the weakest word.

    Args:
        theirs: What the paper prints; its two tables differ in places.
        ours: The two rates with 95% intervals.
        one_sided: The same with intervals of level `ONE_SIDED`.

    Returns:
        None where the paper prints nothing, or where ours have no interval.
    """
    if not theirs or not all(value.has_interval for value in (*ours, *one_sided)):
        return None
    found = [
        Comparison(
            (
                _gap("collision", ours[0], one_sided[0], each.collision, is_gain=False),
                _gap("completion", ours[1], one_sided[1], each.completion, is_gain=True),
            )
        )
        for each in theirs
    ]
    return min(found, key=lambda each: WORDS.index(each.word))


def _gap(name: str, ours: Value, one_sided: Value, theirs: float, *, is_gain: bool) -> Gap:
    low, high = _difference(ours, theirs, 0.95)
    ends = _difference(one_sided, theirs, ONE_SIDED)
    gain = ends[0] if is_gain else -ends[1]
    better, worse = (low > 0.0, high < 0.0) if is_gain else (high < 0.0, low > 0.0)
    if better:
        word = BETTER
    elif gain >= -paper()["margin"]:
        word = NON_INFERIOR
    else:
        word = WORSE if worse else UNDECIDED
    return Gap(name, ours.value - theirs, low, high, gain, word)


def _difference(ours: Value, theirs: float, level: float) -> tuple[float, float]:
    low, high = wilson_interval(theirs, paper()["agent_episodes"] / paper()["design_effect"], level)
    ends = mover_interval(ours.value, (ours.low, ours.high), theirs, (float(low), float(high)))
    return float(ends[0]), float(ends[1])


def degenerate_passes(
    theirs: Sequence[Printed], figures: Callable[[str], BothLevels | None]
) -> dict[str, bool | None]:
    """Return for each degenerate driver whether it passes a condition of the paper; None if not known.

    Args:
        theirs: What the paper prints.
        figures: Returns a driver's two rates, None if its test in the condition is not finished.
    """
    found: dict[str, bool | None] = {}
    for driver in DEGENERATE if theirs else ():
        rates = figures(driver)
        comparison = compare_with(theirs, *rates) if rates else None
        found[driver] = comparison.word in PASSES if comparison else None
    return found
