import shutil
from pathlib import Path

import pytest

from smarts.roads.compile import compile_map
from smarts.roads.sources import find_map_source
from smarts.roads.sumo_net import read_net
from smarts.sstudio.build import build_scenario

from . import sources


@pytest.fixture(scope="session")
def cross_net(tmp_path_factory) -> Path:
    """The compiled network of a crossing of two-lane roads, about 100 m to each of four sides."""
    folder = sources.write_cross(tmp_path_factory.mktemp("cross"))
    net = folder / "compiled.net.xml"
    compile_map(find_map_source(folder), net)
    return net


@pytest.fixture(scope="session")
def roads(cross_net):
    return read_net(cross_net)


@pytest.fixture(scope="session")
def ring_net(tmp_path_factory) -> Path:
    """The compiled network of a square ring of one lane: edges south, east, north, west."""
    folder = sources.write_ring(tmp_path_factory.mktemp("ring"))
    net = folder / "compiled.net.xml"
    compile_map(find_map_source(folder), net)
    return net


@pytest.fixture(scope="session")
def ring(ring_net):
    return read_net(ring_net)


@pytest.fixture(scope="session")
def fork(tmp_path_factory):
    """The road that forks, of `sources.write_fork`."""
    folder = sources.write_fork(tmp_path_factory.mktemp("fork"))
    compile_map(find_map_source(folder), folder / "compiled.net.xml")
    return read_net(folder / "compiled.net.xml")


@pytest.fixture
def scenario_folder(tmp_path):
    """Return a function that makes a scenario folder on the crossing from the text of its scenario file."""

    def make(script: str | None = sources.SCRIPT, name: str = "cross", **files: str) -> Path:
        folder = sources.write_cross(tmp_path / name)
        if script is not None:
            (folder / "scenario.py").write_text(script)
        for stem, text in files.items():
            (folder / f"{stem}.py").write_text(text)
        return folder

    return make


@pytest.fixture(scope="session")
def _built_once(tmp_path_factory):
    folder = sources.write_cross(tmp_path_factory.mktemp("built") / "cross")
    (folder / "scenario.py").write_text(sources.SCRIPT)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder.parent / "cache"))
        build_scenario(folder)
    return folder


@pytest.fixture
def built_folder(_built_once, tmp_path) -> Path:
    """A scenario folder of one's own that was built already: `sources.SCRIPT` on the crossing."""
    return Path(shutil.copytree(_built_once, tmp_path / "cross"))


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture(scope="session")
def long_roads(tmp_path_factory):
    """A straight road from (0, 0) over (100, 0) to (200, 0) whose first half SUMO takes for 200 m long."""
    folder = tmp_path_factory.mktemp("long")
    nodes = "".join(f'<node id="{name}" x="{x}" y="0"/>' for name, x in (("a", 0), ("b", 100), ("c", 200)))
    edges = '<edge id="one" from="a" to="b" length="200"/><edge id="two" from="b" to="c"/>'
    (folder / "map.nod.xml").write_text(f"<nodes>{nodes}</nodes>")
    (folder / "map.edg.xml").write_text(f"<edges>{edges}</edges>")
    compile_map(find_map_source(folder), folder / "compiled.net.xml")
    return read_net(folder / "compiled.net.xml")
