"""Outcomes: which one of several events in a step an agent's episode has ended by."""

from __future__ import annotations

from smarts.geometry.compiling import kernel
from smarts.types.events import TRUNCATING, Event, Outcome

_BY_PRIORITY = (
    (Event.COLLISION, Outcome.COLLISION),
    (Event.OFF_ROAD, Outcome.OFF_ROAD),
    (Event.OFF_ROUTE, Outcome.OFF_ROUTE),
    (Event.MISSED_GOAL, Outcome.MISSED_GOAL),
    (Event.REACHED_GOAL, Outcome.GOAL),
    (Event.NOT_MOVING, Outcome.NOT_MOVING),
    (Event.REACHED_MAX_EPISODE_STEPS, Outcome.TIME_OUT),
    (Event.LEFT_BUBBLE, Outcome.LEFT_BUBBLE),
    (Event.WRONG_WAY, Outcome.OTHER_TERMINAL),
    (Event.ON_SHOULDER, Outcome.OTHER_TERMINAL),
    (Event.VIA_HIT, Outcome.OTHER_TERMINAL),
    (Event.LAP_COMPLETED, Outcome.OTHER_TERMINAL),
    (Event.AGENTS_ALIVE_DONE, Outcome.OTHER),
    (Event.INTEREST_DONE, Outcome.OTHER),
)
_TABLE = tuple((int(event), int(outcome)) for event, outcome in _BY_PRIORITY)
_TRUNCATING = tuple(int(outcome) for outcome in TRUNCATING)


@kernel
def outcome_of(bits: int) -> int:
    """Return the `Outcome` of an episode that ends by these `Event` bits, NONE if by none of them."""
    for event, outcome in _TABLE:
        if bits & event:
            return outcome
    return 0


@kernel
def is_truncating(outcome: int) -> bool:
    """Return whether the outcome truncates the episode; all others terminate it."""
    return outcome in _TRUNCATING
