"""The pool: agents come and go, leave nothing behind, and change nothing while they are not there."""

import dataclasses
from contextlib import closing
from functools import partial

import numpy as np
import pytest

from smarts.agents import (
    AgentInterface,
    AgentsAliveDoneCriteria,
    DoneCriteria,
    PooledAgents,
    Waypoints,
)
from smarts.sim.assembly import Options, assemble
from smarts.sim.episode_files import RecordedEpisode, episodes_in
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.agent_states import UNSET
from smarts.types.episode import AgentStart, TakeOver
from smarts.types.events import Outcome
from smarts.types.mission import AgentMission
from smarts.types.transfers import Reason, Refusal, Transfer
from smarts.types.vehicles import Owner
from tests.worlds import Willing

LANER = AgentInterface(
    action=ActionSpaceType.Lane,
    vehicle_model="kinematic",
    waypoint_paths=Waypoints(lookahead=20),
    neighborhood_vehicle_states=True,
)
DRIVER = AgentInterface(action=ActionSpaceType.Continuous, signals=True, max_episode_steps=70)
BUS = LANER.replace(vehicle_class="bus", done_criteria=DoneCriteria(off_route=False), road_waypoints=True)


def assembled(egos=(LANER,), pool=(), *, traffic=None, **more):
    built = build_scenario("intersection")
    return assemble([built.with_traffic([traffic]) if traffic else built], egos, pool=pool, **more)


@pytest.fixture
def make(closing):
    def one(*arguments, **more):
        parts = assembled(*arguments, **more)
        return closing(parts, parts.simulation)

    return one


def first_start(parts, *, traffic, world=0):
    """Return an episode with traffic, or without."""
    starts = (parts.schedule.start(world, episode) for episode in range(30))
    return next(start for start in starts if bool(start.traffic.warm_up) == traffic)


def step(parts, rows=None):
    worlds, agents = parts.simulation.world.agents.slot.shape
    mask = np.ones(worlds, np.bool_) if rows is None else np.isin(np.arange(worlds), rows)
    frame = parts.simulation.step(parts.actions, mask, np.ones((worlds, agents), np.bool_))
    assert not frame.failures
    return frame


def announced(parts, row, slot, name="social", interface=0):
    """Announce an agent for a traffic vehicle; return the transfer that gives it the vehicle."""
    vehicles = parts.simulation.world.vehicles
    pose = (*vehicles.position[row, slot].tolist(), float(vehicles.heading[row, slot]))
    start = AgentStart(name, pose, float(vehicles.speed[row, slot]), AgentMission(), interface=interface)
    number = parts.pool.announce(row, start)
    owner, generation = int(vehicles.owner[row, slot]), int(vehicles.generation[row, slot])
    return Transfer(row, slot, generation, owner, UNSET, Owner.AGENT, UNSET, Reason.TAKE, number)


def released(parts, row, agent_id):
    """Return the transfer of an agent's vehicle to traffic."""
    agents = parts.simulation.world.agents
    slot, generation = int(agents.slot[row, agent_id]), int(agents.generation[row, agent_id])
    return Transfer(row, slot, generation, Owner.AGENT, agent_id, Owner.TRAFFIC, UNSET, Reason.RELEASE)


def open_gate(parts):
    """Let traffic take back every vehicle at once."""
    parts.ownership._drivers = {**parts.ownership._drivers, Owner.TRAFFIC: Willing()}


def driven_by_traffic(parts, row):
    return np.flatnonzero(parts.simulation.world.vehicles.owner[row] == Owner.TRAFFIC).tolist()


def free_to_take(parts, row):
    """Return the vehicles of traffic that an agent can take now."""
    slots = np.array(driven_by_traffic(parts, row), np.int32)
    return slots[parts.ownership.can_take(np.full_like(slots, row), slots) == Refusal.NONE].tolist()


# The layout of columns.


def test_columns_of_an_interface_are_contiguous_and_equal_interfaces_share_theirs(make):
    pool = [PooledAgents(LANER, 2), PooledAgents(BUS, 3), PooledAgents(LANER.replace(), 1)]
    parts = make([DRIVER, LANER], pool)
    assert parts.pool.interfaces == (LANER, BUS)
    assert parts.pool.interface_id.tolist() == [-1, -1, 0, 0, 0, 1, 1, 1]
    assert [parts.pool.columns(number) for number in range(2)] == [slice(2, 5), slice(5, 8)]
    assert parts.actions.kind[0].tolist() == [0, *[1] * 7]


