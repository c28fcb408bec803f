"""SUMO's bicycles, from the scenario's file to the world."""

import shutil
from pathlib import Path

from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.build import build_scenario
from smarts.types.vehicles import VehicleKind

SCENARIO = """
from pathlib import Path
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

route = t.Route(("south_in", 0, "base"), ("north_out", 0, "max"))
actors = {t.TrafficActor("cyclist", vehicle_type="bicycle"): 1.0}
traffic = {"bicycles": t.Traffic([t.Flow(route, 600, actors=actors)])}
gen_scenario(t.Scenario(traffic=traffic), output_dir=Path(__file__).parent)
"""


def test_bicycles_have_their_kind_their_size_and_their_speed(tmp_path):
    for file in Path(build_scenario("intersection").source).glob("map.*.xml"):
        shutil.copy(file, tmp_path)
    (tmp_path / "scenario.py").write_text(SCENARIO)
    with traffic_run(build_scenario(tmp_path), "bicycles") as run:
        for _ in run.steps(20.0):
            pass
        v = run.states
        assert v.alive.sum() >= 2
        assert set(v.kind[v.alive].tolist()) == {VehicleKind.BICYCLE}
        assert v.length[v.alive].max() < 2.0
        assert 3.0 < v.speed[v.alive].max() < 7.0
