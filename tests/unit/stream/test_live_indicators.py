"""Turn indicators of running simulations, by hand on a crossing and a road of three lanes."""

import gc
import weakref

import numpy as np
import pytest
from numpy.typing import ArrayLike

from smarts.envision.recorded_lights import AFTER_CHANGE as RECORDED_AFTER_CHANGE
from smarts.envision.recorded_lights import BEFORE_TURN as RECORDED_BEFORE_TURN
from smarts.stream.arrays import packed_array
from smarts.stream.live_encoder import LiveEncoder
from smarts.stream.live_indicators import AFTER_CHANGE, BEFORE_TURN, LEFT, RIGHT, LiveIndicators
from smarts.stream.motion import LEFT as LEFT_FLAG
from smarts.stream.motion import motion_of
from smarts.stream.road_map import map_message, origin_of
from smarts.types.episode_schema import VEHICLES
from tests.maps import Road, crossing, graph_of, straight

DT = 0.1
EDGES = [f"{arm}_{way}" for arm in ("west", "south", "east", "north") for way in ("out", "in")]
WEST_IN = EDGES.index("west_in")


def vehicles(
    lane: ArrayLike,
    s: ArrayLike = 0.0,
    speed: ArrayLike = 10.0,
    route: ArrayLike = -1,
    slot: ArrayLike | None = None,
):
    """Return rows of vehicles, one for each lane given."""
    lanes = np.atleast_1d(lane)
    count = len(lanes)

    def column(value, kind):
        return np.broadcast_to(np.asarray(value, kind), count).copy()

    return {
        "slot": column(np.arange(count) if slot is None else slot, np.int32),
        "generation": column(1, np.int32),
        "lane": column(lanes, np.int32),
        "s": column(s, np.float32),
        "speed": column(speed, np.float32),
        "route": column(route, np.int32),
    }


@pytest.fixture(scope="module")
def graph():
    return crossing()


@pytest.fixture
def indicators(graph):
    return LiveIndicators(map_message(graph, ""), DT)


@pytest.mark.parametrize(("to", "light"), [("north", LEFT), ("east", 0), ("south", RIGHT)])
def test_a_route_says_where_a_vehicle_turns(indicators, to, light):
    indicators.take_routes({"route": [7], "edges": [[WEST_IN, EDGES.index(f"{to}_out")]]})
    # The lane has 80 m; at 10 m/s the turn is 3 s away after 50 m.
    rows = vehicles([WEST_IN, WEST_IN, WEST_IN], s=[49.0, 51.0, 51.0], route=[7, 7, -1])
    assert indicators.lights(rows, 0).tolist() == [0, light, 0]


def test_a_lane_that_leads_nowhere_else_needs_no_route():
    right = graph_of(
        {"west_in": Road([(-90, -1.6), (-10, -1.6)]), "south_out": Road([(-1.6, -10), (-1.6, -90)])},
        [(("west_in", 0), ("south_out", 0))],
    )
    indicators = LiveIndicators(map_message(right, ""), DT)
    assert indicators.lights(vehicles([0, 0], s=[49.0, 79.0]), 0).tolist() == [0, RIGHT]


def test_vehicles_show_it_as_long_as_they_turn(graph, indicators):
    inside = np.flatnonzero(graph.is_internal)
    headings = graph.point_heading
    bend = np.array([headings[graph.point_start[i + 1] - 1] - headings[graph.point_start[i]] for i in inside])
    bend = (bend + np.pi) % (2 * np.pi) - np.pi
    expected = np.select([bend > 0.4, bend < -0.4], [LEFT, RIGHT], 0)
    assert set(expected.tolist()) == {0, LEFT, RIGHT}
    assert indicators.lights(vehicles(inside), 0).tolist() == expected.tolist()


@pytest.mark.parametrize(("before", "after", "light"), [(0, 1, LEFT), (2, 1, RIGHT), (0, 2, LEFT)])
def test_vehicles_show_lane_changes_for_a_while(before, after, light):
    indicators = LiveIndicators(map_message(straight(), ""), DT)
    assert indicators.lights(vehicles([before, before]), 0).tolist() == [0, 0]
    shown = [indicators.lights(vehicles([after, before]), step).tolist() for step in range(1, 12)]
    assert {other for _, other in shown} == {0}
    assert [mine for mine, _ in shown] == [light] * 8 + [0] * 3


