"""Whole simulations: a row of a batch equals the same run alone, failures stay with their row."""

import dataclasses
import hashlib

import numpy as np
import pytest

from smarts.agents import AgentInterface, DoneCriteria
from smarts.agents.options import Waypoints
from smarts.errors import RecordError, ScenarioError, SmartsError, TrafficError
from smarts.providers.sumo_library import SumoLibrary
from smarts.sim.assembly import Options, assemble
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import AgentStatus
from smarts.types.episode import TakeOver
from smarts.types.events import Outcome
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner
from tests.raising import raises
from tests.unit.sim.hashed_run import HashedRun

EGOS = 2


@pytest.fixture(scope="module")
def scenarios():
    return [build_scenario(name) for name in ("intersection", "double_merge", "roundabout", "loop")]


def interface(model="kinematic", **changes):
    return AgentInterface(
        max_episode_steps=80,
        waypoint_paths=Waypoints(lookahead=20),
        neighborhood_vehicle_states=True,
        action=ActionSpaceType.Lane,
        vehicle_model=model,
        done_criteria=DoneCriteria(**changes),
    )


class LaneRun(HashedRun):
    """Egos that choose lane actions by world, agent and step."""

    def act(self, actions, row):
        step = int(self.world.step[row])
        actions.given[row] = step > 0
        actions.fresh[row] = step % 5 == 1
        if step % 5 == 1:
            actions.action_mask[row] = self.world.agents.action_mask[row]
            chosen = [(step // 10 + self.worlds[row] + agent_id) % 4 for agent_id in range(EGOS)]
            actions.values[row, :, 0] = chosen


def digests(scenarios, worlds, model, steps):
    """Return the hashes of so many steps of each world, and its episodes; in a batch they rest in turn."""
    parts = assemble(scenarios, [interface(model)] * EGOS, worlds=len(worlds))
    run, number, made = LaneRun(parts, worlds), 0, np.zeros(len(worlds), int)
    while (made < steps).any():
        rests = number // 10 % (len(worlds) + 1)
        rows = (made < steps) & (np.arange(len(worlds)) != rests)
        run.step(rows)
        made, number = made + rows, number + 1
    return run.digests(), run.episodes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "steps"), [("bullet", 100), pytest.param("kinematic", 300, marks=pytest.mark.nightly)]
)
def test_a_row_of_a_batch_equals_the_same_run_alone(scenarios, model, steps):
    together, episodes = digests(scenarios, [0, 1, 2, 5], model, steps)
    assert min(episodes) > 1
    for place, world in ((2, 2), (3, 5)):
        alone, _ = digests(scenarios, [world], model, steps)
        assert alone[0] == together[place]
    assert len(set(together)) == 4


@pytest.mark.slow
def test_an_episode_does_not_depend_on_those_before(scenarios):
    parts = assemble(scenarios, [interface()] * EGOS)
    world = parts.simulation.world

    def play(episode):
        parts.simulation.reset({0: parts.schedule.start(0, episode)})
        hashed = hashlib.blake2b()
        for _ in range(40):
            parts.simulation.step(parts.actions, np.ones(1, np.bool_), np.ones((1, EGOS), np.bool_))
            for column in world.vehicles:
                hashed.update(column.tobytes())
        return hashed.hexdigest()

    try:
        first = play(3)
        played = [play(episode) for episode in range(4)]
        assert played[3] == first
        assert len(set(played)) == 4
    finally:
        parts.simulation.close()


class Failing:
    """A traffic engine that breaks at a given step of its first episode."""

    def __init__(self, engine, at):
        self._engine, self._left = engine, at
        self.closed = False

    def __getattr__(self, name):
        return getattr(self._engine, name)

    def step(self):
        self._left -= 1
        if self._left == 0:
            raise TrafficError("SUMO failed in mid-run", place="here")
        self._engine.step()

    def close(self):
        self.closed = True
        self._engine.close()