# A full pool, names, columns.


def test_the_vehicle_stays_traffic_where_the_pool_is_full(make):
    parts = make(pool=[PooledAgents(LANER, 1), PooledAgents(BUS, 2)], worlds=2)
    parts.simulation.reset({row: first_start(parts, traffic=True, world=row) for row in range(2)})
    vehicles, pool = parts.simulation.world.vehicles, parts.pool
    first, second, third = free_to_take(parts, 1)[:3]
    ownership, taken = parts.ownership, announced(parts, 1, first)
    refused = announced(parts, 1, second)
    ownership.submit([announced(parts, 1, third, interface=1), refused, taken])
    step(parts)
    assert vehicles.owner[1, [first, second, third]].tolist() == [Owner.AGENT, Owner.TRAFFIC, Owner.AGENT]
    assert [pool.name(1, agent_id) for agent_id in range(4)] == ["agent-0", "social", "social~3", ""]
    open_gate(parts)
    ownership.submit([released(parts, 1, 1), refused])
    step(parts)
    assert vehicles.owner[1, [first, second]].tolist() == [Owner.TRAFFIC, Owner.AGENT]
    assert pool.name(1, 1) == "social~2"
    assert pool.column(1, 1) == UNSET
    assert pool.column(1, 2) == 1
    parts.simulation.reset({1: first_start(parts, traffic=True, world=1)})
    assert pool.name(1, 1) == ""


def test_agents_that_start_later_get_their_column_when_they_enter(make):
    """Two agents in turn in one column; a third waits until it is free."""
    short = LANER.replace(max_episode_steps=10, done_criteria=DoneCriteria(off_route=False))
    parts = make(pool=[PooledAgents(short, 1)])
    start, poses = first_start(parts, traffic=False), [second_pose(), second_pose(2)]
    others = [
        dataclasses.replace(start.agents[0], name=name, interface=0, pose=pose, entry_time=time)
        for name, pose, time in (("a", poses[0], 0.0), ("b", poses[0], 2.0), ("c", poses[1], 2.5))
    ]
    parts.simulation.reset({0: dataclasses.replace(start, agents=(*start.agents, *others))})
    world, seen = parts.simulation.world, []
    for _ in range(50):
        seen.append(parts.pool.name(0, 1) if world.agents.slot[0, 1] >= 0 else "")
        step(parts)
    runs = [name for name, before in zip(seen, [None, *seen], strict=False) if name != before]
    assert runs == ["a", "", "b", "c", ""]
    assert [seen.count(name) for name in "abc"] == [11, 11, 11]
    assert [hold[:2] for hold in parts.pool.holds[0]] == [(0, 0), (1, 1), (2, 1), (3, 1)]


def test_agents_that_are_still_to_come_count_as_left(make):
    """The ego ends when the only other agent is done, not while that has yet to enter."""
    criteria = DoneCriteria(agents_alive=AgentsAliveDoneCriteria(minimum_total_agents_alive=2))
    short = LANER.replace(max_episode_steps=10, done_criteria=DoneCriteria(off_route=False))
    parts = make([LANER.replace(done_criteria=criteria)], [PooledAgents(short, 2)], worlds=2)
    start = first_start(parts, traffic=False)
    late = dataclasses.replace(start.agents[0], name="late", interface=0, pose=second_pose(), entry_time=1.0)
    parts.simulation.reset({0: dataclasses.replace(start, agents=(*start.agents, late)), 1: start})
    agents = parts.simulation.world.agents
    step(parts)
    assert agents.outcome[:, 0].tolist() == [Outcome.NONE, Outcome.OTHER]
    while agents.outcome[0, 1] == Outcome.NONE:
        assert agents.outcome[0, 0] == Outcome.NONE
        step(parts, [0])
    assert agents.entry_step[0, 1] == 11
    assert agents.outcome[0, :2].tolist() == [Outcome.OTHER, Outcome.TIME_OUT]


