"""Hand-overs: each happens wholly or not at all, and leaves pose and speed as they are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smarts.sim.ownership import Ownership
from smarts.types.agent_states import AgentStatus
from smarts.types.transfers import Reason, Refusal, Transfer
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World

NOBODY, TRAFFIC, AGENT = Owner.NOBODY, Owner.TRAFFIC, Owner.AGENT
ALL = np.ones(1, np.bool_)


class Fussy:
    """A provider that accepts only some slots."""

    def __init__(self, slots=range(99)):
        self.slots = slots

    def can_accept(self, rows, slots):
        return np.where(np.isin(slots, [*self.slots]), Refusal.NONE, Refusal.KIND)


class Keeping(Fussy):
    """A traffic engine that keeps some of its vehicles."""

    kept: tuple[int, ...] = (1,)

    def can_release(self, rows, slots):
        return np.where(np.isin(slots, [*self.kept]), Refusal.IN_JUNCTION, Refusal.NONE)


class Case:
    """One simulation with social vehicles in the slots from 0 on."""

    def __init__(self, cars=3, agents=3, worlds=1, traffic=None):
        self.world = World(worlds=worlds, capacity=8, agents=agents, lanes=1)
        self.ownership = Ownership(self.world, {TRAFFIC: traffic or Fussy(), AGENT: Fussy()})
        for row in range(worlds):
            for slot in range(cars):
                self.world.registry.admit(row, "car", TRAFFIC, VehicleKind.PASSENGER, 5.0, 1.8)
                self.world.vehicles.position[row, slot] = slot, slot + 0.5
                self.world.vehicles.speed[row, slot] = slot + 1
                self.world.vehicles.route[row, slot] = 7

    def submit(self, *rows):
        self.ownership.submit([Transfer(*row) for row in rows])

    def apply(self, *rows, mask=ALL):
        """Return how many were refused."""
        self.submit(*rows)
        return len(self.ownership.apply(mask))

    def holder(self, slot, row=0):
        """Return owner, agent and the agent's state of a slot."""
        agent_id = np.flatnonzero(self.world.agents.slot[row] == slot)
        state = AgentStatus(self.world.agents.state[row, agent_id[0]]).name if len(agent_id) else None
        return int(self.world.vehicles.owner[row, slot]), (int(agent_id[0]) if len(agent_id) else -1), state


def take(slot, agent_id, generation=1, row=0):
    return (row, slot, generation, TRAFFIC, -1, AGENT, agent_id, Reason.TAKE)


def release(slot, agent_id, generation=1):
    return (0, slot, generation, AGENT, agent_id, TRAFFIC, -1, Reason.RELEASE)


def leave(slot, agent_id, generation=1, owner=AGENT):
    return (0, slot, generation, owner, agent_id, NOBODY, -1, Reason.LEAVE)


def test_there_and_back_moves_nothing():
    case = Case()
    moved = [case.world.vehicles.position.copy(), case.world.vehicles.speed.copy()]
    assert case.apply(take(1, 0)) == 0
    assert case.holder(1) == (AGENT, 0, "ACTIVE")
    assert case.apply(release(1, 0)) == 0
    assert case.holder(1) == (TRAFFIC, -1, None)
    assert case.world.agents.state[0, 0] == AgentStatus.VACANT
    assert (case.world.vehicles.position == moved[0]).all()
    assert (case.world.vehicles.speed == moved[1]).all()
    assert case.world.vehicles.generation[0, 1] == 1
    assert case.world.vehicles.route[0, 1] == -1  # whoever drives now has plans of its own


def test_two_traps_for_one_vehicle_catch_it_once():
    case = Case()
    assert case.apply(take(1, 2), take(1, 0)) == 1
    assert case.holder(1) == (AGENT, 0, "ACTIVE")
    assert case.world.agents.slot[0, 2] == -1


def test_leaving_goes_before_release():
    case = Case()
    case.apply(take(1, 0))
    assert case.apply(release(1, 0), leave(1, 0)) == 1
    assert not case.world.vehicles.alive[0, 1]


