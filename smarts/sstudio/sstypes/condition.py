"""Conditions on the course of a simulation, which bubbles and entries wait for.

A condition is evaluated with the facts that it `requires`, by their names:

    (TimeWindowCondition(2, 5) & DependeeActorCondition("leader")).evaluate(time=3.0, actor_ids={"leader"})

Triggers remember when their inner condition was first met. A caller of several simulations passes a `memory`
for each; by default a trigger uses its own.
"""

from __future__ import annotations

import enum
import functools
import operator
import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator, MutableMapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from smarts.types.condition_state import ConditionState

Memory = MutableMapping["Condition", float]
"""Start of each trigger's clock [s]. Equal triggers share a clock."""


class ConditionOperator(enum.IntEnum):
    """Operators on two conditions."""

    CONJUNCTION = enum.auto()
    """Both hold."""
    DISJUNCTION = enum.auto()
    """At least one holds."""
    IMPLICATION = enum.auto()
    """The second holds if the first does."""


class ConditionRequires(enum.IntFlag):
    """The facts that a condition looks at; their names are the arguments of `evaluate`."""

    none = 0
    agent_id = enum.auto()
    mission = enum.auto()
    time = enum.auto()
    actor_ids = enum.auto()
    actor_states = enum.auto()
    road_map = enum.auto()
    simulation = enum.auto()
    current_actor_state = enum.auto()
    current_actor_road_status = enum.auto()
    any_simulation_state = time | actor_ids | actor_states | simulation
    any_current_actor_state = mission | current_actor_state | current_actor_road_status
    any_mission_state = agent_id | mission


@dataclass(frozen=True)
class Condition(ABC):
    """Something that holds or not, and combines with others by `&`, `|` and `-`."""

    _looks_at: ClassVar[ConditionRequires] = ConditionRequires.none
    """The facts that the condition itself looks at."""

    @abstractmethod
    def evaluate(self, *, memory: Memory | None = None, **facts: Any) -> ConditionState:
        """Return whether the condition holds now.

        Args:
            memory: What triggers have seen so far in this simulation.
            facts: The facts named by `requires`.
        """

    @property
    def requires(self) -> ConditionRequires:
        """The facts needed to evaluate the condition, those of its parts included."""
        parts = (part.requires for part in vars(self).values() if isinstance(part, Condition))
        return functools.reduce(operator.or_, parts, self._looks_at)

    def negation(self) -> NegatedCondition:
        """Return what holds exactly when this does not; that it is early or too late is lost."""
        return NegatedCondition(self)

    def conjunction(self, other: Condition) -> CompoundCondition:
        """Return the conjunction; if it is not true, the first of EXPIRED, BEFORE, FALSE that applies."""
        return CompoundCondition(self, other, operator=ConditionOperator.CONJUNCTION)

    def disjunction(self, other: Condition) -> CompoundCondition:
        """Return the disjunction; if it is not true, BEFORE if one may become true, EXPIRED if none can."""
        return CompoundCondition(self, other, operator=ConditionOperator.DISJUNCTION)

    def implication(self, other: Condition) -> CompoundCondition:
        """Return the implication `not self or other`."""
        return CompoundCondition(self, other, operator=ConditionOperator.IMPLICATION)

    def trigger(self, delay_seconds: float, persistent: bool = False) -> ConditionTrigger:
        """Return a condition that stays true from `delay_seconds` after this one was first met.

        Args:
            delay_seconds: How long after the first time [s].
            persistent: Whether this must hold then, too.
        """
        return ConditionTrigger(self, delay_seconds=delay_seconds, persistent=persistent)

    def expire(
        self, time: float, expired_state: ConditionState = ConditionState.EXPIRED, relative: bool = False
    ) -> ExpireTrigger:
        """Return a condition that is this until a time and `expired_state` afterwards.

        Args:
            time: The simulation time [s], or with `relative` the time since the first evaluation.
            expired_state: What it evaluates to afterwards.
            relative: Whether the clock starts with the first evaluation.
        """
        return ExpireTrigger(self, time=time, expired_state=expired_state, relative=relative)

    def __and__(self, other: Condition) -> CompoundCondition:
        return self.conjunction(other)

    def __or__(self, other: Condition) -> CompoundCondition:
        return self.disjunction(other)

    def __neg__(self) -> NegatedCondition:
        return self.negation()


