"""Small nets, compiled once per session, a world with SUMO traffic on them, and the vehicle stage."""

import hashlib
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import sumo

from smarts.providers.sumo_traffic import SumoTraffic
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.sumo_net import read_net
from smarts.types.traffic import TrafficFiles
from smarts.types.vehicles import Owner, VehicleKind, VehicleStates
from smarts.types.world import World as State
from tests.vehicle_stage import VehicleStage

NETCONVERT = Path(sumo.__file__).parent / "bin" / "netconvert"

ROAD = (
    '<nodes><node id="a" x="0" y="0"/><node id="b" x="1000" y="0"/><node id="c" x="2000" y="0"/></nodes>',
    '<edges><edge id="ab" from="a" to="b" numLanes="2" speed="20"/>'
    '<edge id="bc" from="b" to="c" numLanes="2" speed="20"/>'
    '<edge id="ba" from="b" to="a" numLanes="1" speed="20"/></edges>',
)
"""Two lanes eastward, centred at y = -4.8 and -1.6, and one back at y = 1.6."""


def cross(kind: str) -> tuple[str, str]:
    """Return a crossing of four arms of 200 m at the origin, with one lane per direction, 1.6 m off the axis.

    Args:
        kind: SUMO's type of the junction.
    """
    arms = {"n": (0, 200), "s": (0, -200), "e": (200, 0), "w": (-200, 0)}
    nodes = "".join(f'<node id="{name}" x="{x}" y="{y}"/>' for name, (x, y) in arms.items())
    edges = "".join(
        f'<edge id="{begin}{end}" from="{begin}" to="{end}" speed="15" priority="{2 if arm in "ew" else 1}"/>'
        for arm in arms
        for begin, end in ((arm, "c"), ("c", arm))
    )
    return f'<nodes>{nodes}<node id="c" x="0" y="0" type="{kind}"/></nodes>', f"<edges>{edges}</edges>"


def streets(nodes: dict[str, tuple[float, float]], edges: dict[str, str], **kinds: str) -> tuple[str, str]:
    """Return straight roads.

    Args:
        nodes: Places [m] by their letters.
        edges: Further attributes of each edge, by the letters of its two ends.
        kinds: SUMO's type of a junction, by its letter.
    """
    places = "".join(
        f'<node id="{name}" x="{x}" y="{y}" type="{kinds.get(name, "priority")}"/>'
        for name, (x, y) in nodes.items()
    )
    roads = "".join(
        f'<edge id="{ends}" from="{ends[0]}" to="{ends[1]}" {more}/>' for ends, more in edges.items()
    )
    return f"<nodes>{places}</nodes>", f"<edges>{roads}</edges>"


def bend(turn: int) -> tuple[str, str]:
    """Return a road of two lanes, and one back, that begins 80 m west of the origin and turns around there.

    Its left edge is a half circle with a radius of 12 m to the left (`turn` 1) or of 18.4 m to the right
    (`turn` -1). Lane 1 is 1.6 m to the right of the left edge.
    """
    radius = 12.0 if turn > 0 else 18.4
    angles = np.linspace(0, np.pi, 91)
    x, y = radius * np.sin(angles), turn * radius * (1 - np.cos(angles))
    points = [(-80.0, 0.0), *zip(x, y, strict=True), (-80.0, float(y[-1]))]
    shape, back = (" ".join(f"{x:.4f},{y:.4f}" for x, y in line) for line in (points, points[::-1]))
    return (
        f'<nodes><node id="a" x="-80" y="0"/><node id="b" x="-80" y="{y[-1]}"/></nodes>',
        f'<edges><edge id="ab" from="a" to="b" numLanes="2" speed="10" shape="{shape}"/>'
        f'<edge id="ba" from="b" to="a" numLanes="1" speed="10" shape="{back}"/></edges>',
    )


BUSY_ROAD = """<routes>
  <vType id="patient" sigma="0.7" speedFactor="normc(0.9,0.1,0.7,1.1)"/>
  <vType id="hurried" sigma="0.3" speedFactor="normc(1.2,0.1,0.9,1.4)" lcSpeedGain="3" tau="0.8"/>
  <vType id="lorry" vClass="truck"/>
  <flow id="slow" type="patient" from="ab" to="bc" begin="0" end="900" vehsPerHour="700" departLane="random"/>
  <flow id="fast" type="hurried" from="ab" to="bc" begin="0" end="900" vehsPerHour="700" departLane="random"
        departSpeed="max"/>
  <flow id="long" type="lorry" from="ab" to="bc" begin="5" end="900" probability="0.05"/>
</routes>"""

BUSY_CROSS = """<routes>
  <vType id="car" speedFactor="normc(1,0.1,0.7,1.3)"/>
  <flow id="we" type="car" from="wc" to="ce" begin="0" end="900" vehsPerHour="500"/>
  <flow id="en" type="car" from="ec" to="cn" begin="0" end="900" vehsPerHour="300"/>
  <flow id="ns" type="car" from="nc" to="cs" begin="0" end="900" vehsPerHour="300"/>
  <flow id="sw" type="car" from="sc" to="cw" begin="0" end="900" vehsPerHour="300"/>
</routes>"""


