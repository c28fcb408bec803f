"""Every registered traffic engine fulfils the contract of `TrafficEngine`, alone and beside another one."""

from contextlib import closing
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

from smarts.agents import AgentInterface
from smarts.providers.traffic_engines import EnginesByEpisode, traffic_of
from smarts.recordings.log import make_log
from smarts.sim.assembly import Options, assemble
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.build import build_scenario
from smarts.types.actions import ActionSpaceType
from smarts.types.episode import EpisodeStart
from smarts.types.recorded import RecordedTraffic
from smarts.types.streams import traffic_seed
from smarts.types.traffic import TRAFFIC_ENGINES
from smarts.types.transfers import Refusal
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World
from tests.tracks import track_of, tracks_of
from tests.unit.sstudio.sources import scenario, write_cross

SCENARIO, TRAFFIC = "intersection", "random_social_vehicles"
LIMIT, CAPACITY = 40, 48
FOLDER = TemporaryDirectory()
"""Logs of recordings."""


@pytest.fixture(scope="module")
def built():
    return build_scenario(SCENARIO)


ENGINES = tuple(TRAFFIC_ENGINES)
"""The engines of this program, without those that other tests register."""
OF_ROUTES = tuple(name for name in ENGINES if name != "Recorded")
"""The engines that drive flows; Recorded drives a recording of these."""


@pytest.fixture(params=ENGINES)
def kind(request):
    return TRAFFIC_ENGINES[request.param]


@cache
def files_of(built, traffic):
    """Return a traffic variation, with a recording of 40 s of it for the engine Recorded."""
    samples = {}
    with traffic_run(built, traffic, seed=7) as run:
        for vehicles in run.steps(40.0):
            columns = vehicles.position[:, 0], vehicles.position[:, 1], vehicles.heading, vehicles.speed
            for slot in np.flatnonzero(vehicles.alive).tolist():
                row = [run.world.time[0], *(column[slot] for column in columns)]
                samples.setdefault((slot, vehicles.generation[slot]), []).append(row)
    made = [track_of(f"{slot}-{generation}", rows) for (slot, generation), rows in samples.items()]
    log = Path(FOLDER.name, f"{built.name}-{traffic}.npz")
    make_log(tracks_of(made), built.roads()).save(log)
    return replace(built.traffic_files(traffic), recording=RecordedTraffic(log, "reactive", 0.1, 0.1))


class Case:
    """Simulations with traffic only, and with vehicles that a test adds."""

    def __init__(self, built, kind, worlds=2, **options):
        self.built, self.roads = built, built.roads()
        lanes = len(self.roads.lane_ids)
        self.world = World(worlds=worlds, capacity=CAPACITY, agents=1, lanes=lanes)
        self.vehicles = self.world.vehicles
        self.all = np.ones(worlds, np.bool_)
        self.engine = kind(self.world, [self.roads], **options)

    def start(self, world=0, episode=0, limit=LIMIT, engine="SUMO", traffic=TRAFFIC):
        return EpisodeStart(
            seed=7,
            world=world,
            episode=episode,
            scenario=SCENARIO,
            map=0,
            traffic=files_of(self.built, traffic),
            traffic_name=traffic,
            traffic_seed=traffic_seed(7, world=world, episode=episode),
            limit=limit,
            agents=(),
            engine=engine,
        )

    def reset(self, **starts):
        """Begin episode 0 of world b in row b, or the given episodes: `row_0=start`."""
        chosen = {int(name[4:]): start for name, start in starts.items()} or {
            row: self.start(row) for row in range(self.world.worlds)
        }
        for row in chosen:
            self.world.clear(row)
        self.engine.reset(chosen)

    def step(self, count=1, rows=None):
        rows = self.all if rows is None else np.array(rows)
        for _ in range(count):
            self.world.advance(rows)
            self.engine.step(rows)
            assert not self.engine.failures

    def put(self, row, lane, s, owner=Owner.AGENT):
        """Add a standing vehicle of another owner on a lane."""
        slot = self.world.registry.admit(row, "other", owner, VehicleKind.PASSENGER, 5.0, 1.8)
        x, y, self.vehicles.heading[row, slot] = self.roads.pose_at(lane, s)
        self.vehicles.position[row, slot] = x, y
        return slot

    def owned(self, row, owner=Owner.TRAFFIC):
        return np.flatnonzero(self.vehicles.alive[row] & (self.vehicles.owner[row] == owner))

    def content(self, row):
        """Return the content of a simulation: columns, names, routes, signals."""
        columns = [column[row].tobytes() for column in self.vehicles]
        names = [self.world.registry.name(row, slot) for slot in range(CAPACITY)]
        table = self.world.routes
        routes = [table.edges(row, number).tolist() for number in range(table.count(row))]
        return columns, names, routes, self.world.signals[row].tobytes()


