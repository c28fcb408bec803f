import shutil
from pathlib import Path

import pytest

from smarts.roads.compile import compile_map
from smarts.roads.sources import find_map_source
from smarts.roads.sumo_net import read_net
from smarts.sstudio.build import build_scenario

from . import sources


@pytest.fixture(scope="session")
def compiled(tmp_path_factory):
    """Return a function that writes a map's sources by another one, and compiles them."""

    def compile_sources(write) -> Path:
        folder = write(tmp_path_factory.mktemp("map"))
        compile_map(find_map_source(folder), folder / "compiled.net.xml")
        return folder / "compiled.net.xml"

    return compile_sources


@pytest.fixture(scope="session")
def cross_net(compiled) -> Path:
    """The compiled network of a crossing of two-lane roads, about 100 m to each of four sides."""
    return compiled(sources.write_cross)


@pytest.fixture(scope="session")
def roads(cross_net):
    return read_net(cross_net)


@pytest.fixture(scope="session")
def ring_net(compiled) -> Path:
    """The compiled network of a square ring of one lane: edges south, east, north, west."""
    return compiled(sources.write_ring)


@pytest.fixture(scope="session")
def ring(ring_net):
    return read_net(ring_net)


@pytest.fixture(scope="session")
def fork(compiled):
    """The road that forks, of `sources.write_fork`."""
    return read_net(compiled(sources.write_fork))


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
def long_roads(compiled):
    """A straight road from (0, 0) over (100, 0) to (200, 0) whose first half SUMO takes for 200 m long."""
    edges = '<edge id="one" from="a" to="b" length="200"/><edge id="two" from="b" to="c"/>'
    places = {"a": (0, 0), "b": (100, 0), "c": (200, 0)}
    return read_net(compiled(lambda folder: sources.write(folder, places, edges)))
