"""Scenarios of the Waymo Open Motion Dataset: small files by hand, in its encoding."""

import struct

import numpy as np
import pytest

from smarts.errors import MapError
from smarts.recordings.log import Log
from smarts.recordings.reading import Source, read
from smarts.recordings.tracks import RecordingError
from smarts.roads.lanelets import read_lanelets
from smarts.sstudio.build import build_scenario
from smarts.types.traffic import Signal
from smarts.types.vehicles import VehicleKind

SCENARIO = """
from pathlib import Path
from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

dataset_path = str(Path(__file__).absolute().parent / "x.tfrecord-00000-of-01000")
scenario_id = "b1"
traffic_histories = [
    t.TrafficHistoryDataset(
        name=f"waymo", source_type="Waymo", input_path=dataset_path, scenario_id=scenario_id
    )
]
gen_scenario(
    t.Scenario(
        map_spec=t.MapSpec(source=f"{dataset_path}#{scenario_id}", lanepoint_spacing=1.0),
        traffic_histories=traffic_histories,
    ),
    output_dir=Path(__file__).parent,
)
"""


def varint(value):
    low, rest = value & 127, value >> 7
    return bytes([low | 128]) + varint(rest) if rest else bytes([low])


def message(*fields):
    """Return a message of fields (number, value): whole numbers, doubles, `np.float32`, texts, messages."""
    parts = []
    for number, value in fields:
        value = value.encode() if isinstance(value, str) else value
        kind = {int: 0, float: 1, bytes: 2, np.float32: 5}[type(value)]
        parts.append(varint(number << 3 | kind))
        if kind == 0:
            parts.append(varint(value))
        elif kind == 2:
            parts += [varint(len(value)), value]
        else:
            parts.append(struct.pack("<d" if kind == 1 else "<f", value))
    return b"".join(parts)


def line(x, x_end, y):
    """Return the points of a line to the east, every half metre, as fields 8 and 2 have them."""
    points = np.arange(x, x_end + 0.1, 0.5).tolist()
    return [message((1, each), (2, float(y)), (3, 1.0)) for each in points]


def lane(name, points, *more, after=(), mph=25.0):
    """Return a map feature of a lane; the lanes that it leads to are packed."""
    fields = [(1, mph), (2, 2), *((8, each) for each in points), *more]
    fields += [(10, b"".join(map(varint, after)))] * bool(after)
    return message((1, name), (3, message(*fields)))


def beside(name, begin, end, its_begin, its_end):
    return message(*enumerate((name, begin, end, its_begin, its_end), 1))


def track(name, kind, x, y, valid):
    """Return a track of an object of 4 m that goes east at (3, 4) m/s, valid at some of three steps."""
    shape = [(5, np.float32(4)), (6, np.float32(2)), (8, np.float32(0.25))]
    speed = [(9, np.float32(3)), (10, np.float32(4))]
    states = [
        (
            3,
            message((2, x + k), (3, y), (4, 9.0), *shape, *speed, (11, 1))
            if k in valid
            else message((11, 0)),
        )
        for k in range(3)
    ]
    return message((1, name), (2, kind), *states)


def scenario(name):
    """Return lane 1, which has lane 2 on its left from 40 m on; 3 and 4 continue them. Lane 3 has a light."""
    edge = message((1, 20), (5, message((1, 1), *((2, each) for each in line(0, 100, -1.6)))))
    right = (14, message((1, 0), (2, 200), (3, 20)))
    features = [
        lane(1, line(0, 100, 0), (11, beside(2, 80, 200, 0, 120)), right, after=[3]),
        lane(2, line(40, 100, 3.5), (12, beside(1, 0, 120, 80, 200)), after=[4, 99]),
        lane(3, line(100, 200, 0), (11, beside(4, 0, 200, 0, 200)), mph=0.0),
        lane(4, line(100, 200, 3.5)),
        edge,
    ]
    lights = [message((1, message((1, 3), (2, state)))) if state else b"" for state in (4, 0, 3)]
    tracks = track(7, 1, 50.0, 0.5, (0, 1, 2)), track(300, 2, 60.0, -8.0, (1, 2)), track(9, 4, 0.0, 0.0, (0,))
    return message(
        *((1, 0.1 * k) for k in range(3)),
        *((2, each) for each in tracks),
        (5, name),
        (6, 0),
        *((7, each) for each in lights),
        *((8, each) for each in features),
    )