@pytest.fixture
def case(built, kind):
    made = []

    def make(worlds=2, **options):
        made.append(Case(built, kind, worlds, **options))
        return made[-1]

    yield make
    for one in made:
        one.engine.close()
        one.engine.close()


def moving(case, row):
    """Return the slot of the traffic vehicle with 3 m/s or more that is farthest from the junction."""
    slots = case.owned(row)
    heading = case.vehicles.heading[row, slots]
    ahead = np.stack([np.cos(heading), np.sin(heading)], -1)
    distance = -(case.vehicles.position[row, slots] * ahead).sum(axis=-1)
    distance[case.vehicles.speed[row, slots] < 3.0] = 0.0
    assert distance.max() > 60.0
    return int(slots[distance.argmax()])


def test_traffic_arrives_moves_and_leaves(case):
    one = case()
    one.reset()
    assert all(len(one.owned(row)) for row in range(2))
    generations = one.vehicles.generation.copy()
    for _ in range(200):
        before = one.vehicles.position.copy(), one.vehicles.generation.copy()
        one.step()
        stays = one.vehicles.alive & (one.vehicles.generation == before[1])
        moved = np.linalg.norm(one.vehicles.position - before[0], axis=-1)[stays & one.world.before.alive]
        assert moved.max() < 6.0  # 60 m/s
        assert np.isfinite(one.vehicles.position).all()
    assert (one.vehicles.generation > generations).any()
    alive = one.vehicles.alive
    assert (one.vehicles.owner[alive] == one.vehicles.home[alive]).all()
    assert (one.vehicles.length[alive] > 0).all()
    assert (one.vehicles.desired_speed[alive] > 0).all()
    assert not one.vehicles.speed[~alive].any()


def test_routes_are_numbers_of_connected_edges(case):
    one = case(1)
    one.reset()
    one.step(20)
    roads, table = one.roads, one.world.routes
    numbers = one.vehicles.route[0, one.owned(0)]
    assert ((numbers >= 0) & (numbers < table.count(0))).all()
    for number in set(numbers.tolist()):
        edges = table.edges(0, number)
        assert not roads.edge_is_internal[edges].any()
        assert (roads.edge_to[edges[:-1]] == roads.edge_from[edges[1:]]).all()


def test_a_row_of_a_batch_equals_a_separate_run_and_is_constant_when_masked(case):
    batch, alone = case(3), case(1)
    batch.reset()
    alone.reset(row_0=alone.start(world=1))
    for step in range(60):
        masked = batch.content(1)
        if step % 3 == 0:
            batch.step(rows=[True, False, True])
            assert batch.content(1) == masked
        batch.step()
        alone.step()
        assert batch.content(1) == alone.content(0)


@pytest.fixture(scope="module")
def two_traffics(tmp_path_factory):
    """Return a scenario with two traffic variations that begin on the same lane."""
    folder = write_cross(tmp_path_factory.mktemp("scenarios") / "two")
    onward = "t.Traffic(flows=[flow(rate=900)], warm_up=20)"
    turning = 't.Route(("from_west", 0, 0), ("to_south", 0, "max"))'
    other = f"t.Traffic(flows=[flow({turning}), flow(south_north)], warm_up=20)"
    mission = "ego_missions=[t.Mission(south_north)]"
    folder.joinpath("scenario.py").write_text(
        scenario(f'traffic={{"onward": {onward}, "other": {other}}}, {mission}')
    )
    return build_scenario(folder)


def test_an_episode_does_not_depend_on_earlier_and_parallel_traffic(two_traffics, kind):
    used, fresh = (Case(two_traffics, kind, worlds) for worlds in (2, 1))
    try:
        used.reset(row_0=used.start(traffic="other"), row_1=used.start(1, traffic="other"))
        used.step(20)
        for one in (used, fresh):
            one.reset(row_0=one.start(traffic="onward"))
            slot = one.put(0, one.roads.lane_number("from_west", 0), 40.0)
            one.vehicles.speed[0, slot] = 5.0
            one.step()
            one.vehicles.owner[0, slot] = Owner.TRAFFIC
        for _ in range(50):
            used.step()
            fresh.step()
            assert used.content(0) == fresh.content(0)
    finally:
        used.engine.close()
        fresh.engine.close()


def test_vehicles_of_other_owners_are_not_written(case):
    one = case(1)
    one.reset()
    slot = one.put(0, one.roads.lane_number("north_in", 0), 20.0)
    row = {name: column[0, slot].copy() for name, column in one.vehicles._asdict().items()}
    one.step(50)
    for name, value in row.items():
        assert np.array_equal(getattr(one.vehicles, name)[0, slot], value, equal_nan=True), name


