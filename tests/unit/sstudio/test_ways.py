"""What lies beside the way of a mission."""

import pytest

from smarts.sstudio.ways import leads_back_beside
from tests.maps import Road, graph_of


@pytest.mark.parametrize(("apart", "beside"), [(49.0, True), (51.0, False)])
def test_a_long_road_back(apart, beside):
    graph = graph_of({"there": Road([(0, 0), (500, 0)]), "back": Road([(500, apart), (0, apart)])})
    assert leads_back_beside(graph, 0, 10.0, 1) == beside