@dataclass(frozen=True)
class SubjectCondition(Condition):
    """A condition on one road user."""

    _looks_at = ConditionRequires.current_actor_state


@dataclass(frozen=True)
class LiteralCondition(Condition):
    """Always the same."""

    literal: ConditionState
    """The result."""

    def evaluate(self, *, memory: Memory | None = None, **facts: Any) -> ConditionState:
        """Return the literal."""
        return self.literal


ALWAYS = LiteralCondition(ConditionState.TRUE)


@dataclass(frozen=True)
class TimeWindowCondition(Condition):
    """Holds from `start` until before `end`; then it has expired."""

    _looks_at = ConditionRequires.time
    start: float
    """[s]"""
    end: float
    """[s]; `sys.maxsize` makes it hold always."""

    def __post_init__(self) -> None:
        if not self.start <= self.end:
            raise ValueError(f"the time window ends at {self.end} s, before its start at {self.start} s")

    def evaluate(self, *, memory: Memory | None = None, **facts: Any) -> ConditionState:
        """Compare `time`."""
        time = facts["time"]
        if self.end == sys.maxsize:
            return ConditionState.TRUE
        if not _has_come(self.start, time):
            return ConditionState.BEFORE
        return ConditionState.EXPIRED if _has_come(self.end, time) else ConditionState.TRUE


@dataclass(frozen=True)
class DependeeActorCondition(Condition):
    """Holds while a road user is in the simulation."""

    _looks_at = ConditionRequires.actor_ids
    actor_id: str
    """The road user's name."""

    def evaluate(self, *, memory: Memory | None = None, **facts: Any) -> ConditionState:
        """Look the road user up in `actor_ids`."""
        return _truth(self.actor_id in facts["actor_ids"])


@dataclass(frozen=True)
class OffRoadCondition(SubjectCondition):
    """Holds while the subject is off the road; BEFORE where neither road nor its absence is known yet."""

    _looks_at = ConditionRequires.current_actor_road_status

    def evaluate(self, *, memory: Memory | None = None, **facts: Any) -> ConditionState:
        """Look at `current_actor_road_status`, which has `road` and `off_road`."""
        status = facts["current_actor_road_status"]
        if status.off_road:
            return ConditionState.TRUE
        return ConditionState.BEFORE if status.road is None else ConditionState.FALSE


@dataclass(frozen=True)
class VehicleTypeCondition(SubjectCondition):
    """Holds for subjects of one vehicle type."""

    vehicle_type: str
    """The type, such as "passenger"."""

    def evaluate(self, *, memory: Memory | None = None, **facts: Any) -> ConditionState:
        """Look at `current_actor_state.vehicle_config_type`."""
        return _truth(facts["current_actor_state"].vehicle_config_type == self.vehicle_type)


@dataclass(frozen=True)
class VehicleSpeedCondition(SubjectCondition):
    """Holds while the subject's speed is from `low` to `high`."""

    low: float
    """[m/s]"""
    high: float
    """[m/s]"""

    def __post_init__(self) -> None:
        if not self.low <= self.high:
            raise ValueError(f"no speed is from {self.low} to {self.high} m/s: low must not be above high")

    def evaluate(self, *, memory: Memory | None = None, **facts: Any) -> ConditionState:
        """Look at `current_actor_state.speed`."""
        return _truth(self.low <= facts["current_actor_state"].speed <= self.high)

    @classmethod
    def loitering(cls, abs_error: float = 0.01) -> VehicleSpeedCondition:
        """Return the condition that the subject stands, to within `abs_error` [m/s]."""
        return cls(low=-abs_error, high=abs_error)


def parts(condition: Condition) -> Iterator[Condition]:
    """Yield a condition and all conditions that it is made of."""
    yield condition
    for part in vars(condition).values():
        if isinstance(part, Condition):
            yield from parts(part)


def _truth(holds: bool) -> ConditionState:
    return ConditionState.TRUE if holds else ConditionState.FALSE


def _has_come(moment: float, time: float) -> bool:
    """Return whether it is `moment` [s] or later. Sums of steps in floats may be off in the last digits."""
    return time >= moment - 1e-9


@dataclass(frozen=True)
class NegatedCondition(Condition):
    """Holds when the inner condition does not."""

    inner_condition: Condition
    """The condition to negate."""

    def evaluate(self, *, memory: Memory | None = None, **facts: Any) -> ConditionState:
        """Turn the inner result round."""
        return _truth(not self.inner_condition.evaluate(memory=memory, **facts))


