"""Turn indicators of running simulations, by hand on a crossing and a road of three lanes."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from smarts.envision.recorded_lights import AFTER_CHANGE as RECORDED_AFTER_CHANGE
from smarts.stream.live_encoder import LiveEncoder
from smarts.stream.live_indicators import AFTER_CHANGE, LEFT, RIGHT, LiveIndicators
from smarts.stream.motion import LEFT as LEFT_FLAG
from smarts.stream.motion import motion_of
from smarts.stream.road_map import map_message, origin_of
from smarts.types.episode_schema import VEHICLES
from tests.maps import crossing, straight

DT = 0.1


def vehicles(lanes: ArrayLike, slot: ArrayLike | None = None):
    """Return rows of vehicles, one for each lane given."""
    count = len(lane := np.array(lanes, np.int32))
    slots = np.arange(count) if slot is None else slot
    return {"slot": np.array(slots, np.int32), "generation": np.ones(count, np.int32), "lane": lane}


@pytest.fixture(scope="module")
def graph():
    return crossing()


@pytest.fixture
def indicators(graph):
    return LiveIndicators(map_message(graph, ""), DT)


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
        assert indicators.lights(vehicles([lane]), 0).tolist() == [0]
    assert indicators.lights(vehicles([]), 1).tolist() == []


def test_it_is_shown_as_long_as_in_recorded_episodes():
    assert AFTER_CHANGE == RECORDED_AFTER_CHANGE


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
