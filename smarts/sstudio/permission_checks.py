"""Checks that vehicles may use the lanes on their way, as SUMO does only when they depart."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from smarts.errors import ScenarioError
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.permissions import roads_for
from smarts.roads.routes import CARS, edge_graph


def check_permissions(routes: str, roads: LaneGraph, net: Path, where: str) -> None:
    """Raise unless all flows and vehicles may drive their routes, random ones included.

    Passenger cars are not checked: their routes are made of lanes that are open to them.

    Args:
        routes: SUMO's input.
        roads: The map.
        net: The network that it was read from.
        where: The traffic, for errors.

    Raises:
        ScenarioError: The lane where a route begins, an edge or a connection is closed to a vehicle. SUMO
            ends routes in another lane where theirs is closed.
    """
    root = ElementTree.fromstring(routes)
    by_id = {route.attrib["id"]: route for route in root.iterfind("route")}
    classes = {kind.attrib["id"]: {kind.attrib["vClass"]} for kind in root.iterfind("vType")}
    for mixture in root.iterfind("vTypeDistribution"):
        members = (classes[member] for member in mixture.attrib["vTypes"].split())
        classes[mixture.attrib["id"]] = set().union(*members)
    for vehicle in (*root.iterfind("flow"), *root.iterfind("vehicle")):
        route = by_id[vehicle.attrib["route"]]
        edges = route.attrib["edges"].split()
        lane = f"{edges[0]}_{vehicle.attrib['departLane']}"
        way = [*edges, edges[0]] if "repeat" in route.attrib else edges
        for vehicle_class in sorted(classes[vehicle.attrib["type"]] - {"passenger"}):
            closed = _closed_part(roads_for(roads, net, vehicle_class), way, lane)
            if closed:
                raise ScenarioError(
                    f"{closed} is closed to vehicles of type {vehicle_class!r}",
                    place=f"{where}: {vehicle.tag} {vehicle.attrib['id']!r}",
                    remedy="lead the route elsewhere by Route(via=[...]), or use another vehicle_type",
                )


def _closed_part(roads: LaneGraph, way: Sequence[str], lane: str) -> str:
    """Return what is closed on a way that begins in a lane, "" if nothing is."""
    if roads.kind[roads.lane_ids.index(lane)] not in CARS:
        return f"lane '{lane}'"
    onward = edge_graph(roads).onward
    for edge, following in pairwise(way):
        if roads.edge_number(following) not in onward[roads.edge_number(edge)]:
            return f"the way from edge '{edge}' to edge '{following}'"
    return ""
