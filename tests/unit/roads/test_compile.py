import itertools
import shutil
import subprocess
from pathlib import Path

import pytest
import sumo

from smarts.errors import MapError
from smarts.roads.compile import MapNotes, compile_map
from smarts.roads.lane_graph import LaneKind
from smarts.roads.routes import shortest_route
from smarts.roads.sources import find_map_source
from smarts.roads.sumo_net import read_net
from tests.raising import raises

from . import maps

DATA = Path(__file__).parents[2] / "data"


def compiled(folder, out=None):
    out = out or folder / "out.net.xml"
    return out, compile_map(find_map_source(folder), out)


def error_of(folder):
    with pytest.raises(MapError) as caught:
        compiled(folder)
    assert not (folder / "out.net.xml").exists()
    assert [file.name for file in folder.iterdir() if file.name.startswith(".")] == []
    return caught.value


def test_same_sources_give_same_bytes_anywhere(tmp_path):
    name = "city"
    one, _ = compiled(maps.write(tmp_path / "one", **maps.MAPS[name]))
    two, _ = compiled(
        maps.write(tmp_path / "deeper" / "two", **maps.MAPS[name]), tmp_path / "new" / "net.xml"
    )
    assert one.read_bytes() == two.read_bytes()
    assert b"generated on" not in one.read_bytes()
    assert str(tmp_path).encode() not in one.read_bytes()


def test_a_compiled_net_is_copied(tmp_path, nets):
    folder = maps.write(tmp_path)
    shutil.copy(nets["cross"], folder / "map.net.xml")
    out, notes = compiled(folder)
    assert out.read_bytes() == nets["cross"].read_bytes()
    assert notes == MapNotes()


def test_plain_sources_have_no_turnarounds_unless_asked_for(tmp_path, cross):
    with raises(MapError, values=["west_in", "west_out"]):
        shortest_route(cross, "west_in", "west_out")
    options = '<configuration><no-turnarounds value="false"/></configuration>'
    out, _ = compiled(maps.write(tmp_path, netccfg=options, **maps.cross()))
    assert shortest_route(read_net(out), "west_in", "west_out") == ("west_in", "west_out")


def test_warnings_become_notes_once_and_without_paths(tmp_path):
    sources = maps.cross()
    hairpin = '<edge id="west_out" shape="0,0 -50,0 -20,1 -100,0" '
    sources["edg"] = sources["edg"].replace('<edge id="west_out" ', hairpin)
    _, notes = compiled(maps.write(tmp_path, **sources))
    assert any("angle" in note and "west_out" in note for note in notes.remarks)
    assert len(set(notes.remarks)) == len(notes.remarks)
    assert not any(str(tmp_path) in note or "SUMO_HOME" in note for note in notes.remarks)
    assert notes.warnings == ()


def test_opendrive(tmp_path):
    shutil.copy(DATA / "bend.xodr", tmp_path / "map.xodr")
    out, notes = compiled(tmp_path)
    graph = read_net(out)
    ahead = [graph.lane_number("-1", index) for index in range(3)]
    assert [LaneKind(graph.kind[lane]) for lane in ahead] == [LaneKind.SHOULDER, LaneKind.CAR, LaneKind.CAR]
    assert graph.width[ahead].tolist() == [1.5, 3.25, 3.5]
    assert graph.pose_at(ahead[2], 10.0) == pytest.approx((10, -1.75, 0), abs=1e-2)
    # The inner lane of a left bend of 0.8 rad on a radius of 50 m.
    back = graph.lane_number("1", 1)
    assert graph.length[back] == pytest.approx(60 + 0.8 * (50 - 1.75), abs=0.1)
    assert notes == MapNotes()


def test_osm(tmp_path):
    shutil.copy(DATA / "village.osm", tmp_path / "map.osm")
    out, notes = compiled(tmp_path)
    graph = read_net(out)
    assert {edge.lstrip("-").split("#")[0] for edge in graph.road_edges} == {"100", "101"}
    assert graph.speed_limit[graph.lane_number("101", 0)] == pytest.approx(30 / 3.6, abs=0.01)
    assert shortest_route(graph, "101", "-101") == ("101", "-101")
    assert notes == MapNotes(remarks=("dropped 1 of 3 ways with highway: 1 footway",))


def osm_of(folder, highway, more=""):
    text = (DATA / "village.osm").read_text().replace('v="residential"', f'v="{highway}"{more}')
    (folder / "map.osm").write_text(text.replace('v="primary"', f'v="{highway}"'))
    return folder


@pytest.mark.parametrize("highway", ["service", "busway"])
def test_osm_roads_that_are_closed_to_cars(tmp_path, highway):
    error = error_of(osm_of(tmp_path, highway))
    if highway == "busway":  # which buses use
        assert "none of the map's" in error.problem
    else:
        assert "dropped 3 of 3 ways with highway" in error.problem
        assert f"2 {highway}" in error.problem


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ({"xodr": "<OpenDRIVE><road"}, r"map\.xodr: netconvert refused the map: .*unexpected end of input"),
        ({"osm": "<osm></osm>"}, "No nodes loaded"),
        ({"net": "<net></net>"}, "none of the map's 0 lanes is open to cars"),
        ({"net": "<routes></routes>"}, "outermost element is <routes>"),
        ({"net": '<net lefthand="true"></net>'}, "keeps to the left"),
        ({"net": "not xml"}, "not a SUMO network: syntax error"),
    ],
)
def test_broken_sources(tmp_path, files, message):
    folder = tmp_path
    for suffix, text in files.items():
        ending = f"{suffix}.xml" if suffix in ("nod", "edg", "net") else suffix
        (folder / f"map.{ending}").write_text(text)
    error = error_of(folder)
    with pytest.raises(MapError, match=message):
        raise error
    assert str(folder) in error.place
    assert str(folder) not in error.problem
    assert error.remedy


