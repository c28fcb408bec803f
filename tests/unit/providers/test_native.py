"""The traffic engine Native: against SUMO without chance, and what must hold in any traffic."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scenarios
from smarts.errors import TrafficError
from smarts.geometry.boxes import boxes_overlap
from smarts.providers.native.engine import Native
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.build import build_scenario
from tests.contracts.test_traffic_engines import Case
from tests.unit.sstudio.sources import scenario, write_cross

STEP = 0.1
DRIVERS = """
from pathlib import Path

from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

ROUTE = {offset: t.Route(("from_west", 0, offset), ("to_east", 0, "max")) for offset in (10, 60)}


def trip(name, offset, speed, depart, stops=(), **more):
    driver = t.TrafficActor(name, speed=t.Distribution(speed, 0.0), sigma=0.0, **more)
    return t.Trip(name, ROUTE[offset], depart=depart, actor=driver, stops=stops)


def traffic(**more):
    trips = [trip("slow", 60, 0.4, 0.0), trip("fast", 10, 1.1, 0.0, **more)]
    trips.append(trip("last", 10, 1.3, 6.0, **more))
    return t.Traffic(flows=[], trips=trips)


gen_scenario(
    t.Scenario(
        traffic={
            "euler": traffic(),
            "ballistic": traffic(reaction_time=0.2),
            "late": traffic(reaction_time=1.0),
            "stopping": t.Traffic(
                flows=[], trips=[trip("stops", 10, 1.0, 0.0, [t.Stop("from_west", 0, 60.0, 5.0)])]
            ),
        },
        ego_missions=[t.Mission(t.Route(("from_south", 0, 20), ("to_north", 0, 50)))],
    ),
    output_dir=Path(__file__).parent,
)
"""


@pytest.fixture(scope="module")
def drivers(tmp_path_factory):
    folder = write_cross(tmp_path_factory.mktemp("scenarios") / "drivers")
    (folder / "scenario.py").write_text(DRIVERS)
    return build_scenario(folder)


def driven(built, traffic, engine, seconds):
    """Return position and speed of each vehicle after each step; slots are in the order of departures."""
    with traffic_run(built, traffic, engine=engine) as run:
        return [
            (states.position[states.alive].copy(), states.speed[states.alive].copy())
            for states in run.steps(seconds)
        ]


@pytest.mark.parametrize("traffic", ["euler", "ballistic", "late"])
def test_drivers_follow_as_in_sumo(drivers, traffic):
    # The slow one leaves the road into the junction after 8 s.
    sumo, native = (driven(drivers, traffic, engine, 7.0) for engine in ("SUMO", "Native"))
    assert [len(speed) for _, speed in native] == [len(speed) for _, speed in sumo]
    for (position, speed), (its_position, its_speed) in zip(native, sumo, strict=True):
        assert speed == pytest.approx(its_speed, abs=2e-3)
        assert position == pytest.approx(its_position, abs=5e-3)


MEETING = """
from pathlib import Path

from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t


def trip(depart, begin, end, factor=1.0):
    lanes = t.LaneChangingModel(cooperative=0.5)
    driver = t.TrafficActor(
        f"car_{{depart}}", speed=t.Distribution(factor, 0.0), sigma=0.0, lane_changing_model=lanes
    )
    return t.Trip(f"car_{{depart}}", t.Route(begin, (*end, "max")), depart=depart, actor=driver)