class Country:
    """Compiles nets and writes routes into a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._nets: dict[str, Path] = {}
        self._roads: dict[Path, LaneGraph] = {}

    def net(self, name: str, source: tuple[str, str]) -> Path:
        if name not in self._nets:
            nodes, edges = self.folder / f"{name}.nod.xml", self.folder / f"{name}.edg.xml"
            nodes.write_text(source[0])
            edges.write_text(source[1])
            net = self.folder / f"{name}.net.xml"
            options = ["--junctions.internal-link-detail", "20", "--offset.disable-normalization"]
            command = [NETCONVERT, "-n", nodes, "-e", edges, "-o", net, *options]
            subprocess.run([*map(str, command)], check=True, capture_output=True)
            self._nets[name] = net
        return self._nets[name]

    def files(self, net: Path, routes: str, warm_up: float = 0.0, additional: str = "") -> TrafficFiles:
        digest = hashlib.blake2b((routes + additional).encode(), digest_size=6).hexdigest()
        route_file = self.folder / f"{digest}.rou.xml"
        route_file.write_text(routes if routes.startswith("<routes") else f"<routes>{routes}</routes>")
        more: tuple[Path, ...] = ()
        if additional:
            more = (self.folder / f"{digest}.add.xml",)
            more[0].write_text(f"<additional>{additional}</additional>")
        return TrafficFiles(net, (route_file,), more, warm_up)

    def road(self, routes: str = BUSY_ROAD, warm_up: float = 0.0) -> TrafficFiles:
        return self.files(self.net("road", ROAD), routes, warm_up)

    def cross(self, routes: str = BUSY_CROSS, warm_up: float = 0.0, kind: str = "priority") -> TrafficFiles:
        return self.files(self.net(f"cross_{kind}", cross(kind)), routes, warm_up)

    def bend(self, routes: str, turn: int) -> TrafficFiles:
        return self.files(self.net(f"bend_{turn + 1}", bend(turn)), routes)

    def roads(self, files: TrafficFiles) -> LaneGraph:
        if files.net not in self._roads:
            self._roads[files.net] = read_net(files.net)
        return self._roads[files.net]


LANES = 100
"""Maximum number of lanes of a net."""


class World:
    """One simulation with SUMO traffic and vehicles that a test moves itself."""

    def __init__(self, country: Country, capacity: int = 64, step: float | None = None) -> None:
        self.country = country
        self.state = State(worlds=1, capacity=capacity, agents=0, lanes=LANES)
        self.states = self.state.vehicles.of(0)
        self.registry = self.state.registry
        self.traffic = SumoTraffic(self.state, 0, step=step)

    def reset(self, files: TrafficFiles, seed: int = 3, limit: int | None = None) -> None:
        self.roads = self.country.roads(files)
        self.traffic.reset(files, seed, self.roads, limit)

    def step(self, count: int = 1) -> None:
        for _ in range(count):
            self.traffic.step()

    def admit(self, x: float, y: float, heading: float, speed: float, owner: Owner = Owner.AGENT) -> int:
        slot = self.registry.admit(0, "ego", owner, VehicleKind.PASSENGER, 5.0, 1.8)
        self.put(slot, x, y, heading, speed)
        return slot

    def put(self, slot: int, x: float, y: float, heading: float, speed: float) -> None:
        self.states.position[slot] = x, y
        self.states.heading[slot] = heading
        self.states.speed[slot] = speed

    def clear(self) -> None:
        """Empty the world for another episode."""
        self.state.clear(0)

    def set_route(self, slot: int, edges: Sequence[str]) -> None:
        """Set the planned route of a vehicle."""
        self.states.route[slot] = self.state.routes.number(0, map(self.roads.edge_number, edges))

    def slot(self, name: str) -> int:
        return next(s for s in range(self.states.capacity) if self.registry.name(0, s) == name)

    def route(self, slot: int) -> tuple[str, ...]:
        """Return the remaining edges of a vehicle's route in SUMO, the current one first."""
        return self.traffic._library.route_ahead(self.traffic._ids[slot])

    def sumo_lane(self, slot: int) -> str:
        return self.traffic._library.vehicle.getLaneID(self.traffic._ids[slot])

    def names(self) -> list[str]:
        return [self.registry.name(0, slot) for slot in np.flatnonzero(self.states.alive).tolist()]

    def fingerprint(self) -> bytes:
        return b"".join(column.tobytes() for column in self.states)


@pytest.fixture(scope="session")
def country(tmp_path_factory):
    return Country(tmp_path_factory.mktemp("country"))


@pytest.fixture
def new_world(country, closing):
    """Return a factory of worlds, each with its own copy of libsumo; all are closed after the test."""

    def make(capacity: int = 64, step: float | None = None) -> World:
        made = World(country, capacity, step)
        return closing(made, made.traffic)

    return make


@pytest.fixture
def world(new_world):
    return new_world()


def front_of(states: VehicleStates, rows) -> np.ndarray:
    """Return the middle of the front bumpers, SUMO's reference point [m], shape (N, 2)."""
    heading = states.heading[rows]
    return states.position[rows] + np.stack([np.cos(heading), np.sin(heading)], -1) * (
        states.length[rows, None] / 2
    )


@pytest.fixture
def stage(closing):
    def make(*rows, **options):
        made = VehicleStage(*rows, **options)
        return closing(made, made.vehicles)

    return make
