"""Maps that SUMO refuses, crashes on or cannot write whole, and those beyond the world's end."""

import os
import re
import shutil

import pytest

from smarts.errors import MapError
from smarts.roads.children import TIME_LIMIT_VARIABLE
from smarts.roads.compile import compile_map
from smarts.roads.sources import find_map_source
from tests.raising import raises

from . import maps


def refused(folder):
    with raises(MapError, values=[folder / "map.net.xml"]) as caught:
        compile_map(find_map_source(folder), folder / "out.net.xml")
    assert not (folder / "out.net.xml").exists()
    return caught.value


def test_eastings_with_the_number_of_the_zone(nets, tmp_path):
    pattern, far = r'(<lane [^>]*shape=")[^ ]*', r"\g<1>32690000.25,5336000.25"
    (tmp_path / "map.net.xml").write_text(re.sub(pattern, far, nets["cross"].read_text(), count=1))
    error = refused(tmp_path)
    assert "32690000.25" in error.problem
    assert "offset" in error.remedy


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


@pytest.fixture
def unlinked(nets, tmp_path):
    """A network without connections, on which SUMO crashes: its junctions wait for links that are gone."""
    text = re.sub(r"<connection [^>]*/>", "", nets["cross"].read_text())
    (tmp_path / "map.net.xml").write_text(text)
    return tmp_path


def test_a_map_that_crashes_sumo_is_an_error_of_the_map(unlinked):
    error = refused(unlinked)
    assert error.problem == "SUMO crashes on the map (SIGSEGV)"
    assert "netconvert" in error.remedy


def test_a_map_that_takes_too_long_names_the_limit_and_how_to_raise_it(nets, tmp_path, monkeypatch):
    shutil.copy(nets["cross"], tmp_path / "map.net.xml")
    monkeypatch.setenv(TIME_LIMIT_VARIABLE, "0.0001")
    error = refused(tmp_path)
    assert "0.0001 s" in error.problem
    assert TIME_LIMIT_VARIABLE in error.remedy


def test_what_sumo_says_of_a_map_that_it_refuses(nets, tmp_path):
    text = nets["cross"].read_text().replace('<request index="0"', '<request index="x"', 1)
    (tmp_path / "map.net.xml").write_text(text)
    assert refused(tmp_path).problem.startswith("SUMO refuses the map: Attribute 'index'")
