"""Identity: slots, generations and names."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smarts.errors import TrafficError
from smarts.sim.roster import Roster
from smarts.types.vehicles import Owner, VehicleKind, VehicleStates

CAR = (Owner.TRAFFIC, VehicleKind.PASSENGER, 5.0, 1.8)


def new_roster(capacity=8, reserved=2):
    return Roster(VehicleStates.allocate(capacity), reserved)


def test_arrivals_take_the_lowest_free_slot_behind_the_reserved():
    roster = new_roster()
    assert [roster.admit(name, *CAR) for name in "abc"] == [2, 3, 4]
    roster.dismiss(3)
    assert roster.admit("d", *CAR) == 3
    assert [roster.name(slot) for slot in range(6)] == ["", "", "a", "d", "c", ""]


def test_egos_take_the_slot_that_they_name():
    roster = new_roster()
    assert roster.admit("ego", Owner.AGENT, VehicleKind.BUS, 12.0, 2.5, slot=1) == 1
    states = roster.states
    assert (states.owner[1], states.kind[1], states.length[1], states.width[1]) == (
        Owner.AGENT,
        VehicleKind.BUS,
        12.0,
        2.5,
    )
    with pytest.raises(ValueError, match="slot 1 is taken by 'ego'"):
        roster.admit("other", *CAR, slot=1)


def test_a_slot_and_its_generation_name_one_vehicle():
    roster = new_roster()
    slots = []
    for _ in range(3):
        slot = roster.admit("a", *CAR)
        slots.append((slot, int(roster.states.generation[slot])))
        roster.dismiss(slot)
    assert slots == [(2, 1), (2, 2), (2, 3)]


def test_names_are_unique_in_an_episode():
    roster = new_roster()
    slots = [roster.admit("a", *CAR) for _ in range(3)]
    assert [roster.name(slot) for slot in slots] == ["a", "a~2", "a~3"]
    roster.dismiss(slots[0])
    assert roster.name(roster.admit("a", *CAR)) == "a~4"
    roster.reset()
    assert roster.name(roster.admit("a", *CAR)) == "a"


def test_dismissal_clears_the_row():
    roster = new_roster()
    empty = VehicleStates.allocate(8)
    slot = roster.admit("a", *CAR)
    for field in dataclasses.fields(VehicleStates):
        if field.name not in ("generation", "alive"):
            getattr(roster.states, field.name)[slot] = 1
    roster.dismiss(slot)
    for field in dataclasses.fields(VehicleStates):
        if field.name != "generation":
            assert (getattr(roster.states, field.name) == getattr(empty, field.name)).all(), field.name


def test_reset_is_a_new_world():
    roster = new_roster()
    for name in "abc":
        roster.admit(name, *CAR)
    roster.reset()
    empty = VehicleStates.allocate(8)
    for field in dataclasses.fields(VehicleStates):
        assert (getattr(roster.states, field.name) == getattr(empty, field.name)).all(), field.name


def test_a_full_world_is_a_named_error():
    roster = new_roster(capacity=3, reserved=1)
    for name in "ab":
        roster.admit(name, *CAR)
    with pytest.raises(TrafficError, match="all 3 slots of the world are taken"):
        roster.admit("c", *CAR)
    roster.admit("ego", *CAR, slot=0)


def test_more_reserved_than_there_are():
    with pytest.raises(ValueError, match="9 slots"):
        new_roster(reserved=9)


@given(st.lists(st.integers(0, 7), max_size=40))
def test_any_coming_and_going(moves):
    """A move names a slot: dismissed if it is taken, otherwise somebody arrives."""
    roster = new_roster(reserved=0)
    alive = set()
    for move in moves:
        if move in alive:
            roster.dismiss(move)
            alive.remove(move)
        else:
            slot = roster.admit("a", *CAR)
            assert slot == min(set(range(8)) - alive)
            alive.add(slot)
        assert set(np.flatnonzero(roster.states.alive).tolist()) == alive
