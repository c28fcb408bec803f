import gc
import weakref

from smarts.roads.memory import remembered
from smarts.roads.sumo_net import read_net


def test_results_are_remembered_for_each_graph(nets):
    calls = []

    @remembered(most=2)
    def lanes(graph, factor, *, plus=0):
        calls.append((len(graph.lane_ids), factor, plus))
        return factor * len(graph.lane_ids) + plus

    one, two = read_net(nets["cross"]), read_net(nets["curve"])
    assert lanes(one, 2) == lanes(one, 2) == 2 * len(one.lane_ids)
    assert lanes(two, 2, plus=1) == 2 * len(two.lane_ids) + 1
    assert len(calls) == 2
    for factor in (3, 4, 2):
        lanes(one, factor)
    assert len(calls) == 5


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
