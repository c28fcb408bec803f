"""Vehicles of traffic that social agents take and give back."""

import numpy as np
import pytest

from smarts.types.agent_states import AgentStatus
from smarts.types.episode import AgentStart
from smarts.types.mission import AgentMission
from smarts.types.transfers import Reason, Transfer
from smarts.types.vehicles import Owner
from tests.unit.env.social_stage import LANER, SOCIAL, Answers, keep, trap


def taking(played, slot, name="social"):
    """Announce an agent without a mission; return the transfer of a traffic vehicle to it."""
    generation = int(played.world.vehicles.generation[0, slot])
    pose = (*played.world.vehicles.position[0, slot].tolist(), float(played.world.vehicles.heading[0, slot]))
    start = AgentStart(
        name, pose, float(played.world.vehicles.speed[0, slot]), AgentMission(), interface=0, policy=0
    )
    number = played.parts.pool.announce(0, start)
    return Transfer(0, slot, generation, Owner.TRAFFIC, -1, Owner.AGENT, -1, Reason.TAKE, number)


def jumps(played, slot):
    """Return how far a vehicle is from where its speed would have taken it, and the change of speed."""
    now, before = played.world.vehicles, played.world.before
    moved = float(np.hypot(*(now.position[0, slot] - before.position[0, slot])))
    return abs(moved - float(before.speed[0, slot]) * 0.1), float(
        abs(now.speed[0, slot] - before.speed[0, slot])
    )


@pytest.mark.parametrize("model", ["bullet", pytest.param("kinematic", marks=pytest.mark.nightly)])
def test_a_vehicle_goes_from_traffic_to_a_social_agent_and_back(play, model):
    played = play(
        keep,
        trap(),
        social=LANER.replace(vehicle_model=model, max_episode_steps=25),
    )
    played.reset()
    world, slot, generation, held = played.world, -1, -1, 0
    for _ in range(120):
        played.step()
        if slot < 0 and played.slot >= 0:
            slot = played.slot
            generation = int(world.vehicles.generation[0, slot])
            assert world.before.owner[0, slot] == Owner.TRAFFIC
        if slot >= 0:
            assert world.vehicles.generation[0, slot] == generation
            assert world.vehicles.alive[0, slot]
            apart, change = jumps(played, slot)
            assert apart < 0.1
            assert change < 0.95
            held += world.vehicles.owner[0, slot] == Owner.AGENT
            if world.before.owner[0, slot] == Owner.AGENT and world.vehicles.owner[0, slot] == Owner.TRAFFIC:
                break
    else:
        pytest.fail("the vehicle did not go back")
    assert held >= 1 + 25, "the step of the hand-over, those of the episode, and until the gate opens"
    for _ in range(20):
        played.step()
        if not world.vehicles.alive[0, slot] or world.vehicles.generation[0, slot] != generation:
            break
        assert jumps(played, slot)[0] < 0.1
        assert world.vehicles.owner[0, slot] == Owner.TRAFFIC


def test_a_spare_agent_takes_a_vehicle_that_a_transfer_gives_it(play):
    """As bubbles will do it: without a start, without a mission, by a transfer at the border of two steps."""
    played = play(keep)
    played.reset()
    world, ownership = played.world, played.parts.ownership
    driven = np.flatnonzero(world.vehicles.owner[0] == Owner.TRAFFIC)
    slot = int(driven[world.vehicles.speed[0, driven].argmax()])
    generation = int(world.vehicles.generation[0, slot])
    ownership.submit([taking(played, slot)])
    for _ in range(10):
        played.step()
        assert world.vehicles.owner[0, slot] == Owner.AGENT
        assert played.slot == slot
        apart, change = jumps(played, slot)
        assert apart < 0.1
        assert change < 0.95
    release = Transfer(0, slot, generation, Owner.AGENT, SOCIAL, Owner.TRAFFIC, -1, Reason.RELEASE)
    ownership.submit([release])
    for _ in range(10):
        played.step()
        assert world.vehicles.owner[0, slot] == Owner.TRAFFIC
        assert jumps(played, slot)[0] < 0.1
    assert world.agents.state[0, SOCIAL] == AgentStatus.VACANT


def test_an_agent_is_asked_in_the_step_in_which_it_enters_whoever_had_its_column(play):
    """Two agents in one column, the second in the step in which the first goes; the first decides seldom."""
    answers = Answers()
    played = play(answers)
    played.reset()
    world, ownership = played.world, played.parts.ownership
    first, second = np.flatnonzero(world.vehicles.owner[0] == Owner.TRAFFIC)[:2].tolist()
    ownership.submit([taking(played, first)])
    played.step()
    world.agents.period[0, SOCIAL] = 50
    world.agents.next_due[0, SOCIAL] = 51
    played.step(5)
    generation = int(world.vehicles.generation[0, first])
    leave = Transfer(0, first, generation, Owner.AGENT, SOCIAL, Owner.NOBODY, -1, Reason.LEAVE)
    ownership.submit([taking(played, second), leave])
    played.step()
    assert played.slot == second
    asked = [(int(request.batch.step[0]), bool(request.batch.is_first[0])) for _, request in answers.asked]
    assert asked == [(1, True), (7, True)]
    assert len({int(request.batch.hold[0]) for _, request in answers.asked}) == 2