gen_scenario(
    t.Scenario(
        map_spec=t.MapSpec(source="{source}"),
        traffic={{"few": t.Traffic(flows=[], trips=[{trips}])}},
        ego_missions=[t.Mission(t.Route({mission}))],
    ),
    output_dir=Path(__file__).parent,
)
"""
LEFT_TURN = """
trip(0.0, ("west_in", 1, 10), ("north_out", 1)),
trip(1.5, ("south_in", 0, 10), ("north_out", 0)),
"""
MERGE = """
trip(0.0, ("main_in", 0, 90), ("main_out", 0), 0.8),
trip(1.8, ("main_in", 0, 90), ("main_out", 0)),
trip(3.6, ("main_in", 0, 90), ("main_out", 0)),
trip(4.0, ("ramp", 0, 60), ("main_out", 0)),
trip(5.4, ("main_in", 0, 90), ("main_out", 0)),
"""


@pytest.mark.parametrize(
    ("source", "trips", "mission", "slowest"),
    [
        # The turn ends beside the lane of the other one, for which it waits none the less.
        ("intersection", LEFT_TURN, '("south_in", 0, 20), ("north_out", 0, 50)', 4.0),
        ("on_ramp_merge", MERGE, '("ramp", 0, 20), ("main_out", 0, 50)', 15.0),
    ],
    ids=["left_turn", "merge"],
)
def test_drivers_give_way_and_merge_as_in_sumo(tmp_path, source, trips, mission, slowest):
    source = Path(scenarios.__file__).parent / source
    (tmp_path / "scenario.py").write_text(MEETING.format(source=source, trips=trips, mission=mission))
    built = build_scenario(tmp_path)
    sumo, native = (driven(built, "few", engine, 20.0) for engine in ("SUMO", "Native"))
    for (_, speed), (_, its_speed) in zip(native, sumo, strict=True):
        assert speed == pytest.approx(its_speed, abs=5e-3)
    assert min(speed.min(initial=np.inf) for _, speed in sumo) < slowest


@pytest.mark.parametrize("name", ["intersection_v1", "double_merge_v1"])
def test_none_passes_another_in_its_lane_and_none_is_lost(name):
    with traffic_run(build_scenario(name), "random_social_vehicles", seed=3, engine="Native") as run:
        engine = run.engine
        assert isinstance(engine, Native)
        n, before, arrived, began = engine.traffic, {}, 0, int(run.states.alive.sum())
        born = int(n.sims["born"][0])
        for states in run.steps(60.0):
            cars, now = n.cars[np.flatnonzero(states.alive)], {}
            for car in cars:
                may_arrive = bool(n.ways["arrival"][car["row"]] < np.inf)
                now[int(car["number"])] = int(car["lane"]), float(car["front"]), may_arrive
            gone = [before[number] for number in before.keys() - now.keys()]
            assert all(may_arrive for _, _, may_arrive in gone)
            arrived += len(gone)
            stay = {key: now[key] for key in now if key in before and now[key][0] == before[key][0]}
            for key, (lane, front, _) in stay.items():
                for other, (its_lane, its_front, _) in stay.items():
                    if lane == its_lane and before[other][1] < before[key][1]:
                        assert its_front < front
            assert (states.speed[states.alive] >= 0.0).all()
            before = now
        departed = int(n.sims["born"][0]) - born
        assert departed > 20
        assert began + departed == arrived + len(before)


def test_vehicles_of_each_traffic_of_a_map_take_their_own_routes():
    case = Case(build_scenario("intersections@train-00"), Native)
    traffics = "random_social_vehicles", "dense"
    case.reset(**{f"row_{row}": case.start(row, traffic=name) for row, name in enumerate(traffics)})
    case.step(100)
    for row in range(2):
        slots = case.owned(row)
        assert len(slots) > 5
        for slot in slots:
            lane, route = case.vehicles.lane[row, slot], int(case.vehicles.route[row, slot])
            edge = int(case.roads.lane_edge[lane])
            assert case.roads.is_internal[lane] or edge in case.world.routes.edges(row, route)


TRACE = """
import hashlib
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.build import build_scenario

content = hashlib.blake2b()
with traffic_run(build_scenario("intersection_v1"), "random_social_vehicles", engine="Native") as run:
    for states in run.steps(10.0):
        content.update(states.position.tobytes())
