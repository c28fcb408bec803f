"""A scenario file of SMARTS 2 on a data set of Argoverse, by a stub of it."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from smarts.recordings.log import Log
from smarts.sstudio.build import build_scenario
from smarts.types.vehicles import VehicleKind

SCENARIO = """
from pathlib import Path
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

scenario_id = "0a53"
scenario_path = Path(__file__).parent / "data" / scenario_id
ego_mission = [
    t.Mission(
        t.Route(begin=("road-1-2", 1, 6.7), end=("road-4", 0, 4.2)),
        entry_tactic=t.IdEntryTactic(start_time=0.1, actor_id="history-vehicle-5717"),
    )
]
name = f"argoverse_{scenario_id}"
traffic_histories = [t.TrafficHistoryDataset(name, source_type="Argoverse", input_path=scenario_path)]
gen_scenario(
    t.Scenario(
        ego_missions=ego_mission,
        map_spec=t.MapSpec(source=f"{scenario_path}", lanepoint_spacing=1.0),
        traffic_histories=traffic_histories,
        scenario_metadata=t.ScenarioMetadata(scenario_difficulty=0.3, scenario_duration=11),
    ),
    output_dir=Path(__file__).parent,
)
"""


def segment(name, x, right, neighbours, marks, after=()):
    """Return a lane segment of 100 m to the east from x on; neighbours and marks are left and right."""
    bounds = [[{"x": x + d, "y": y, "z": 0.0} for d in (0, 100)] for y in (right + 3.5, right)]
    sides = ("left", "right")
    found = {f"{side}_lane_boundary": bound for side, bound in zip(sides, bounds, strict=True)}
    found |= {f"{side}_neighbor_id": each for side, each in zip(sides, neighbours, strict=True)}
    found |= {f"{side}_lane_mark_type": each for side, each in zip(sides, marks, strict=True)}
    return found | {"id": name, "is_intersection": False, "lane_type": "VEHICLE", "successors": [*after]}


def write_stub(folder):
    """Write two lanes side by side, an oncoming one behind a yellow line, and a lane that they lead to."""
    folder.mkdir(parents=True)
    yellow, white, dashed = "SOLID_YELLOW", "SOLID_WHITE", "DASHED_WHITE"
    segments = [
        segment(1, 0.0, 0.0, (2, None), (dashed, white)),
        segment(2, 0.0, 3.5, (3, 1), (yellow, dashed), after=(4, 99)),
        segment(3, 0.0, 7.0, (2, None), (yellow, white)),
        segment(4, 100.0, 3.5, (None, None), (yellow, white)),
    ]
    found = {"lane_segments": {str(each["id"]): each for each in segments}}
    (folder / "log_map_archive_0a53.json").write_text(json.dumps(found))
    kinds = {"5717": "vehicle", "8": "cyclist", "9": "background", "AV": "vehicle"}
    steps = np.arange(110)
    rows = [
        {"track_id": name, "object_type": kind, "timestep": k, "position_x": 5.0 + 20.0 * place + 0.5 * k}
        for place, (name, kind) in enumerate(kinds.items())
        for k in steps.tolist()
    ]
    still = {"position_y": 5.25, "heading": 0.0, "velocity_x": 3.0, "velocity_y": 4.0}
    pq.write_table(pa.Table.from_pylist([row | still for row in rows]), folder / "scenario_0a53.parquet")


def test_a_scenario_of_argoverse_is_built_and_has_its_vehicles(tmp_path):
    write_stub(tmp_path / "data" / "0a53")
    (tmp_path / "scenario.py").write_text(SCENARIO)
    built = build_scenario(tmp_path)
    roads = built.roads()
    assert {"road-1-2", "road-3", "road-4"} == {edge for edge in roads.edge_ids if not edge.startswith(":")}
    log = Log.load(built.traffic["argoverse_0a53"].recording.log)
    kinds = dict(zip(log.names, log.paths.kind.tolist(), strict=True))
    car, bicycle = VehicleKind.PASSENGER, VehicleKind.BICYCLE
    assert kinds == {"5717": car, "8": bicycle, "5718": car}  # the recording vehicle is the last
    first = log.paths.sample[:-1]
    assert sorted(log.paths.x[first].tolist()) == [5.0, 25.0, 65.0]
    assert log.paths.speed.tolist() == [5.0] * 330
    file = tmp_path / "data" / "0a53" / "scenario_0a53.parquet"
    pq.write_table(pq.read_table(file).slice(0, 220), file)
    built = build_scenario(tmp_path)
    assert len(Log.load(built.traffic["argoverse_0a53"].recording.log).names) == 2
