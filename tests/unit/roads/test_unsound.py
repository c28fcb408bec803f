"""Maps with numbers that make no road, or with names given twice, are refused by name."""

import os
import re
import shutil
from pathlib import Path

import pytest

from smarts.errors import MapError
from smarts.roads.children import MEMORY_LIMIT_VARIABLE, TIME_LIMIT_VARIABLE
from smarts.roads.compile import compile_map
from smarts.roads.packing import pack_roads
from smarts.roads.sources import MapSource, find_map_source
from smarts.roads.sumo_net import read_net
from tests.raising import raises

from . import maps

DATA = Path(__file__).parents[2] / "data"
CHANGES = {
    "nan speed": (r'speed="[^"]*"', 'speed="nan"', "speed='nan'"),
    "negative speed": (r'speed="[^"]*"', 'speed="-1"', "speed='-1'"),
    "no speed": (r'speed="[^"]*"', "", "speed=''"),
    "length": (r' length="[^"]*"', ' length="0"', "length='0'"),
    "nan in a shape": (r'(<lane [^>]*shape=")[^ ]*', r"\1nan,nan", "nan,nan"),
    "half a point": (r'(<lane [^>]*shape=")[^ ]*', r"\g<1>3", "'3'"),
    "the zone before an easting": (
        r'(<lane [^>]*shape=")[^ ]*',
        r"\g<1>32690000.25,5336000.25",
        "32690000.25,5336000.25",
    ),
    "a connector": ('edge id="east_out"', 'edge id="east_out" function="connector"', "'connector'"),
    "twin edges": ('edge id="east_out"', 'edge id="west_out"', "west_out"),
    "twin lanes": ('lane id="east_out_0"', 'lane id="west_out_0"', "west_out_0"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_nets(nets, tmp_path, change):
    pattern, replacement, value = CHANGES[change]
    text, count = re.subn(pattern, replacement, nets["cross"].read_text(), count=1)
    assert count == 1
    net = tmp_path / "map.net.xml"
    net.write_text(text)
    with raises(MapError, values=[value]) as caught:
        compile_map(find_map_source(tmp_path), tmp_path / "out.net.xml")
    assert caught.value.place.startswith(str(net))
    assert caught.value.remedy
    assert not (tmp_path / "out.net.xml").exists()


@pytest.mark.parametrize(
    ("pattern", "replacement", "value"),
    [
        (r'<geometry([^>]*) length="[^"]*"', r'<geometry\1 length="nan"', "length='nan'"),
        (r'<road([^>]*) length="[^"]*"', r'<road\1 length="-100"', "length='-100'"),
        (r'<width([^>]*) a="[^"]*"', r'<width\1 a="-3.5"', "a='-3.5'"),
        (r'<geometry([^>]*) hdg="[^"]*"', r'<geometry\1 hdg="x"', "hdg='x'"),
    ],
)
def test_opendrive(tmp_path, pattern, replacement, value):
    text, count = re.subn(pattern, replacement, (DATA / "bend.xodr").read_text(), count=1)
    assert count == 1
    (tmp_path / "map.xodr").write_text(text)
    with raises(MapError, values=[value]) as caught:
        compile_map(find_map_source(tmp_path), tmp_path / "out.net.xml")
    assert caught.value.place.startswith(f"{tmp_path / 'map.xodr'}: road '")


def test_names_with_commas(tmp_path):
    shutil.copy(DATA / "village.osm", tmp_path / "vil,lage.osm")
    with raises(MapError, tmp_path / "vil,lage.osm") as caught:
        compile_map(find_map_source(tmp_path, "vil,lage.osm"), tmp_path / "out.net.xml")
    assert caught.value.remedy == "rename the file"


def test_folders_with_commas(tmp_path):
    out = tmp_path / "b,c" / "out.net.xml"
    compile_map(find_map_source(maps.write(tmp_path / "a,b", **maps.cross())), out)
    assert read_net(out).road_edges


def test_files_that_are_gone(tmp_path):
    gone = MapSource("osm", (tmp_path / "map.osm",))
    with raises(MapError, tmp_path / "map.osm"):
        compile_map(gone, tmp_path / "out.net.xml")


def test_errors_name_what_the_user_wrote(tmp_path):
    (tmp_path / "net").write_text("<net><connection/></net>")
    with pytest.raises(MapError) as caught:
        read_net(tmp_path / "net", place="map.osm")
    assert caught.value.place == "map.osm"


def test_half_a_network_is_noticed(tmp_path, monkeypatch):
    """On a full disk netconvert writes half a file and reports success."""
    tool = tmp_path / "sumo" / "bin" / "netconvert"
    tool.parent.mkdir(parents=True)
    tool.write_text('#!/bin/sh\nwhile [ "$1" != --output-file ]; do shift; done; echo "<net><edge" > "$2"\n')
    os.chmod(tool, 0o755)
    monkeypatch.setattr("smarts.roads.sumo_tools.sumo_folder", lambda: tmp_path / "sumo")
    folder = maps.write(tmp_path / "maps", **maps.cross())
    with raises(MapError, folder / "map.nod.xml", values=[tmp_path / "out"]) as caught:
        compile_map(find_map_source(folder), tmp_path / "out" / "net.xml")
    assert caught.value.remedy == "make room on that disk"
    assert list((tmp_path / "out").iterdir()) == []


def test_files_named_in_options_belong_to_the_map(tmp_path):
    folder = maps.write(tmp_path, **maps.cross())
    for name in ("roads.typ.xml", "more.typ.xml"):
        (folder / name).write_text("<types/>")
    value = "roads.typ.xml, more.typ.xml,absent.typ.xml"
    (folder / "map.netccfg").write_text(f'<configuration><type-files value="{value}"/></configuration>')
    names = [file.name for file in find_map_source(folder).files]
    assert names[-3:] == ["map.netccfg", "roads.typ.xml", "more.typ.xml"]


@pytest.fixture
def unlinked(nets, tmp_path):
    """A network without connections, on which SUMO crashes: its junctions wait for links that are gone."""
    text = re.sub(r"<connection [^>]*/>", "", nets["cross"].read_text())
    (tmp_path / "map.net.xml").write_text(text)
    return tmp_path


def refused(folder):
    with raises(MapError, folder / "map.net.xml") as caught:
        compile_map(find_map_source(folder), folder / "out.net.xml")
    assert not (folder / "out.net.xml").exists()
    return caught.value


def test_a_map_that_crashes_sumo_is_an_error_of_the_map(unlinked):
    error = refused(unlinked)
    assert error.problem == "SUMO crashes on the map (SIGSEGV)"
    assert "netconvert" in error.remedy


@pytest.mark.parametrize(
    ("variable", "limit", "problem"),
    [
        (TIME_LIMIT_VARIABLE, "0.0001", "SUMO was still loading the map after 0.0001 s"),
        (MEMORY_LIMIT_VARIABLE, "0.1", "SUMO needs more than 0.1 GB of memory for the map"),
    ],
)
def test_a_map_that_takes_too_much_names_the_limit_and_how_to_raise_it(
    nets, tmp_path, monkeypatch, variable, limit, problem
):
    shutil.copy(nets["cross"], tmp_path / "map.net.xml")
    monkeypatch.setenv(variable, limit)
    error = refused(tmp_path)
    assert error.problem == problem
    assert variable in error.remedy


def test_what_sumo_says_of_a_map_that_it_refuses(nets, tmp_path):
    text = nets["cross"].read_text().replace('<request index="0"', '<request index="x"', 1)
    (tmp_path / "map.net.xml").write_text(text)
    assert refused(tmp_path).problem.startswith("SUMO refuses the map: Attribute 'index'")


def test_a_lane_as_wide_as_a_country_is_packed(nets, tmp_path):
    """The grid's cells grow with it: at 6 m each of its points would be listed in 10^11 of them."""
    text = re.sub(r'(<lane id="west_in_0"[^>]*) shape=', r'\1 width="1e6" shape=', nets["cross"].read_text())
    (tmp_path / "map.net.xml").write_text(text)
    compile_map(find_map_source(tmp_path), tmp_path / "out.net.xml")
    graph = read_net(tmp_path / "out.net.xml")
    assert graph.width.max() == 1e6
    assert len(pack_roads([graph]).run) < 64 * len(graph.point_s)