KEPT = '<offset.disable-normalization value="true"/></configuration>'


def without_insides(folder):
    """Return the folder of a network of a crossing without lanes inside it."""
    options = '<configuration><no-internal-links value="true"/>' + KEPT
    plain = maps.write(folder / "plain", netccfg=options, **maps.cross())
    tool = str(Path(sumo.SUMO_HOME) / "bin" / "netconvert")
    files = ["--node-files", "map.nod.xml", "--edge-files", "map.edg.xml", "-c", "map.netccfg"]
    subprocess.run([tool, *files, "-o", str(folder / "map.net.xml")], cwd=plain, check=True)
    return folder


def test_lanes_inside_junctions_are_built_where_a_net_has_none(tmp_path, cross):
    folder = without_insides(tmp_path)
    out, notes = compiled(folder)
    graph = read_net(out)
    assert set(graph.road_edges) == set(cross.road_edges)
    for begin, end in itertools.permutations(maps.ARMS, 2):
        way = (f"{begin}_in", f"{end}_out")
        assert shortest_route(graph, *way) == way
    lane = graph.lane_number("west_in", 0)
    assert graph.pose_at(lane, 0.0) == pytest.approx(cross.pose_at(cross.lane_number("west_in", 0), 0.0))
    (warning,) = notes.warnings
    assert "1 junctions" in warning
    assert "'centre'" in warning


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [('to="north_out"', 'to="nowhere"', "no edge 'nowhere'"), ('via="', 'via=":gone', "no lane ':gone")],
)
def test_bad_links_of_a_net_are_left_out(tmp_path, nets, old, new, problem):
    """SUMO itself refuses such a network, or crashes where the link is merely removed."""
    lines = nets["cross"].read_text().splitlines(keepends=True)
    at = next(n for n, line in enumerate(lines) if '<connection from="west_in" to="north_out"' in line)
    lines[at] = lines[at].replace(old, new)
    (tmp_path / "map.net.xml").write_text("".join(lines))
    out, notes = compiled(tmp_path)
    graph = read_net(out)
    assert set(graph.road_edges) == set(read_net(nets["cross"]).road_edges)
    assert shortest_route(graph, "west_in", "east_out") == ("west_in", "east_out")
    (warning,) = notes.warnings
    assert warning.startswith("left out 1 of ")
    assert "'west_in_" in warning
    assert problem in warning
    command = [str(Path(sumo.SUMO_HOME) / "bin" / "sumo"), "-n", str(out), "--end", "3", "--no-step-log"]
    subprocess.run(command, check=True)


LOOSE = """<junction id="50" name="loose">
    <connection id="0" incomingRoad="2" connectingRoad="3" contactPoint="start">
        <laneLink from="-1" to="-1"/><laneLink from="-2" to="-2"/>
    </connection></junction></OpenDRIVE>"""


def opendrive(folder, *changes):
    text = (DATA / "bend.xodr").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "map.xodr").write_text(text)
    return folder


def test_bad_links_of_a_foreign_map_are_left_out(tmp_path):
    out, notes = compiled(opendrive(tmp_path, ("</OpenDRIVE>", LOOSE)))
    assert set(read_net(out).road_edges) == {"1", "-1"}
    (warning,) = notes.warnings
    assert warning.startswith("left out 1 connections with 2 lane links")
    assert "junction '50', road '2' to '3'" in warning


def test_what_netconvert_fails_on_in_opendrive_without_need(tmp_path):
    signal = '<signal id="{}" s="1" t="2" type="{}" orientation="+" dynamic="no"/>'
    signals = f"<signals>{signal.format(7, '')}{signal.format(8, 294)}</signals>"
    direct = """<junction id="8" type="direct">
        <connection id="0" incomingRoad="1" linkedRoad="4" contactPoint="start">
            <laneLink from="-1" to="-1"/></connection></junction></OpenDRIVE>"""
    out, notes = compiled(
        opendrive(
            tmp_path,
            ("<line/>", '<arc curvature="0.0"/>'),
            ("</road>", f"{signals}</road>"),
            ("</OpenDRIVE>", direct),
        )
    )
    assert read_net(out).pose_at(read_net(out).lane_number("-1", 2), 10.0)[:2] == pytest.approx(
        (10, -1.75), abs=1e-2
    )
    untyped, connections = notes.warnings
    assert "1 signals" in untyped
    assert "'7'" in untyped
    assert "'8'" not in untyped
    assert "1 connections" in connections
    assert "junction '8', road '1' to '4'" in connections


def test_left_hand_traffic_in_opendrive(tmp_path):
    error = error_of(opendrive(tmp_path, ('junction="-1"', 'junction="-1" rule="LHT"')))
    assert "to the left" in error.problem
    assert "road '1'" in error.place