def test_vehicles_are_told_apart_though_rows_move_and_slots_come_again():
    indicators = LiveIndicators(map_message(straight(), ""), DT)
    indicators.lights(vehicles([0, 1, 2], slot=[5, 3, 9]), 0)
    assert indicators.lights(vehicles([2, 1, 1], slot=[9, 5, 3]), 1).tolist() == [0, LEFT, 0]
    another = vehicles([2], slot=[9])
    another["generation"][:] = 2
    assert indicators.lights(another, 2).tolist() == [0]
    another["lane"][:] = 0
    assert indicators.lights(another, 3).tolist() == [RIGHT]


def test_places_off_the_map_show_nothing(indicators):
    for lane in (-1, 10_000):
        assert indicators.lights(vehicles([lane], s=np.nan), 0).tolist() == [0]
    assert indicators.lights(vehicles([]), 1).tolist() == []
    assert indicators.lights(vehicles([WEST_IN], route=5), 2).tolist() == [0]


def test_it_is_shown_as_long_as_in_recorded_episodes():
    assert (AFTER_CHANGE, BEFORE_TURN) == (RECORDED_AFTER_CHANGE, RECORDED_BEFORE_TURN)


def test_viewers_get_them():
    graph = straight()
    road_map = {**map_message(graph, ""), "origin": list(origin_of(graph))}
    facts = {"scenario": "s", "traffic": "", "episode": 0, "dt": DT}
    encoder = LiveEncoder(road_map, facts, "a", 1)

    def flags(step, lane):
        rows = np.zeros((1, len(VEHICLES.columns)))
        for name, value in {"step": step, "generation": 1, "lane": lane, "route": -1, "length": 4}.items():
            rows[0, VEHICLES.names.index(name)] = value
        frame = {
            "type": "frame",
            "step": step,
            "rows": [rows.tobytes(), b"", b""],
            "agent": [],
            "names": [],
            "signals": [],
            "bubbles": [],
            "extras": [],
        }
        made = encoder.take(frame, is_watched=True)
        return int(motion_of(next(message for message in made if message["type"] == "steps")).flags[0])

    assert not flags(0, 0) & LEFT_FLAG
    assert flags(1, 1) & LEFT_FLAG
    assert not flags(20, 1) & LEFT_FLAG


def lanes_message(lines, junction):
    """Return the message of a map with lanes of two points each [0.01 m], of an edge each."""
    count = len(lines)
    columns = {
        "start": np.arange(0, 2 * count + 1, 2, dtype=np.uint32),
        "x": np.array([x for line in lines for x, _ in line], np.int32),
        "y": np.array([y for line in lines for _, y in line], np.int32),
        "junction": np.array(junction, np.uint8),
        "edge": np.arange(count, dtype=np.uint32),
    }
    return {"type": "map", "lanes": {name: packed_array(column) for name, column in columns.items()}}


def test_lanes_that_all_meet_at_one_place_are_visited_once_each():
    # 20 lanes of 0.1 m and 20 back: 20**8 ways of eight lanes.
    short = [((0, 0), (10, 0)), ((10, 0), (0, 0))] * 20
    lines = [((-5000, 0), (0, 0)), *short, ((10, 0), (10, 5000))]
    indicators = LiveIndicators(lanes_message(lines, [0, *[1] * 40, 0]), DT)
    assert indicators.lights(vehicles([0], s=[49.0]), 0).tolist() == [LEFT]
    lanes = indicators._lanes
    asked, after = [], lanes.after
    lanes._ways.clear()
    lanes.after = lambda lane: asked.append(lane) or after(lane)
    lanes.ways(0)
    assert len(asked) == len(set(asked)) <= len(lines)


def test_a_lane_beside_a_very_short_one_does_not_follow_it():
    # Two lanes begin at one place inside a junction: 0.3 m straight on to the east, and one that goes north.
    lines = [((-5000, 0), (0, 0)), ((0, 0), (30, 0)), ((0, 0), (0, 900)), ((30, 0), (5000, 0))]
    lanes = LiveIndicators(lanes_message(lines, [0, 1, 1, 0]), DT)._lanes
    assert lanes.after(1) == [3]
    assert sorted(lanes.after(0)) == [1, 2, 3]


def test_maps_are_shared_and_forgotten():
    message = map_message(crossing(), "")
    one, other = LiveIndicators(message, DT), LiveIndicators(message, DT)
    assert one._lanes is other._lanes
    lanes = weakref.ref(one._lanes)
    del one, other
    gc.collect()
    assert lanes() is None
