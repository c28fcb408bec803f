from pathlib import Path

import pytest

from smarts.roads.compile import compile_map
from smarts.roads.sources import find_map_source
from smarts.roads.sumo_net import read_net

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


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