def test_agents_with_vehicles_of_their_own_leave_the_limit_of_traffic_as_it_is(make, tmp_path):
    """A limit of two vehicles beside the ego, which traffic reaches; a social agent comes on top of it."""
    counts, records = [], []
    for others in (0, 1):
        options = Options(record=tmp_path / str(others))
        parts = make(pool=[PooledAgents(LANER, 1)], options=options)
        start = dataclasses.replace(first_start(parts, traffic=True), limit=3)
        social = dataclasses.replace(start.agents[0], name="social", interface=0, pose=second_pose())
        agents = (*start.agents, social)[: 1 + others]
        parts.simulation.reset({0: dataclasses.replace(start, agents=agents)})
        assert np.count_nonzero(parts.simulation.world.agents.slot[0] != UNSET) == 1 + others
        counts.append([len(driven_by_traffic(parts, 0))])
        for _ in range(20):
            step(parts)
            counts[-1].append(len(driven_by_traffic(parts, 0)))
        parts.simulation.close()
        (folder,) = episodes_in(tmp_path / str(others))
        records.append(int(RecordedEpisode(folder).facts["limit"]))
    assert [max(each) for each in counts] == [2, 2]
    assert records == [3, 4]


def second_pose(number=1):
    """Return where the second ego of the scenario begins, or another, far from the first."""
    parts = assembled([LANER] * 3)
    with closing(parts.simulation):
        return first_start(parts, traffic=False).agents[number].pose


# What is left behind.


def arrays_of_agents(parts):
    """Yield path and array of everything that is kept of each agent, shape (B, A, ...)."""
    stages = parts.simulation._stages
    tables = dict(
        agents=parts.simulation.world.agents,
        missions=parts.simulation.world.missions,
        guidance=parts.simulation.world.guidance,
        actions=parts.actions,
        contacts=stages.contacts.contacts,
        events=stages.events.events,
        commands=stages.controllers._commands,
        tracks=stages.vehicles._tracks,
    )
    for name, table in tables.items():
        for column, array in table._asdict().items():
            if array.shape[:2] == parts.simulation.world.agents.slot.shape:
                yield f"{name}.{column}", array
    for number, array in enumerate((*stages.controllers.columns, *stages.vehicles.columns)):
        yield f"memory {number}", array


def spoil(array, row, place):
    """Fill an entry with what no fresh agent has."""
    array[row, place] = True if array.dtype == np.bool_ else 77


def readings_of(parts, agent_id):
    """Yield path and entries of an agent's readings in all simulations, shape (B, ...)."""
    readings = parts.simulation._stages.sensors.readings
    for name, block in readings.blocks.items():
        for place in np.flatnonzero(readings.agent_ids[name] == agent_id).tolist():
            for field, array in block.items():
                yield f"{name}.{field}", array[:, place : place + 1]


@pytest.mark.parametrize("kind", ["TrajectoryWithTime"])
def test_a_column_that_is_handed_out_is_like_new(make, kind):
    """All arrays of a column are filled with garbage; a fresh hold in another column is the oracle."""
    interface = LANER.replace(action=ActionSpaceType[kind], signals=True, lidar_point_cloud=True)
    parts = make([DRIVER], [PooledAgents(interface, 2)], worlds=2)
    start, used, fresh = first_start(parts, traffic=False), 1, 2
    parts.simulation.reset(dict.fromkeys(range(2), start))
    arrays = {name: array for name, array in arrays_of_agents(parts) if name != "agents.agent"}
    for name, array in arrays.items():
        if name not in ("agents.state", "agents.slot"):
            spoil(array, 1, used)
    readings = dict(readings_of(parts, used))
    for array in readings.values():
        spoil(array, 1, 0)
    parts.scene.routes.assign_agent(1, used, start.agents[0].mission.route)
    agent = dataclasses.replace(start.agents[0], name="first", interface=0, mission=AgentMission())
    numbers = [parts.pool.announce(1, agent) for _ in range(2)]
    assert [parts.pool.take(1, number) for number in numbers] == [used, fresh]
    for name, array in arrays.items():
        assert np.array_equal(array[1, used], array[1, fresh]), name
        # In the other simulation the column has had no agent before.
        is_given = name.startswith("missions") or name == "agents.state"
        assert is_given or np.array_equal(array[1, used], array[0, used]), name
    assert len(arrays) > 90
    assert len(readings) > 30
    assert not any(array.any() for array in readings.values())
    assert parts.scene.routes.number[1, used] == -1
    assert parts.scene.routes.route(1, used) == ()