def test_the_limit_delays_arrivals(case):
    one = case(2)
    one.reset(row_0=one.start(limit=6), row_1=one.start(1))
    for _ in range(100):
        one.step()
        assert one.vehicles.alive[0].sum() <= 6
    assert one.engine.is_full.tolist() == [True, False]
    one.reset(row_0=one.start(limit=LIMIT), row_1=one.start(1))
    assert not one.engine.is_full.any()


def test_hand_overs_are_one_write_without_a_jump(case):
    one = case(2)
    one.reset()
    one.step(10)
    slot = moving(one, 1)
    name, generation = one.world.registry.name(1, slot), one.vehicles.generation[1, slot]
    one.vehicles.owner[1, slot] = Owner.AGENT
    for _ in range(10):
        heading, speed = one.vehicles.heading[1, slot], one.vehicles.speed[1, slot]
        one.vehicles.position[1, slot] += 0.1 * speed * np.array([np.cos(heading), np.sin(heading)])
        one.step()
    rows, slots = np.array([1], np.int32), np.array([slot], np.int32)
    assert one.engine.can_accept(rows, slots).tolist() == [Refusal.NONE]
    one.vehicles.owner[1, slot] = Owner.TRAFFIC
    for _ in range(10):
        before, speed = one.vehicles.position[1, slot].copy(), one.vehicles.speed[1, slot]
        one.step()
        moved = np.linalg.norm(one.vehicles.position[1, slot] - before)
        assert moved == pytest.approx(0.1 * speed, abs=0.15)
    assert one.vehicles.alive[1, slot]
    assert one.vehicles.generation[1, slot] == generation
    assert one.world.registry.name(1, slot) == name
    assert one.vehicles.route[1, slot] >= 0


def test_a_vehicle_off_the_roads_is_refused(case):
    one = case(2)
    one.reset()
    one.step()
    slots = [moving(one, row) for row in range(2)]
    one.vehicles.owner[[0, 1], slots] = Owner.AGENT
    one.vehicles.position[0, slots[0]] += 5_000.0
    one.step(6)
    refusals = one.engine.can_accept(np.arange(2, dtype=np.int32), np.array(slots, np.int32))
    assert refusals.dtype == np.int8
    assert refusals.tolist() == [Refusal.OFF_LANES, Refusal.NONE]
    assert one.engine.can_accept(np.zeros(0, np.int32), np.zeros(0, np.int32)).shape == (0,)


@pytest.fixture(scope="module")
def both_engines(tmp_path_factory):
    """Return a scenario with a traffic variation for each engine."""
    folder = write_cross(tmp_path_factory.mktemp("scenarios") / "both")
    traffic = ", ".join(
        f'"{name}": t.Traffic(flows=[flow(rate=1800)], engine="{name}", warm_up=20)' for name in OF_ROUTES
    )
    folder.joinpath("scenario.py").write_text(
        scenario(f"traffic={{{traffic}}}, ego_missions=[t.Mission(south_north)]")
    )
    return build_scenario(folder)


@pytest.mark.parametrize("engine_option", [None, *OF_ROUTES])
def test_options_override_the_scenarios_engine(both_engines, engine_option):
    options = Options(traffic_engine=engine_option)
    parts = assemble([both_engines], [AgentInterface(action=ActionSpaceType.Lane)], worlds=4, options=options)
    with closing(parts.simulation):
        starts = {row: parts.schedule.start(0, episode=row) for row in range(4)}
        assert all(start.engine == (engine_option or start.traffic_name) for start in starts.values())
        assert {start.engine for start in starts.values()} == (
            {engine_option} if engine_option else {*OF_ROUTES}
        )
        parts.simulation.reset(starts)
        for _ in range(20):
            frame = parts.simulation.step(parts.actions, np.ones(4, bool), np.ones((4, 1), bool))
            assert not frame.failures
        vehicles = frame.world.vehicles
        assert (vehicles.alive & (vehicles.owner == Owner.TRAFFIC)).any(axis=1).all()


def test_each_episode_uses_the_engine_that_it_names(built):
    roads, names = built.roads(), list(ENGINES)
    mixed = Case(built, lambda world, maps: traffic_of(names, world, maps), len(names))
    alone = [Case(built, TRAFFIC_ENGINES[name], 1) for name in names]
    try:
        assert isinstance(mixed.engine, EnginesByEpisode)
        for turn in range(2):
            played = [names[(row + turn) % len(names)] for row in range(len(names))]
            starts = {f"row_{row}": mixed.start(row, turn, engine=name) for row, name in enumerate(played)}
            mixed.reset(**starts)
            mixed.step(30)
            for row, name in enumerate(played):
                single = alone[names.index(name)]
                single.reset(row_0=single.start(row, turn))
                single.step(30)
                assert mixed.content(row) == single.content(0)
        assert mixed.engine.is_full.shape == (len(names),)
        assert len(roads.lane_ids) == mixed.world.signals.shape[1]
    finally:
        for one in (mixed, *alone):
            one.engine.close()