"""


def test_another_process_drives_the_same_traffic():
    command = [sys.executable, "-c", TRACE + "print(content.hexdigest())"]
    other = subprocess.run(command, capture_output=True, text=True, check=True)
    own: dict[str, Any] = {}
    exec(TRACE, own)
    assert other.stdout.split() == [own["content"].hexdigest()]


def test_vehicles_are_placed_where_a_search_finds_them():
    with traffic_run(build_scenario("intersection_v1"), "random_social_vehicles", engine="Native") as run:
        world, engine = run.world, run.engine
        assert isinstance(engine, Native)
        roads, count = engine._atlas.roads, 0
        for states in run.steps(60.0):
            slots = np.flatnonzero(world.placed[0] & states.alive)
            maps, height = np.zeros(len(slots), int), states.height[slots]
            found = engine._atlas.locate(maps, states.position[slots], states.heading[slots], height=height)
            # In a junction, where lanes overlap, and on the line between two, the search only guesses.
            same, lanes = found.lane == states.lane[slots], states.lane[slots]
            between = np.abs(states.lane_offset[slots]) > 0.5 * roads.lane_width[lanes] - 1e-6
            assert (same | roads.lane_inside[lanes] | between).all()
            assert states.lane_position[slots][same] == pytest.approx(found.s[same], abs=1e-9)
            assert states.lane_offset[slots][same] == pytest.approx(found.t[same], abs=1e-9)
            count += np.count_nonzero(same)
            assert np.count_nonzero(states.alive) - len(slots) < 4  # those that change lanes
            world.placed[:] = False
    assert count > 5000


@pytest.mark.parametrize("begin", [-40.0, -20.0, None])
def test_a_driver_that_turns_left_gives_way_to_an_agent(tmp_path, begin):
    """The agent comes up the other road at 12 m/s, from `begin` [m] on, or stands far away."""
    source, trip = Path(scenarios.__file__).parent / "intersection", LEFT_TURN.strip().splitlines()[0]
    mission = '("south_in", 0, 20), ("north_out", 0, 50)'
    (tmp_path / "scenario.py").write_text(MEETING.format(source=source, trips=trip, mission=mission))
    case = Case(build_scenario(tmp_path), Native, worlds=1)
    case.reset(row_0=case.start(traffic="few"))
    slot = case.put(0, case.roads.lane_number("south_in", 0), 1.0)
    vehicles, x, slowest = case.vehicles, case.vehicles.position[0, slot, 0], np.inf
    for step in range(170):
        if begin is not None:
            vehicles.position[0, slot], vehicles.speed[0, slot] = (x, begin - 60.0 + 1.2 * step), 12.0
        case.step()
        own = case.owned(0)
        slowest = min(slowest, vehicles.speed[0, own].min(initial=np.inf))
        if begin is not None and vehicles.position[0, slot, 1] < -7.0:
            assert (vehicles.position[0, own, 0] < -12.0).all(), (
                "it waits at its line until the agent is past"
            )
    assert not len(case.owned(0)), "it has left"
    assert slowest == pytest.approx(6.4 if begin is None else 0.0, abs=0.1)


@pytest.mark.parametrize("beyond", [-30.0, -1.0, 1.5])
def test_drivers_stop_behind_a_vehicle_of_an_agent_also_across_lane_ends(beyond):
    case = Case(build_scenario("two_way"), Native, worlds=1)
    case.reset()
    # It stands on the lane, with its front over the end, or with its tail before it.
    lane = case.roads.lane_number("eastbound_approach", 0)
    slot = case.put(0, lane, float(case.roads.length[lane]) + beyond)
    vehicles, size, stood = case.vehicles, np.array([5.0, 1.8]), 0
    # Those that are there cannot all stop for a vehicle that comes from nowhere.
    first = vehicles.generation[0] + np.where(vehicles.alive[0], 1, 0)
    for _ in range(250):
        case.step()
        own = case.owned(0)
        boxes = np.stack([vehicles.length[0, own], vehicles.width[0, own]], -1)
        here = vehicles.position[0, [slot]], vehicles.heading[0, [slot]], size
        hits = boxes_overlap(*here, vehicles.position[0, own], vehicles.heading[0, own], boxes)
        assert not (hits & (vehicles.generation[0, own] >= first[own])).any()
        gap = np.hypot(*(vehicles.position[0, own] - vehicles.position[0, slot]).T) - 5.0
        stood += ((gap > 2.0) & (gap < 4.0) & (vehicles.speed[0, own] < 0.1)).any()
    assert stood > 50


def test_vehicles_stop_as_in_sumo(drivers):
    sumo, native = (driven(drivers, "stopping", engine, 25.0) for engine in ("SUMO", "Native"))
    for (position, speed), (its_position, its_speed) in zip(native, sumo, strict=True):
        assert speed == pytest.approx(its_speed, abs=0.3)
        assert position == pytest.approx(its_position, abs=0.5)


def with_own_file(folder, routes, more=""):
    """Return a built scenario whose traffic is that of a file of routes."""
    write_cross(folder)
    (folder / "own.rou.xml").write_text(routes)
    own = f't.Traffic(flows=[], route_files=["own.rou.xml"], {more})'
    traffic = f'traffic={{"own": {own}}}, ego_missions=[t.Mission(south_north)]'
    (folder / "scenario.py").write_text(scenario(traffic))
    return build_scenario(folder)


OWN_FILE = """<routes>
    <trip id="long" depart="0" from="from_west" to="to_east" departLane="best"/>
    {}
