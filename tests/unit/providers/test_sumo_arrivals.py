"""Where vehicles arrive, as their route files say; it survives a replacement of the vehicle in SUMO."""

import gzip

import numpy as np
import pytest

from smarts.providers.sumo_arrivals import SumoArrivals
from smarts.types.vehicles import Owner

from .test_hand_over import begin_lane_change
from .test_sumo_shadows import drive

ROUTES = """<routes>
  <vehicle id="a" depart="0" arrivalPos="12.5" arrivalSpeed="3"><route edges="ab"/></vehicle>
  <trip id="b.1" depart="0" from="ab" to="bc" arrivalLane="1"/>
  <flow id="c" begin="0" end="9" number="3" from="ab" to="bc" arrivalPos="random" arrivalLane="0"/>
  <flow id="b" begin="0" end="9" number="3" from="ab" to="bc" arrivalPos="40"/>
  <vehicle id="d" depart="0"><route edges="ab"/></vehicle>
</routes>"""


@pytest.mark.parametrize("suffix", [".rou.xml", ".rou.xml.gz"])
def test_arrivals_are_those_of_the_vehicle_or_of_its_flow(tmp_path, suffix):
    file = tmp_path / f"some{suffix}"
    file.write_bytes(gzip.compress(ROUTES.encode()) if suffix.endswith("gz") else ROUTES.encode())
    arrivals = SumoArrivals([file])
    expected = {
        "a": {"arrivalPos": "12.5", "arrivalSpeed": "3"},
        "b.1": {"arrivalLane": "1"},  # the trip's own, not the flow's
        "b.0": {"arrivalPos": "40"},
        "c.2": {"arrivalLane": "0"},  # what SUMO drew is not known
        "d": {},
        "unknown": {},
    }
    assert {name: dict(arrivals.of(name)) for name in expected} == expected


def test_a_vehicle_taken_over_during_a_lane_change_arrives_where_it_was_to(world, country, monkeypatch):
    files = country.road

    def with_arrival(routes, *more):
        return files(routes.replace('<vehicle id="s1"', '<vehicle id="s1" arrivalPos="300"'), *more)

    monkeypatch.setattr(country, "road", with_arrival)
    slot = begin_lane_change(world, country)
    world.states.owner[slot] = Owner.AGENT
    start, y = world.states.position[slot].tolist()
    drive(world, slot, lambda t: (start + 2 * t, y, 0.0, 2.0), 5)
    assert world.traffic._ids[slot] != "s1"
    world.registry.dismiss(0, world.slot("s0"))
    world.states.owner[slot] = Owner.TRAFFIC
    end = float(world.states.position[slot, 0])
    for _ in range(1500):
        world.step()
        if not world.states.alive[slot]:
            break
        end = float(world.states.position[slot, 0])
    assert not world.states.alive[slot]
    assert np.isclose(end, 1300.0, atol=10.0), "300 m into the second edge, which begins at 1000 m"
