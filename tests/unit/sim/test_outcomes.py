"""Outcomes: the table of priorities, written out once more from the definitions of the metrics."""

import itertools

import numpy as np

from smarts.sim.outcomes import is_truncating, outcome_of
from smarts.types.events import Event, Outcome

PRIORITY = [
    (Event.COLLISION, Outcome.COLLISION),
    (Event.OFF_ROAD, Outcome.OFF_ROAD),
    (Event.OFF_ROUTE, Outcome.OFF_ROUTE),
    (Event.MISSED_GOAL, Outcome.MISSED_GOAL),
    (Event.REACHED_GOAL, Outcome.GOAL),
    (Event.NOT_MOVING, Outcome.NOT_MOVING),
    (Event.REACHED_MAX_EPISODE_STEPS, Outcome.TIME_OUT),
    (Event.LEFT_BUBBLE, Outcome.LEFT_BUBBLE),
]
OTHERS = {
    Event.WRONG_WAY: Outcome.OTHER_TERMINAL,
    Event.ON_SHOULDER: Outcome.OTHER_TERMINAL,
    Event.AGENTS_ALIVE_DONE: Outcome.OTHER,
    Event.INTEREST_DONE: Outcome.OTHER,
}


def test_every_combination_takes_the_first():
    for events in itertools.product((False, True), repeat=len(PRIORITY)):
        held = [pair for pair, holds in zip(PRIORITY, events, strict=True) if holds]
        bits = sum(event for event, _ in held)
        for other in (Event.NONE, *OTHERS):
            expected = held[0][1] if held else OTHERS.get(other, Outcome.NONE)
            assert outcome_of(np.int32(bits | other)) == expected


def test_truncation():
    truncating = {outcome for outcome in Outcome if is_truncating(int(outcome))}
    assert truncating == {Outcome.TIME_OUT, Outcome.OTHER, Outcome.INVALID, Outcome.LEFT_BUBBLE}
