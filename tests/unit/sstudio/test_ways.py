"""What lies beside the way of a mission."""

import tracemalloc

import pytest

from smarts.sstudio.ways import leads_back_beside
from tests.maps import Road, graph_of


@pytest.mark.parametrize(("apart", "beside"), [(4.0, True), (49.0, True), (51.0, False)])
def test_a_long_road_back(apart, beside):
    """In some megabytes, however many pairs of points there are."""
    graph = graph_of({"there": Road([(0, 0), (5000, 0)]), "back": Road([(5000, apart), (0, apart)])})
    tracemalloc.start()
    try:
        assert leads_back_beside(graph, 0, 10.0, 1) == beside
        assert tracemalloc.get_traced_memory()[1] < 20e6
    finally:
        tracemalloc.stop()
