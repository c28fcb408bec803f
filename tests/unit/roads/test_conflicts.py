"""Conflicts of the cross: lanes 3.2 m wide, 1.6 and 4.8 m off the axes, a junction from -10.4 to 10.4 m."""

import numpy as np
import pytest
import shapely
import shapely.ops

from smarts.roads.lane_graph import ConflictKind, Yields
from smarts.roads.sumo_net import read_net

from . import maps


def through(graph, origin, target):
    """Return the junction lanes from one lane to another."""
    chain = [graph.lane_of_id(origin)]
    goal = graph.lane_of_id(target)

    def search(lane, path):
        for after in graph.successors(lane):
            if after == goal:
                return path
            if graph.is_internal[after] and (found := search(after, [*path, int(after)])):
                return found
        return None

    found = search(chain[0], [])
    assert found is not None
    return found


def conflict(graph, lane, other):
    """Return kind and both extents, or None."""
    rows = range(graph.conflict_start[lane], graph.conflict_start[lane + 1])
    found = [row for row in rows if graph.conflict_lane[row] == other]
    if not found:
        return None
    (row,) = found
    extents = graph.conflict_extent[row], graph.conflict_other_extent[row]
    return ConflictKind(graph.conflict_kind[row]), *(tuple(extent) for extent in extents)


def test_straight_roads_cross_in_a_square(cross):
    (eastbound,) = through(cross, "west_in_1", "east_out_1")
    (northbound,) = through(cross, "south_in_0", "north_out_0")
    # Eastbound at y = -1.6 from x = -10.4; northbound at x = 4.8 from y = -10.4, each 1.6 m to either side.
    kind, own, other = conflict(cross, eastbound, northbound)
    assert kind is ConflictKind.CROSS
    assert own == pytest.approx((13.6, 16.8))
    assert other == pytest.approx((7.2, 10.4))


def test_right_turn_merges_with_the_straight_road(cross):
    (turn,) = through(cross, "west_in_0", "south_out_0")
    (straight,) = through(cross, "north_in_0", "south_out_0")
    kind, own, other = conflict(cross, turn, straight)
    assert kind is ConflictKind.MERGE
    assert own[1] == pytest.approx(cross.length[turn], abs=0.01)
    assert other[1] == pytest.approx(cross.length[straight], abs=0.01)
    assert 0 < own[0] < own[1]
    assert cross.length[straight] - other[0] < 8


def test_lanes_that_diverge_are_no_conflict(cross):
    (straight,) = through(cross, "west_in_1", "east_out_1")
    for turn in through(cross, "west_in_1", "north_out_1"):
        assert conflict(cross, straight, turn) is None


def test_every_conflict_has_its_mirror_image(graphs):
    for graph in graphs.values():
        owner = np.repeat(np.arange(len(graph.length)), np.diff(graph.conflict_start))
        rows = {(a, b): row for row, (a, b) in enumerate(zip(owner, graph.conflict_lane, strict=True))}
        assert rows
        for (a, b), row in rows.items():
            mirror = rows[b, a]
            assert graph.conflict_kind[row] == graph.conflict_kind[mirror]
            np.testing.assert_array_equal(graph.conflict_extent[row], graph.conflict_other_extent[mirror])


def test_extents_hold_the_whole_overlap(graphs):
    """Outside its extent, a lane's area meets the other nowhere, but for slivers in bends."""
    for graph in graphs.values():
        lines = [shapely.LineString(graph.centreline(lane)) for lane in range(len(graph.length))]
        owner = np.repeat(np.arange(len(graph.length)), np.diff(graph.conflict_start))
        for row, lane in enumerate(owner):
            other = graph.conflict_lane[row]
            area = lines[other].buffer(graph.width[other] / 2, cap_style="flat")
            begin, end = graph.conflict_extent[row]
            assert 0 <= begin < end <= graph.length[lane] + 1e-9
            for piece in ((0, begin), (end, graph.length[lane])):
                outside = shapely.ops.substring(lines[lane], *piece)
                if outside.length > 0.01:
                    swept = outside.buffer(graph.width[lane] / 2, cap_style="flat")
                    assert swept.intersection(area).area < 0.35


def rules(graph, lane, other):
    """Return the `Yields` of two lanes."""
    rows = range(graph.conflict_start[lane], graph.conflict_start[lane + 1])
    (row,) = [row for row in rows if graph.conflict_lane[row] == other]
    return Yields(graph.conflict_yields[row])


def test_at_an_all_way_stop_each_gives_way_to_each(compile_to):
    graph = read_net(compile_to("all_way_stop", maps.junction("allway_stop")))
    (eastbound,) = through(graph, "west_in_0", "east_out_0")
    (northbound,) = through(graph, "south_in_0", "north_out_0")
    assert rules(graph, eastbound, northbound) is Yields.BOTH
    assert rules(graph, northbound, eastbound) is Yields.BOTH


def test_lanes_that_merge_like_a_zip_have_no_rule(compile_to):
    graph = read_net(compile_to("zipper", maps.zipper()))
    (right,) = through(graph, "two_0", "one_0")
    (left,) = through(graph, "two_1", "one_0")
    assert rules(graph, right, left) is Yields.NEITHER


def connections_by_lane(net):
    """Return, for each lane inside junctions, sumolib's connection whose traffic it carries, and its node."""
    found = {}
    for node in net.getNodes():
        for edge in node.getIncoming():
            for lane in edge.getLanes():
                for connection in lane.getOutgoing():
                    via = connection.getViaLaneID()
                    while via:
                        found[via] = node, connection
                        via = net.getLane(via).getOutgoing()[0].getViaLaneID()
    return found


def test_right_of_way_is_that_of_sumo(graphs, sumo_nets):
    """sumolib numbers the links of a junction in its own way, from the lanes that come in."""
    for name, graph in graphs.items():
        connections = connections_by_lane(sumo_nets[name])
        owner = np.repeat(np.arange(len(graph.length)), np.diff(graph.conflict_start))
        expected = []
        for lane, partner in zip(owner, graph.conflict_lane, strict=True):
            node, own = connections[graph.lane_ids[lane]]
            _, other = connections[graph.lane_ids[partner]]
            this_waits, other_waits = node.forbids(other, own), node.forbids(own, other)
            is_rule = node.getType() == "allway_stop" or this_waits != other_waits
            expected.append(is_rule * (Yields.THIS * this_waits + Yields.OTHER * other_waits))
        np.testing.assert_array_equal(graph.conflict_yields, expected, err_msg=name)
        assert any(expected) or name == "curve"
