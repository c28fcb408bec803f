import pytest
import sumolib

from smarts.roads.compile import compile_map
from smarts.roads.sources import find_map_source
from smarts.roads.sumo_net import read_net

from . import maps


@pytest.fixture(scope="session")
def compile_to(tmp_path_factory):
    """Return a function from a name and map sources to the compiled network's file."""

    def compiled(name, sources):
        folder = maps.write(tmp_path_factory.mktemp(name), **sources)
        net = folder / "compiled.net.xml"
        compile_map(find_map_source(folder), net)
        return net

    return compiled


@pytest.fixture(scope="session")
def nets(compile_to):
    """The compiled network files of all maps."""
    return {name: compile_to(name, sources) for name, sources in maps.MAPS.items()}


@pytest.fixture(scope="session")
def graphs(nets):
    return {name: read_net(net) for name, net in nets.items()}


@pytest.fixture(scope="session")
def sumo_nets(nets):
    """The same maps as sumolib reads them."""
    return {name: sumolib.net.readNet(str(net), withInternal=True) for name, net in nets.items()}


@pytest.fixture(scope="session")
def cross(graphs):
    return graphs["cross"]
