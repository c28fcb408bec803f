"""The moment that pictures of scenarios show is a reset."""

import shutil

import numpy as np
from shapely import Polygon

from smarts.envision.vehicle_shapes import footprints
from smarts.sim.moments import reset_moment
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.build import build_scenario
from smarts.types.vehicles import Owner

TRAFFIC = "random_social_vehicles"


def outlines(states):
    """Return the outline of each vehicle, by slot."""
    slots = np.flatnonzero(states.alive)
    columns = (states.heading, states.length, states.width)
    boxes = footprints(*states.position[slots].T, *(column[slots] for column in columns))
    return dict(zip(slots.tolist(), map(Polygon, boxes), strict=True))


def test_egos_are_placed_and_traffic_in_their_way_is_gone():
    seconds = 0.0
    built = build_scenario("roundabout")
    moment = reset_moment(built, TRAFFIC, seconds=seconds)
    boxes = outlines(moment.states)
    assert len(moment.egos) == 4
    assert all(moment.states.owner[slot] == Owner.AGENT for slot in moment.egos)
    for ego in moment.egos:
        assert not [other for other, box in boxes.items() if other != ego and box.intersects(boxes[ego])]
    with traffic_run(built, TRAFFIC) as run:
        for _ in run.steps(seconds):
            pass
        before = outlines(run.states)
    # Most of the traffic is as it was without egos, none is new, and some was in their way.
    places = [box.centroid.coords[0] for box in before.values()]
    rest = [box.centroid.coords[0] for slot, box in boxes.items() if slot not in moment.egos]
    assert 0 < len(rest) <= len(places)
    in_the_way = [box for box in before.values() if any(box.intersects(boxes[ego]) for ego in moment.egos)]
    assert len(places) - len(rest) >= len(in_the_way)
    assert in_the_way or seconds


def test_scenarios_without_missions_show_their_traffic(tmp_path):
    built = build_scenario(build_scenario("roundabout").net_file)
    moment = reset_moment(built, None)
    assert not moment.states.alive.any()
    assert moment.egos == ()


def test_missions_that_start_in_one_place_have_an_ego_in_turn(tmp_path):
    source = build_scenario("loop")
    shutil.copy(source.net_file, tmp_path / "map.net.xml")
    edge = max(source.roads().road_edges, key=len)
    place = f"({edge!r}, 0, 20)"
    (tmp_path / "scenario.py").write_text(
        "from smarts.sstudio import gen_scenario, types as t\n"
        f"missions = [t.EndlessMission({place}), t.EndlessMission({place}, start_time=0.05)]\n"
        "gen_scenario(t.Scenario(ego_missions=missions), output_dir='.')\n"
    )
    moment = reset_moment(build_scenario(tmp_path), None)
    assert sorted(slot >= 0 for slot in moment.egos) == [False, True]
