"""Roads whose length as given is not that of their shape: SUMO drives the shape's."""

import numpy as np
import pytest

from smarts.geometry.boxes import boxes_overlap
from smarts.providers.sumo_traffic import SumoTraffic
from smarts.sstudio import types as t
from smarts.sstudio.build import build_described
from smarts.types.vehicles import Owner, VehicleKind
from smarts.types.world import World

SHAPE = 200.0
"""Length of the first road [m]."""


def build(folder, given: float):
    """Return a scenario on two straight roads, the first of which is given a length [m]."""
    (folder / "map.nod.xml").write_text(
        '<nodes><node id="a" x="0" y="0"/><node id="b" x="200" y="0"/><node id="c" x="400" y="0"/></nodes>'
    )
    (folder / "map.edg.xml").write_text(
        f'<edges><edge id="ab" from="a" to="b" speed="13.9" length="{given}"/>'
        '<edge id="bc" from="b" to="c" speed="13.9"/></edges>'
    )
    route = t.Route(begin=("ab", 0, given / 4), end=("bc", 0, 150))
    flow = t.Flow(route=route, rate=1200, actors={t.TrafficActor("car"): 1.0})
    return build_described(folder, t.Scenario(traffic={"basic": t.Traffic(flows=[flow])}))


@pytest.mark.parametrize("given", [600.0, 67.0])
def test_traffic_stops_behind_a_vehicle_that_stands(tmp_path, given):
    built = build(tmp_path, given)
    world = World(worlds=1, capacity=64, agents=0, lanes=len(built.roads().lane_ids))
    states = world.vehicles.of(0)
    agent = world.registry.admit(0, "agent", Owner.AGENT, VehicleKind.PASSENGER, 4.5, 1.8)
    states.position[agent] = 150.0, -1.6
    traffic, nearest, entries = SumoTraffic(world, 0), np.inf, []
    traffic.reset(built.traffic["basic"], 7, built.roads())
    for _ in range(300):
        new = states.alive.copy()
        world.advance(np.ones(1, np.bool_))
        traffic.step()
        entries += (states.position[states.alive & ~new, 0] + states.length[states.alive & ~new] / 2).tolist()
        rows = np.flatnonzero(states.alive)
        boxes = states.position[rows], states.heading[rows], np.stack([states.length, states.width], -1)[rows]
        overlap = boxes_overlap(*(each[:, None] for each in boxes), *boxes)
        assert not overlap[~np.eye(len(rows), dtype=bool)].any()
        behind = states.position[agent, 0] - states.position[rows, 0]
        nearest = min(nearest, behind[behind > 0].min(initial=np.inf))
    traffic.close()
    # A car of 5 m stands 2.5 m behind, within what SUMO's drivers leave beyond that.
    assert 2.25 + 2.5 + 2.0 < nearest < 2.25 + 2.5 + 5.0
    # They enter at a quarter of the road.
    assert entries[0] == pytest.approx(SHAPE / 4, abs=1.0)
    assert any("1 lanes are given a length" in note for note in built.notes) == (given != SHAPE)