def every_array(thing, path, found, known, leading):
    """Find all arrays with a leading shape in an object, by path."""
    if id(thing) in known or isinstance(thing, (str, bytes, type)) or path.count(".") > 12:
        return
    known.add(id(thing))
    if isinstance(thing, np.ndarray):
        if thing.shape[: len(leading)] == leading:
            found[path] = thing
        return
    if hasattr(thing, "_asdict"):
        parts = thing._asdict()
    elif isinstance(thing, dict):
        parts = thing
    elif isinstance(thing, (list, tuple, set)):
        parts = dict(enumerate(thing))
    elif isinstance(thing, partial):
        parts = {"args": thing.args, "held": getattr(thing, "held", ())}
    elif type(thing).__module__.startswith("smarts"):
        parts = {name: getattr(thing, name, None) for name in _slots(thing)}
    else:
        return
    for name, part in parts.items():
        every_array(part, f"{path}.{name}", found, known, leading)


def _slots(thing):
    return [*getattr(thing, "__dict__", ()), *getattr(type(thing), "__slots__", ())]


@pytest.mark.parametrize(
    "kind",
    [
        ActionSpaceType.Trajectory,
        *(pytest.param(kind, marks=pytest.mark.nightly) for kind in ActionSpaceType),
    ],
)
def test_a_controller_lists_what_it_keeps_of_agents(make, kind):
    """Seven simulations, so that arrays of agents are known by their shape."""
    parts = make([LANER.replace(action=kind)], worlds=7)
    controllers, known, kept = parts.simulation._stages.controllers, set(), {}
    every_array([parts.scene, parts.actions, controllers._commands, controllers.columns], "", {}, known, (7,))
    every_array(controllers._controllers, "", kept, known, (7, 1))
    assert [*kept] == []


# Records.


def test_agents_that_come_in_the_middle_are_recorded_under_their_names(make, tmp_path):
    options = Options(record=tmp_path)
    parts = make(pool=[PooledAgents(LANER.replace(max_episode_steps=12), 1)], options=options)
    start = first_start(parts, traffic=True)
    never = dataclasses.replace(
        start.agents[0], name="never", interface=0, take_over=TakeOver(vehicle="none")
    )
    open_gate(parts)
    parts.simulation.reset({0: dataclasses.replace(start, agents=(*start.agents, never))})
    world, spans = parts.simulation.world, {}
    for number in range(60):
        if number in (5, 30):
            slot = driven_by_traffic(parts, 0)[0]
            parts.ownership.submit([announced(parts, 0, slot, f"at {number}")])
        active = world.agents.slot[0, 1] >= 0
        parts.actions.given[0, 1] = parts.actions.fresh[0, 1] = active
        step(parts)
        if world.agents.slot[0, 1] >= 0:
            spans.setdefault(parts.pool.name(0, 1), []).append(int(world.step[0]))
    parts.simulation.close()
    (folder,) = episodes_in(tmp_path)
    agents = RecordedEpisode(folder).table("agents")
    assert agents["name"].tolist() == ["agent-0", "never", "at 5", "at 30"]
    assert agents["interface"].tolist() == [-1, 0, 0, 0]
    assert agents["agent_id"].tolist() == [0, -1, 1, 1]
    assert agents["entry_step"].tolist() == [0, -1, spans["at 5"][0], spans["at 30"][0]]
    assert agents["end_step"].tolist()[1:] == [-1, spans["at 5"][-1], spans["at 30"][-1]]
    assert [spans[name][0] for name in ("at 5", "at 30")] == [6, 31]
    assert agents["outcome"].tolist()[1:] == [Outcome.NONE, *[Outcome.TIME_OUT] * 2]
    assert agents["action"].tolist()[1:] == [-1, *[ActionSpaceType.Lane] * 2]
    assert agents["distance_travelled"][2] > 0
    assert (agents["slot"][2:] >= 0).all()
