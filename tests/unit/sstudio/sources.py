"""Map and scenario sources that the tests build from."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

from smarts.roads.lane_graph import LaneGraph
from smarts.sstudio import types as t
from smarts.sstudio import validation
from tests.unit.roads import maps

PLACES = {"centre": (0, 0), "west": (-110, 0), "east": (110, 0), "north": (0, 110), "south": (0, -110)}
EDGES = (
    "<edges>"
    + "".join(
        f'<edge id="from_{way}" from="{way}" to="centre" numLanes="2" speed="13.89"/>'
        f'<edge id="to_{way}" from="centre" to="{way}" numLanes="2" speed="13.89"/>'
        for way in ("west", "east", "north", "south")
    )
    + "</edges>"
)

SCRIPT = """
from pathlib import Path

from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

car = t.TrafficActor("car")
flow = t.Flow(t.Route(("from_west", 0, 10), ("to_east", 0, "max")), rate=600, actors={car: 1})
gen_scenario(
    t.Scenario(
        traffic={"through": t.Traffic(flows=[flow])},
        ego_missions=[t.Mission(t.Route(("from_south", 0, 20), ("to_north", 0, 50)))],
    ),
    output_dir=Path(__file__).parent,
)
"""


def scenario(body: str) -> str:
    """Return a scenario file that calls `gen_scenario(t.Scenario(<body>))`."""
    return f"""
from pathlib import Path

from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

car = t.TrafficActor("car")
west_east = t.Route(("from_west", 0, 10), ("to_east", 0, "max"))
south_north = t.Route(("from_south", 0, 20), ("to_north", 0, 50))
agent = t.SocialAgentActor("agent", "zoo:agent-v0")


def flow(route=west_east, rate=600, **more):
    return t.Flow(route, rate, **({{"actors": {{car: 1}}}} | more))


gen_scenario(t.Scenario({body}), output_dir=Path(__file__).parent)
"""


def validate(scenario: t.Scenario, roads: LaneGraph, place: str) -> None:
    """Check a scenario in which all traffic is cars, for which the network is not read."""
    validation.validate(scenario, roads, Path("not read"), place)


def write(folder: Path, places: Mapping[str, tuple[int, int]], edges: str) -> Path:
    """Write the sources of a map of roads between places into a new folder."""
    nodes = "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in places.items())
    return maps.write(folder, nod=f"<nodes>{nodes}</nodes>", edg=f"<edges>{edges}</edges>")


def write_cross(folder: Path) -> Path:
    """Write the crossing's sources into a new folder."""
    write(folder, PLACES, "")
    (folder / "map.edg.xml").write_text(EDGES)
    return folder


def write_fork(folder: Path) -> Path:
    """Write the sources of a road "ab" from (0, 0) to (100, 0) that forks into "bc" and "bd".

    Lane 0 of "ab" is a sidewalk; "bd" is closed to trucks and buses; both branches are dead ends.
    """
    sidewalk = '<lane index="0" allow="pedestrian"/>'
    edges = (
        f'<edge id="ab" from="a" to="b" numLanes="3">{sidewalk}</edge><edge id="bc" from="b" to="c"/>'
        '<edge id="bd" from="b" to="d" disallow="truck bus"/>'
    )
    return write(folder, {"a": (0, 0), "b": (100, 0), "c": (200, 0), "d": (100, 100)}, edges)


def write_detour(folder: Path, users: str = 'disallow="truck"') -> Path:
    """Write the sources of roads "east", "middle", "west", and a way round "middle", which has `users`."""
    ways = {"east": "ab", "middle": "bc", "west": "cd", "up": "be", "down": "ec"}
    closed = {"middle": users}
    edges = "".join(
        f'<edge id="{name}" from="{ends[0]}" to="{ends[1]}" {closed.get(name, "")}/>'
        for name, ends in ways.items()
    )
    places = {"a": (300, 0), "b": (200, 0), "c": (100, 0), "d": (0, 0), "e": (150, 80)}
    return write(folder, places, edges)


def write_ring(folder: Path) -> Path:
    """Write the sources of a square ring of one lane, driven counter-clockwise: south, east, north, west."""
    corners = {"south_west": (0, 0), "south_east": (80, 0), "north_east": (80, 80), "north_west": (0, 80)}
    sides = zip(("south", "east", "north", "west"), pairwise([*corners, "south_west"]), strict=True)
    edges = "".join(
        f'<edge id="{side}" from="{begin}" to="{end}" speed="13.89"/>' for side, (begin, end) in sides
    )
    return write(folder, corners, edges)