@dataclass(frozen=True)
class CompoundCondition(Condition):
    """Two conditions combined; see `conjunction`, `disjunction` and `implication`."""

    first_condition: Condition
    second_condition: Condition
    operator: ConditionOperator

    def evaluate(self, *, memory: Memory | None = None, **facts: Any) -> ConditionState:
        """Combine both results. The second is not looked at (its triggers stay idle) if the first decides."""
        first = self.first_condition.evaluate(memory=memory, **facts)
        decided = _DECIDED_BY_FIRST[self.operator](first)
        if decided is not None:
            return decided
        second = self.second_condition.evaluate(memory=memory, **facts)
        return _COMBINED[self.operator](first, second)


def _conjunction(first: ConditionState, second: ConditionState) -> ConditionState:
    if first and second:
        return ConditionState.TRUE
    worst = (state for state in (ConditionState.EXPIRED, ConditionState.BEFORE) if state in first | second)
    return next(worst, ConditionState.FALSE)


def _disjunction(first: ConditionState, second: ConditionState) -> ConditionState:
    best = (state for state in (ConditionState.TRUE, ConditionState.BEFORE) if state in first | second)
    return next(best, first & second & ConditionState.EXPIRED)


_COMBINED = {
    ConditionOperator.CONJUNCTION: _conjunction,
    ConditionOperator.DISJUNCTION: _disjunction,
    # A first condition that does not hold has decided already.
    ConditionOperator.IMPLICATION: lambda first, second: _truth(bool(second)),
}
_DECIDED_BY_FIRST = {
    ConditionOperator.CONJUNCTION: lambda first: first if ConditionState.EXPIRED in first else None,
    ConditionOperator.DISJUNCTION: lambda first: ConditionState.TRUE if first else None,
    ConditionOperator.IMPLICATION: lambda first: None if first else ConditionState.TRUE,
}


@dataclass(frozen=True)
class ExpireTrigger(Condition):
    """The inner condition until a time, then `expired_state`."""

    _looks_at = ConditionRequires.time
    inner_condition: Condition
    """The result until then."""
    time: float
    """Time of expiry [s]."""
    expired_state: ConditionState = ConditionState.EXPIRED
    """The result afterwards."""
    relative: bool = False
    """Whether the clock starts with the first evaluation."""
    own_memory: dict[Condition, float] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Used where `evaluate` gets no memory."""

    def evaluate(self, *, memory: Memory | None = None, **facts: Any) -> ConditionState:
        """Compare `time`."""
        elapsed = facts["time"]
        if self.relative:
            clocks = self.own_memory if memory is None else memory
            elapsed -= clocks.setdefault(self, elapsed)
        if _has_come(self.time, elapsed):
            return self.expired_state
        return self.inner_condition.evaluate(memory=memory, **facts)


@dataclass(frozen=True)
class ConditionTrigger(Condition):
    """Switches to `triggered_state` after the inner condition was met and a delay has passed."""

    _looks_at = ConditionRequires.time
    inner_condition: Condition
    """The condition that starts the clock."""
    delay_seconds: float
    """Delay after the inner condition was first met [s]."""
    untriggered_state: ConditionState = ConditionState.BEFORE
    """The result until then."""
    triggered_state: ConditionState = ConditionState.TRUE
    """The result afterwards."""
    persistent: bool = False
    """Whether the inner condition must hold afterwards, too."""
    own_memory: dict[Condition, float] = field(default_factory=dict, init=False, repr=False, compare=False)
    """Used where `evaluate` gets no memory."""

    def evaluate(self, *, memory: Memory | None = None, **facts: Any) -> ConditionState:
        """Start the clock when the inner condition is met, then wait for the delay.

        An inner condition that expires before it is met can never set the trigger off: EXPIRED.
        """
        time = facts["time"]
        clocks = self.own_memory if memory is None else memory
        if self not in clocks:
            inner = self.inner_condition.evaluate(memory=memory, **facts)
            if ConditionState.EXPIRED in inner:
                return ConditionState.EXPIRED
            if not inner:
                return self.untriggered_state
            clocks[self] = time
        if not _has_come(self.delay_seconds, time - clocks[self]):
            return self.untriggered_state
        if self.persistent:
            return self.triggered_state & self.inner_condition.evaluate(memory=memory, **facts)
        return self.triggered_state