def test_an_agent_that_is_freed_can_be_taken_in_the_same_step():
    case = Case()
    case.apply(take(1, 0))
    assert case.apply(take(2, 0), release(1, 0)) == 0
    assert case.holder(2) == (AGENT, 0, "ACTIVE")
    assert case.holder(1) == (TRAFFIC, -1, None)


@pytest.mark.parametrize(
    "transfer",
    [
        take(1, 0, generation=2),
        take(5, 0),
        (0, 1, 1, AGENT, -1, TRAFFIC, -1, Reason.RELEASE),
        (0, 1, 1, TRAFFIC, 2, AGENT, 2, Reason.TAKE),
        (0, 1, 1, TRAFFIC, -1, AGENT, -1, Reason.TAKE),
    ],
    ids=["another generation", "nobody there", "another owner", "another agent", "an agent without an agent"],
)
def test_what_is_not_as_the_proposer_saw_it_is_refused(transfer):
    case = Case()
    before = [column.copy() for column in case.world.vehicles]
    assert case.apply(transfer) == 1
    for old, new in zip(before, case.world.vehicles, strict=True):
        assert np.array_equal(old, new, equal_nan=True)


def test_a_provider_that_cannot_drive_on_is_not_made_to():
    case = Case(traffic=Fussy(slots=[0]))
    case.apply(take(0, 0), take(1, 1))
    assert case.apply(release(0, 0), release(1, 1)) == 1
    assert case.holder(0) == (TRAFFIC, -1, None)
    assert case.holder(1) == (AGENT, 1, "ACTIVE")


def test_a_simulation_that_pauses_keeps_what_is_pending():
    case = Case(worlds=2)
    case.submit(take(1, 0, row=0), take(1, 0, row=1))
    assert case.apply(mask=np.array([True, False])) == 0
    assert case.holder(1, row=1) == (TRAFFIC, -1, None)
    case.apply(mask=np.array([False, True]))
    assert case.holder(1, row=1) == (AGENT, 0, "ACTIVE")


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.lists(
            st.tuples(
                st.just(0),
                st.integers(0, 4),
                st.integers(1, 2),
                st.sampled_from([TRAFFIC, AGENT]),
                st.integers(-1, 2),
                st.sampled_from([NOBODY, TRAFFIC, AGENT]),
                st.integers(-1, 2),
                st.sampled_from(list(Reason)),
            ),
            max_size=6,
        ),
        max_size=6,
    )
)
def test_any_transfers_keep_what_is_always_true(steps):
    case = Case(cars=4)
    for proposed in steps:
        case.apply(*proposed)
        agents, vehicles = case.world.agents, case.world.vehicles
        held = agents.slot[0][agents.slot[0] >= 0]
        assert len(set(held.tolist())) == len(held)
        assert vehicles.alive[0, held].all()
        assert (vehicles.generation[0, held] == agents.generation[0][agents.slot[0] >= 0]).all()
        driven = np.flatnonzero(vehicles.owner[0] == AGENT)
        active = agents.slot[0][agents.state[0] == AgentStatus.ACTIVE]
        assert sorted(active.tolist()) == driven.tolist()


def test_a_vehicle_that_its_driver_keeps_is_taken_as_soon_as_it_is_given():
    engine = Keeping()
    case = Case(traffic=engine)
    slots = np.arange(3, dtype=np.int32)
    assert case.ownership.can_take(np.zeros_like(slots), slots).tolist() == [0, Refusal.IN_JUNCTION, 0]
    assert case.apply(take(0, 0), take(1, 1)) == 1
    assert (case.holder(0)[0], case.holder(1)[0]) == (AGENT, TRAFFIC)
    assert case.ownership.refused[0, Refusal.IN_JUNCTION] == 1
    assert case.apply(take(1, 1)) == 1
    assert case.ownership.unresolved(0) == [(1, 1, Reason.TAKE, 2, Refusal.IN_JUNCTION)]
    engine.kept = ()
    assert case.apply(take(1, 1)) == 0
    assert case.ownership.unresolved(0) == []
    assert case.holder(1)[0] == AGENT
