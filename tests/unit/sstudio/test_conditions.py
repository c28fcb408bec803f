import itertools

import pytest

from smarts.sstudio import types as t
from smarts.sstudio.sstypes.condition import ALWAYS

TRUE, FALSE = t.ConditionState.TRUE, t.ConditionState.FALSE
BEFORE, EXPIRED = t.ConditionState.BEFORE, t.ConditionState.EXPIRED
STATES = (TRUE, FALSE, BEFORE, EXPIRED)


def literal(state):
    return t.LiteralCondition(state)


def test_a_window():
    window = t.TimeWindowCondition(2, 5)
    assert [window.evaluate(time=time) for time in (1, 2, 4.9, 5, 9)] == [
        BEFORE,
        TRUE,
        TRUE,
        EXPIRED,
        EXPIRED,
    ]
    assert t.TimeWindowCondition(2, t.MAX).evaluate(time=0) == TRUE


def test_a_dependee():
    assert t.DependeeActorCondition("leader").evaluate(actor_ids={"leader", "other"}) == TRUE
    assert t.DependeeActorCondition("leader").evaluate(actor_ids=()) == FALSE


def test_negation_forgets_times():
    assert [literal(state).negation().evaluate() for state in STATES] == [FALSE, TRUE, TRUE, TRUE]
    assert (-literal(BEFORE).negation()).evaluate() == FALSE


def test_conjunction_takes_the_worst():
    for one, other in itertools.product(STATES, repeat=2):
        worst = next(state for state in (EXPIRED, BEFORE, FALSE, TRUE) if state in (one, other))
        assert (literal(one) & literal(other)).evaluate() == worst


def test_disjunction():
    for one, other in itertools.product(STATES, repeat=2):
        if one == other == EXPIRED:
            expected = EXPIRED
        else:
            expected = next((state for state in (TRUE, BEFORE) if state in (one, other)), FALSE)
        assert (literal(one) | literal(other)).evaluate() == expected


def test_implication():
    for one, other in itertools.product(STATES, repeat=2):
        expected = TRUE if other == TRUE or one != TRUE else FALSE
        assert literal(one).implication(literal(other)).evaluate() == expected


def test_speeds_in_order():
    with pytest.raises(ValueError, match="5"):
        t.VehicleSpeedCondition(5, 4)


class TestTriggers:
    def test_holds_for_good_once_met(self):
        trigger = t.TimeWindowCondition(2, 5).trigger(delay_seconds=0)
        assert [trigger.evaluate(time=time) for time in (1, 4, 90)] == [BEFORE, TRUE, TRUE]

    def test_waits_for_the_delay(self):
        trigger = t.TimeWindowCondition(4, 10).trigger(10)
        assert [trigger.evaluate(time=time) for time in (2, 5, 14, 15, 16)] == [
            BEFORE,
            BEFORE,
            BEFORE,
            TRUE,
            TRUE,
        ]

    def test_persistence_needs_the_inner_condition_as_well(self):
        trigger = t.TimeWindowCondition(4, 10).trigger(4, persistent=True)
        assert [bool(trigger.evaluate(time=time)) for time in (5, 9, 15)] == [False, True, False]

    def test_what_expired_unmet_never_triggers(self):
        assert t.TimeWindowCondition(2, 5).trigger(0).evaluate(time=7) == EXPIRED

    def test_expiry(self):
        expiring = ALWAYS.expire(20)
        assert [expiring.evaluate(time=time) for time in (10, 20, 30)] == [TRUE, EXPIRED, EXPIRED]

    def test_relative_expiry_counts_from_the_first_evaluation(self):
        expiring = ALWAYS.expire(10, expired_state=FALSE, relative=True)
        assert [expiring.evaluate(time=time) for time in (3, 10, 12.9, 13)] == [TRUE, TRUE, TRUE, FALSE]

    def test_simulations_with_memories_of_their_own_do_not_mix(self):
        trigger = (t.TimeWindowCondition(2, 5) & ALWAYS).trigger(1)
        memories = [{}, {}]
        assert trigger.evaluate(time=2, memory=memories[0]) == BEFORE
        assert trigger.evaluate(time=3, memory=memories[0]) == TRUE
        assert trigger.evaluate(time=4, memory=memories[1]) == BEFORE
        assert trigger.evaluate(time=1) == BEFORE
        assert memories == [{trigger: 2}, {trigger: 4}]


def test_requirements_add_up():
    required = t.ConditionRequires
    condition = t.TimeWindowCondition(0, 1) & t.DependeeActorCondition("a")
    assert condition.requires == required.time | required.actor_ids
    assert ALWAYS.requires == required.none
    assert t.OffRoadCondition().negation().requires == required.current_actor_road_status
    assert t.VehicleSpeedCondition(0, 1).trigger(1).requires == required.time | required.current_actor_state