@pytest.fixture
def three(scenarios):
    parts = assemble(scenarios[:1], [interface()] * EGOS, worlds=3)
    parts.simulation.reset({row: parts.schedule.start(row, 0) for row in range(3)})
    yield parts
    parts.simulation.close()


def stepped(parts, rows):
    mask = np.isin(np.arange(3), rows)
    return parts.simulation.step(parts.actions, mask, np.ones((3, EGOS), np.bool_))


def test_steps_that_are_too_long_are_refused():
    with raises(SmartsError, "Options.dt", values=[0.25]):
        Options(dt=0.25)


def test_a_vehicle_that_fails_ends_its_own_episode_only(three):
    """In the middle of a step that the others make in full, with traffic."""
    vehicles, world = three.simulation._stages.vehicles, three.simulation.world
    assert not stepped(three, [0, 1, 2]).failures
    agents = world.agents.slot.shape[1]
    vehicles.fleet._bodies[agents : 2 * agents, 7] = np.nan
    frame = stepped(three, [0, 1, 2])
    assert [*frame.failures] == [1]
    assert "no longer finite" in str(frame.failures[1])
    assert frame.env_mask.tolist() == [True, False, True]
    assert frame.events.finished.tolist() == [False, True, False]
    assert (world.agents.outcome[1] == Outcome.INVALID).all()
    assert (world.agents.state[[0, 2]] == AgentStatus.ACTIVE).all()
    three.simulation.reset({1: three.schedule.start(1, 1)})
    for _ in range(3):
        assert not stepped(three, [0, 1, 2]).failures
    assert np.isfinite(world.vehicles.position).all()


def test_traffic_that_fails_ends_its_own_episode_only(three):
    traffic, world = three.simulation._stages.traffic, three.simulation.world
    broken = traffic._simulations[1] = Failing(traffic._simulations[1], at=3)
    for _ in range(2):
        assert not stepped(three, [0, 1, 2]).failures
    frame = stepped(three, [0, 1, 2])
    assert [*frame.failures] == [1]
    assert "SUMO failed in mid-run" in str(frame.failures[1])
    assert frame.env_mask.tolist() == [True, False, True]
    assert frame.events.finished.tolist() == [False, True, False]
    assert frame.events.truncated.tolist() == [[False] * 2, [True] * 2, [False] * 2]
    assert (world.agents.outcome[1] == Outcome.INVALID).all()
    assert (world.agents.state[1] == AgentStatus.DONE).all()
    assert (world.agents.state[[0, 2]] == AgentStatus.ACTIVE).all()
    frame = stepped(three, [0, 2])
    assert not frame.failures
    three.simulation.reset({1: three.schedule.start(1, 1)})
    assert broken.closed
    assert traffic._simulations[1] is not broken
    for _ in range(5):
        assert not stepped(three, [0, 1, 2]).failures
    assert world.step.tolist() == [9, 5, 9]


def test_traffic_is_told_of_egos_before_the_first_step(three):
    """Their shadows are on the net when the episode begins, so that drivers mind them at once."""
    world = three.simulation.world
    for row in range(3):
        start = three.schedule.start(row, 0)
        engine = three.simulation._stages.traffic._simulations[row]
        for slot in np.flatnonzero(world.vehicles.owner[row] == Owner.AGENT).tolist():
            if start.traffic.warm_up:
                assert engine.can_accept(slot) != Refusal.OFF_LANES
                agent_id = int(np.flatnonzero(world.agents.slot[row] == slot)[0])
                assert engine._shadows._shadows[slot].route == start.agents[agent_id].mission.route
    assert any(three.schedule.start(row, 0).traffic.warm_up for row in range(3))


def test_more_egos_than_missions_are_refused(scenarios):
    with raises(ScenarioError, "ego_missions", values=[5]):
        assemble(scenarios, [interface()] * 5)


def test_what_was_begun_is_given_back_when_assembly_fails(scenarios, tmp_path):
    (tmp_path / "file").write_text("no folder")
    before = lowest_free_copy()
    with pytest.raises(RecordError):
        assemble(scenarios[:1], [interface()], worlds=3, options=Options(record=tmp_path / "file"))
    assert lowest_free_copy() == before


