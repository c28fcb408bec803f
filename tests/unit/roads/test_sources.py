import pytest

from smarts.errors import MapError
from smarts.roads.sources import find_map_source
from tests.raising import raises


def names(source):
    return source.kind, [file.name for file in source.files]


def touch(folder, *files):
    folder.mkdir(exist_ok=True)
    for file in files:
        (folder / file).touch()
    return folder


@pytest.mark.parametrize(
    ("files", "kind"),
    [
        (["map.net.xml"], "sumo_net"),
        (["map.nod.xml", "map.edg.xml", "map.con.xml", "map.tll.xml", "map.netccfg"], "sumo_plain"),
        (["map.netgcfg"], "netgenerate"),
        (["map.xodr", "map.netccfg"], "opendrive"),
        (["map.osm"], "osm"),
        (["map.osm.xml"], "osm"),
    ],
)
def test_all_files_of_each_kind(tmp_path, files, kind):
    assert names(find_map_source(touch(tmp_path, *files, "other.xodr"))) == (kind, files)


def test_a_compiled_net_wins(tmp_path):
    touch(tmp_path, "map.net.xml", "map.nod.xml", "map.edg.xml", "map.xodr")
    assert find_map_source(tmp_path).kind == "sumo_net"


def test_source_as_stem_file_folder_and_absolute_path(tmp_path):
    touch(tmp_path, "map.net.xml", "wide.nod.xml", "wide.edg.xml")
    maps = touch(tmp_path / "maps", "town.osm")
    assert names(find_map_source(tmp_path, "wide")) == ("sumo_plain", ["wide.nod.xml", "wide.edg.xml"])
    assert names(find_map_source(tmp_path, "wide.edg.xml")) == (
        "sumo_plain",
        ["wide.nod.xml", "wide.edg.xml"],
    )
    assert names(find_map_source(tmp_path, "maps")) == ("osm", ["town.osm"])
    assert names(find_map_source(tmp_path, "maps/town")) == ("osm", ["town.osm"])
    assert names(find_map_source(tmp_path, str(maps / "town.osm"))) == ("osm", ["town.osm"])


@pytest.mark.parametrize("source", [None, "nothing"])
def test_missing_map_says_what_was_looked_for(tmp_path, source):
    touch(tmp_path, "map.nod.xml")
    with raises(MapError, values=[".net.xml", ".nod.xml", ".edg.xml", ".xodr", ".osm"]):
        find_map_source(tmp_path, source)


def test_a_file_of_another_kind(tmp_path):
    touch(tmp_path, "map.png")
    with raises(MapError, values=["map.png"]):
        find_map_source(tmp_path, "map.png")


def test_folder_with_several_maps(tmp_path):
    touch(tmp_path, "a.xodr", "b.osm")
    with raises(MapError, values=["a, b"]):
        find_map_source(tmp_path, ".")
