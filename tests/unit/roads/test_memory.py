import gc
import weakref

from smarts.roads.memory import remembered
from smarts.roads.sumo_net import read_net


def test_a_graph_is_let_go(nets):
    @remembered(most=2)
    def lanes(graph):
        return len(graph.lane_ids)

    graph = read_net(nets["cross"])
    lanes(graph)
    ghost = weakref.ref(graph)
    del graph
    gc.collect()
    assert ghost() is None