def lowest_free_copy():
    """Return the number of the next copy of libsumo that is given out."""
    library = SumoLibrary()
    try:
        return library.index
    finally:
        library.close()


def waiting_for_traffic(parts, world, **rule):
    """Return an episode with traffic in which the first agent takes over a vehicle instead of a new one."""
    starts = (parts.schedule.start(world, episode) for episode in range(20))
    start = next(start for start in starts if start.traffic.warm_up)
    first = dataclasses.replace(start.agents[0], take_over=TakeOver(**rule))
    return dataclasses.replace(start, agents=(first, *start.agents[1:]))


@pytest.mark.parametrize("model", ["bullet", pytest.param("kinematic", marks=pytest.mark.nightly)])
def test_vehicles_of_sumo_are_taken_over_without_a_jump_and_go_back(scenarios, model):
    parts = assemble(scenarios[:1], [interface(model)] * EGOS)
    world, everybody = parts.simulation.world, np.ones((1, EGOS), np.bool_)
    try:
        parts.simulation.reset({0: waiting_for_traffic(parts, 0, patience=50.0)})
        assert world.agents.state[0].tolist() == [AgentStatus.WAITING, AgentStatus.ACTIVE]
        slot, before, name = -1, None, ""
        for step in range(150):
            frame = parts.simulation.step(parts.actions, np.ones(1, np.bool_), everybody)
            assert not frame.failures
            vehicles, now = world.vehicles, int(world.agents.slot[0, 0])
            if slot < 0 <= now:
                slot, name = now, parts.scene.world.registry.name(0, now)
                assert world.before.owner[0, slot] == Owner.TRAFFIC
            if slot >= 0 and now == slot:
                moved = np.hypot(*(vehicles.position[0, slot] - world.before.position[0, slot]))
                speed = world.before.speed[0, slot]
                assert moved == pytest.approx(speed * 0.1, abs=0.1)
                assert abs(vehicles.speed[0, slot] - speed) < 0.9
                turn = vehicles.heading[0, slot] - world.before.heading[0, slot]
                assert abs((turn + np.pi) % (2 * np.pi) - np.pi) < np.radians(4)
            if step == 20:
                world.agents.state[0, 0], world.agents.outcome[0, 0] = AgentStatus.DONE, Outcome.TIME_OUT
                frame.events.just_done[0, 0] = True
                stages = parts.simulation._stages
                transfers = stages.transfer_rules.propose(frame.events, np.ones(1, np.bool_))
                stages.ownership.submit(transfers)
            if step > 20 and before is None and world.vehicles.owner[0, slot] == Owner.TRAFFIC:
                before = world.vehicles.position[0, slot].copy()
        assert slot >= 0
        assert before is not None
        assert world.agents.slot[0, 0] == -1
        if world.vehicles.alive[0, slot]:
            assert parts.scene.world.registry.name(0, slot) == name
            assert np.hypot(*(world.vehicles.position[0, slot] - before)) > 5
    finally:
        parts.simulation.close()


def test_who_enters_later_is_made_known_to_traffic_and_gets_a_gap(three):
    world, traffic = three.simulation.world, three.simulation._stages.traffic
    start = three.schedule.start(1, 0)
    late = dataclasses.replace(start.agents[1], entry_time=1.0)
    three.simulation.reset({1: dataclasses.replace(start, agents=(start.agents[0], late))})
    for _ in range(10):
        stepped(three, [1])
    assert world.agents.state[1].tolist() == [AgentStatus.ACTIVE, AgentStatus.WAITING]
    for _ in range(3):
        frame = stepped(three, [1])
        assert not frame.events.just_done.any()
    slot = int(world.agents.slot[1, 1])
    assert world.agents.entry_step[1].tolist() == [0, 11]
    assert three.scene.world.registry.name(1, slot) == "agent-1"
    assert traffic._simulations[1]._shadows._shadows[slot].route == late.mission.route
    assert np.hypot(*(world.vehicles.position[1, slot] - late.pose[:2])) < 3.0