</routes>
"""


@pytest.mark.parametrize(
    "more", ["", '<routeDistribution id="some"><route edges="from_west to_east"/></routeDistribution>']
)
def test_own_files_are_driven_and_what_is_left_out_is_named(tmp_path, caplog, more):
    built = with_own_file(tmp_path / "own", OWN_FILE.format(more), 'engine="Native"')
    assert ("Native does not drive routeDistribution" in caplog.text) == bool(more)
    if more:
        with pytest.raises(TrafficError, match="does not drive routeDistribution"):
            driven(built, "own", "Native", 1.0)
    else:
        assert len(driven(built, "own", "Native", 5.0)[-1][1]) == 1


STEADY = 'sigma="0" speedFactor="norm(1,0)"'
OWN_FILES = {
    "types": f"""
    <vTypeDistribution id="mix">
        <vType id="slow" {STEADY} maxSpeed="5" probability="1"/>
        <vType id="never" maxSpeed="1" probability="0"/>
    </vTypeDistribution>
    <trip id="one" type="mix" depart="0:00:01" from="from_west" to="to_east" departPos="-1" departSpeed="0"/>
    """,
    "stop": f"""
    <vType id="steady" {STEADY}/>
    <trip id="one" type="steady" depart="0" from="from_west" to="to_east" departPos="-40" departSpeed="0">
        <stop lane="from_west_0" duration="0:00:02"/>
    </trip>
    """,
    "places": """
    <vType id="steady" speedFactor="normc(1,0,0.2,2)" sigma="0"/>
    <trip id="one" type="steady" depart="0" from="from_west" to="to_east" departPos="-60" departSpeed="0">
        <stop edge="from_west" startPos="-40" endPos="-30" duration="2"/>
    </trip>
    """,
    "flow": f"""
    <vType id="steady" {STEADY}/>
    <flow id="some" type="steady" begin="0:00:00" period="2" number="3" from="from_west" to="to_east"
        departSpeed="0"/>
    """,
    "number": f"""
    <vType id="steady" {STEADY}/>
    <flow id="some" type="steady" begin="1" end="7" number="3" from="from_west" to="to_east" departSpeed="0"/>
    """,
}


@pytest.mark.parametrize("content", OWN_FILES.values(), ids=OWN_FILES)
def test_own_files_are_read_as_by_sumo(tmp_path, content):
    built = with_own_file(tmp_path / "own", f"<routes>{content}</routes>")
    sumo, native = (driven(built, "own", engine, 9.0) for engine in ("SUMO", "Native"))
    assert len(native[-1][1]) == len(sumo[-1][1])
    assert len(sumo[-1][1]) == content.count("<trip") or len(sumo[-1][1]) == 3
    stood, its_stood = (sum((speed < 0.1).sum() for _, speed in each) for each in (native, sumo))
    assert stood == pytest.approx(its_stood, abs=5)
    for (position, _), (its_position, _) in zip(native, sumo, strict=True):
        assert position[:1] == pytest.approx(its_position[:1], abs=0.5)
