"""Traffic in SUMO's own files: imported as it is, driven from its begin on, without what is not simulated."""

import gzip

import pytest

from smarts.errors import SmartsError
from smarts.roads.compile import compile_map
from smarts.roads.sources import find_map_source
from smarts.sim.traffic_run import traffic_run
from smarts.sstudio.build import build_scenario
from smarts.sstudio.sumo_files import import_sumo
from tests.raising import raises
from tests.unit.roads import maps

TYPES = """<additional>
    <vType id="long" vClass="truck" length="11"/> <vType id="tram" vClass="tram" length="30"/>
    <route id="across" edges="west_in east_out"/>
    <rerouter id="r" edges="west_in"/> <poly id="house" shape="0,0 1,1 2,0"/>
    <inductionLoop id="e1" lane="west_in_0" pos="1" period="60" file="loops.xml"/>
</additional>"""
ROUTES = """<routes>
    <vehicle id="early" depart="50" route="across"/>
    <vehicle id="lorry" type="long" depart="3601" route="across" departSpeed="5"/>
    <vehicle id="rails" type="tram" depart="3601" route="across"/>
    <person id="p" depart="3601"><walk edges="west_in"/></person>
    <flow id="cars" begin="3602" end="3700" period="10" from="south_in" to="north_out"/>
</routes>"""
CONFIG = """<configuration>
    <input><net-file value="town.net.xml.gz"/><route-files value="day.rou.xml"/>
        <additional-files value="sub/types.add.xml"/></input>
    <time><begin value="1:00:00"/><end value="4000"/><step-length value="1"/></time>
    <output><tripinfo-output value="trips.xml"/></output>
    <processing><time-to-teleport value="-1"/></processing>
</configuration>"""


@pytest.fixture
def sumo(tmp_path):
    """A folder with a configuration of SUMO and its files."""
    folder = maps.write(tmp_path / "sumo", **maps.cross())
    compile_map(find_map_source(folder), folder / "plain.net.xml")
    (folder / "town.net.xml.gz").write_bytes(gzip.compress((folder / "plain.net.xml").read_bytes()))
    (folder / "sub").mkdir()
    (folder / "sub" / "types.add.xml").write_text(TYPES)
    (folder / "day.rou.xml").write_text(ROUTES)
    (folder / "town.sumocfg").write_text(CONFIG)
    return folder


def departed(built):
    """Return the step at which each vehicle is there first, and its length, within 20 s."""
    found = {}
    with traffic_run(built, "town", seed=1) as run:
        for number, states in enumerate(run.steps(20.0)):
            for slot in states.alive.nonzero()[0]:
                name = run.world.registry.name(0, int(slot))
                found.setdefault(name, (number + 1, round(float(states.length[slot]), 3)))
    return found


def test_a_configuration_becomes_a_scenario_with_its_traffic(sumo, tmp_path):
    folder, unused = import_sumo([sumo / "town.sumocfg"], tmp_path / "town")
    assert unused == ("step-length", "time-to-teleport")
    built = build_scenario(folder)
    assert [*built.traffic] == ["town"]
    (warning,) = built.warnings
    assert "1 inductionLoop, 1 person, 1 rerouter, 1 vehicle of a type off the road" in warning
    # SUMO's vehicles appear at the end of the step in which they depart: 3601 s is 1 s after the begin.
    assert departed(built) == {"lorry": (11, 11.0), "cars.0": (21, 5.0), "cars.1": (121, 5.0)}


def test_a_changed_route_file_is_built_again(sumo, tmp_path):
    folder, _ = import_sumo([sumo / "town.sumocfg"], tmp_path / "town")
    first = build_scenario(folder)
    (folder / "day.rou.xml").write_text(ROUTES.replace('type="long"', ""))
    assert departed(build_scenario(folder))["lorry"] == (11, 5.0)
    assert build_scenario(folder).directory != first.directory


def test_what_sumo_refuses_is_an_error_of_the_build(sumo, tmp_path):
    (sumo / "day.rou.xml").write_text(ROUTES.replace("north_out", "nowhere"))
    folder, _ = import_sumo([sumo / "town.sumocfg"], tmp_path / "town")
    with raises(SmartsError, values=["nowhere", "traffic['town']"]):
        build_scenario(folder)


@pytest.mark.parametrize(
    ("old", "new", "value"),
    [("town.net.xml.gz", "gone.net.xml", "gone.net.xml"), ("net-file", "no-file", "town.sumocfg")],
)
def test_configurations_of_nothing(sumo, tmp_path, old, new, value):
    (sumo / "town.sumocfg").write_text(CONFIG.replace(old, new))
    with raises(SmartsError, values=[value]):
        import_sumo([sumo / "town.sumocfg"], tmp_path / "town")
    assert not (tmp_path / "town").exists()