@pytest.fixture
def file(tmp_path):
    """Return a file of two scenarios."""
    path = tmp_path / "x.tfrecord-00000-of-01000"
    records = (scenario("a0"), scenario("b1"))
    path.write_bytes(b"".join(struct.pack("<QI", len(each), 0) + each + bytes(4) for each in records))
    return path


def test_road_users_and_signals(file):
    tracks = read(Source(file.with_name(f"{file.name}#b1")))
    assert (tracks.names, tracks.kind.tolist()) == (
        ("7", "300"),
        [VehicleKind.PASSENGER, VehicleKind.PEDESTRIAN],
    )
    assert (tracks.length.tolist(), tracks.width.tolist()) == ([4, 4], [2, 2])
    assert tracks.t.tolist() == pytest.approx([0, 0.1, 0.2, 0.1, 0.2])
    assert tracks.x.tolist() == [50, 51, 52, 61, 62]
    assert (set(tracks.heading.tolist()), set(tracks.speed.tolist())) == ({0.25}, {5.0})
    assert tracks.signals.tolist() == [
        [0, 100, 0, 200, 0, Signal.STOP],
        [pytest.approx(0.2), 100, 0, 200, 0, Signal.GO],
    ]
    assert (tracks.facts["name"], tracks.facts["left_out"]) == ("b1", "object of type 4 (1)")


def test_lanes_are_cut_where_they_are_side_by_side(file):
    found = {each.id: each for each in read_lanelets("waymo", file.with_name(f"{file.name}#a0"))}
    assert {name: (each.successors, each.left_neighbour) for name, each in found.items()} == {
        "1": (("1_80",), ""),
        "1_80": (("3",), "2"),
        "2": (("4",), ""),
        "3": ((), "4"),
        "4": ((), ""),
    }
    assert found["1_80"].left[[0, -1]] == pytest.approx(np.array([[40, 1.6], [100, 1.6]]))
    assert found["2"].right[0] == pytest.approx([40, 1.75])
    assert [each.lights for each in found.values()] == [(), ("3",), (), (), ()]
    assert (found["1"].speed, found["3"].speed) == pytest.approx((25 * 0.44704, 50 / 3.6))


def test_a_scenario_file_of_smarts_2_is_built(file, tmp_path):
    (tmp_path / "scenario.py").write_text(SCENARIO)
    built = build_scenario(tmp_path)
    roads = built.roads()
    edges = {edge for edge in roads.edge_ids if not edge.startswith(":")}
    assert edges == {"road-1", "road-1_80-2", "road-3-4"}
    recording = built.traffic["waymo"].recording
    assert recording is not None
    log = Log.load(recording.log)
    assert log.names == ("7", "300")
    assert log.lights[:, [0, 2]] == pytest.approx(np.array([[0, Signal.STOP], [0.2, Signal.GO]]))
    (lit,) = np.unique(log.lights[:, 1]).astype(int)
    assert roads.predecessors(lit).tolist() == [roads.lane_number("road-1_80-2", 0)]


def test_broken_files_are_refused(file, tmp_path):
    with pytest.raises(RecordingError, match=r"one of its 2 scenarios, as \S*#ID: a0, b1"):
        read(Source(file))
    with pytest.raises(MapError, match="one of its 2 scenarios"):
        read_lanelets("waymo", file.with_name(f"{file.name}#c2"))
    whole = file.read_bytes()
    file.write_bytes(whole[:-9])
    with pytest.raises(RecordingError, match="it ends in the middle of a record"):
        read(Source(file))
    size = struct.unpack("<Q", whole[:8])[0]
    file.write_bytes(struct.pack("<QI", size - 9, 0) + whole[12 : 12 + size - 9] + bytes(4))
    with pytest.raises(RecordingError, match="a message is broken"):
        read(Source(file))
