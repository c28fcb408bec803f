"""Identity: slots, generations and names."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from smarts.errors import TrafficError
from smarts.types.vehicle_registry import VehicleRegistry
from smarts.types.vehicles import Owner, VehicleKind, VehicleStates
from tests.raising import raises

CAR = (Owner.TRAFFIC, VehicleKind.PASSENGER, 5.0, 1.8)


def new_registry(capacity=8):
    return VehicleRegistry(VehicleStates.allocate(1, capacity))


def test_names_are_unique_in_an_episode():
    registry = new_registry()
    slots = [registry.admit(0, "a", *CAR) for _ in range(3)]
    assert [registry.name(0, slot) for slot in slots] == ["a", "a~2", "a~3"]
    registry.dismiss(0, slots[0])
    assert registry.name(0, registry.admit(0, "a", *CAR)) == "a~4"
    registry.reset(0)
    assert registry.name(0, registry.admit(0, "a", *CAR)) == "a"


def test_a_full_world_is_a_named_error():
    registry = new_registry(capacity=2)
    for name in "ab":
        registry.admit(0, name, *CAR)
    with raises(TrafficError, values=[2]):
        registry.admit(0, "c", *CAR)


@given(st.lists(st.integers(0, 7), max_size=40))
def test_any_coming_and_going(moves):
    """A move names a slot: dismissed if it is taken, otherwise somebody arrives."""
    registry = new_registry()
    alive = set()
    for move in moves:
        if move in alive:
            registry.dismiss(0, move)
            alive.remove(move)
        else:
            slot = registry.admit(0, "a", *CAR)
            assert slot == min(set(range(8)) - alive)
            alive.add(slot)
        assert set(np.flatnonzero(registry.states.alive[0]).tolist()) == alive


def test_vehicles_whose_slots_a_kernel_issues_are_named_by_slot_and_generation():
    registry = new_registry(3)
    registry.dismiss(0, registry.admit(0, "a", *CAR))
    registry.states.alive[0, :2] = True
    registry.states.generation[0, :2] += 1
    assert [registry.name(0, slot) for slot in range(3)] == ["vehicle-0-2", "vehicle-1-1", ""]
    assert [registry.slot(0, name) for name in ("vehicle-0-2", "vehicle-1-1", "vehicle-0-1", "a")] == [
        0,
        1,
        -1,
        -1,
    ]
