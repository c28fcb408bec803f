"""Building: implicit, cached by content, byte-identical, and safe whatever happens meanwhile."""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

from smarts.errors import ScenarioError
from smarts.sstudio import gen_bubbles, gen_missions, gen_traffic
from smarts.sstudio import types as t
from smarts.sstudio.build import build_described, build_scenario
from tests.raising import raises

from . import sources

CAR = t.TrafficActor("car")
WEST_EAST = t.Route(("from_west", 0, 10), ("to_east", 0, "max"))
DETOUR = t.Route(("east", 0, 5), ("west", 0, "max"))
"""On the roads of `write_detour`."""


def contents(built) -> dict[str, str]:
    """Return the hash of every artefact by its name."""
    files = sorted(file for file in built.directory.rglob("*") if file.is_file())
    return {
        str(file.relative_to(built.directory)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in files
    }


def ages(folder) -> dict[Path, int]:
    return {file: file.stat().st_mtime_ns for file in (folder / "build").rglob("*") if file.is_file()}


class TestArtefacts:
    def test_what_is_built(self, scenario_folder):
        folder = scenario_folder()
        built = build_scenario(folder)
        assert (built.name, built.source) == ("cross", folder)
        assert built.directory.parent == folder / "build"
        assert sorted(contents(built)) == [
            "lanes.npz",
            "manifest.json",
            "map.net.xml",
            "scenario.json",
            "traffic/through.rou.xml",
        ]
        files = built.traffic["through"]
        assert files.net == built.net_file
        assert files.routes == (built.directory / "traffic" / "through.rou.xml",)
        assert (files.additional, files.warm_up) == ((), 0)
        assert built.roads().edge_number("from_west") >= 0
        assert built.roads() is build_scenario(folder).roads()

    def test_the_scenario_is_read_from_the_artefacts(self, built_folder):
        folder = built_folder
        built = build_scenario(folder)
        (folder / "scenario.py").write_text("broken")
        assert built.scenario.ego_missions == (
            t.Mission(t.Route(("from_south", 0, 20), ("to_north", 0, 50))),
        )
        assert list(built.scenario.traffic["through"].flows[0].actors) == [CAR]

    def test_same_sources_and_seed_give_the_same_bytes_anywhere(self, scenario_folder, monkeypatch):
        traffic = 'traffic={"x y/z": t.Traffic([flow(t.RandomRoute()) for _ in range(9)])}'
        spec = "map_spec=t.MapSpec(str(Path(__file__).parent))"
        here = scenario_folder(sources.scenario(f"{traffic}, {spec}"))
        monkeypatch.setenv("PYTHONHASHSEED", "7")
        there = scenario_folder(sources.scenario(f"{traffic}, map_spec=t.MapSpec('.')"), name="deep/er")
        one, other = build_scenario(here), build_scenario(there)
        assert contents(one) == contents(other)
        assert one.directory.name == other.directory.name
        assert str(here.parent) not in "".join(
            file.read_text() for file in one.directory.rglob("*") if file.suffix in (".json", ".xml")
        )
        assert one.traffic["x y/z"].routes[0].is_file()

    def test_a_seed_in_the_file_counts_unless_another_is_asked_for(self, scenario_folder):
        script = sources.SCRIPT.replace("output_dir=", "seed=7, output_dir=")
        folder = scenario_folder(script)
        assert build_scenario(folder).seed == 7
        assert build_scenario(folder, seed=3).seed == 3

    def test_too_many_egos_are_refused(self, built_folder):
        build_scenario(built_folder, egos=1)
        with raises(ScenarioError, values=[2, 1]):
            build_scenario(built_folder, egos=2)

    def test_unknown_traffic_is_refused(self, built_folder):
        built = build_scenario(built_folder)
        with raises(ScenarioError, values=["through"]):
            built.traffic_files("trough")
        assert built.traffic_files(None).routes == ()

    def test_maps_alone_are_scenarios(self, scenario_folder, tmp_path):
        folder = scenario_folder(script=None)
        built = build_scenario(folder)
        assert (built.name, built.traffic, built.scenario) == ("cross", {}, t.Scenario())
        net = shutil.copy(built.net_file, tmp_path / "town.net.xml")
        from_file = build_scenario(net)
        assert from_file.name == "town"
        assert from_file.net_file.read_bytes() == built.net_file.read_bytes()
        assert sorted(file.name for file in tmp_path.glob("town*")) == ["town.net.xml"]
        assert from_file.directory.is_relative_to(tmp_path / "cache")

    def test_vehicles_take_ways_that_are_open_to_them(self, tmp_path):
        """The way of cars from "east" to "west" is the shorter one, over "middle"."""
        folder = sources.write_detour(tmp_path / "detour")
        car, truck = (t.TrafficActor(kind, vehicle_type=kind) for kind in ("passenger", "truck"))
        flows = [
            t.Flow(DETOUR, 60, actors=dict.fromkeys(actors, 1)) for actors in ([car], [truck], [car, truck])
        ]
        routes = _routes(build_described(folder, t.Scenario(traffic={"x": t.Traffic(flows)})))
        around = ["east", "up", "down", "west"]
        assert list(routes.values()) == [["east", "middle", "west"], around, around]


def _routes(built):
    """Return the edges of each vehicle and flow."""
    root = ElementTree.fromstring(built.traffic["x"].routes[0].read_text())
    edges = {route.attrib["id"]: route.attrib["edges"].split() for route in root.iter("route")}
    return {each.attrib["id"]: edges[each.attrib["route"]] for each in root if "route" in each.attrib}


class TestVariations:
    BODY = """
        traffic={"x": t.Traffic([flow()])},
        ego_missions=[t.Mission(south_north)],
        held_out={
            "seed": t.Variation("Other seed.", seed=5),
            "dense": t.Variation("Dense.", traffic={"x": t.Traffic([flow(rate=1200)])}),
            "free": t.Variation("Free.", ego_missions=[t.EndlessMission(("from_west", 0, 9))]),
        },"""

    def test_each_changes_what_it_says(self, scenario_folder):
        folder = scenario_folder(sources.scenario(self.BODY))
        base = build_scenario(folder)
        assert base.held_out == ("seed", "dense", "free")
        seed, dense, free = (build_scenario(f"{folder}@{name}") for name in base.held_out)
        assert (dense.name, dense.held_out) == ("cross@dense", ())
        assert (base.seed, seed.seed, dense.seed) == (42, 5, 42)
        assert build_scenario(f"{folder}@seed", seed=7).seed == 7
        assert "1200" in dense.traffic["x"].routes[0].read_text()
        assert dense.scenario.ego_missions == base.scenario.ego_missions
        assert free.scenario.traffic == base.scenario.traffic
        assert free.scenario.ego_missions == (t.EndlessMission(("from_west", 0, 9)),)
        assert dense.net_file.read_bytes() == base.net_file.read_bytes()

    def test_another_map(self, scenario_folder):
        body = 'held_out={"ring": t.Variation("Ring.", map_spec=t.MapSpec("../ring"))}'
        folder = scenario_folder(sources.scenario(body))
        sources.write_ring(folder.parent / "ring")
        assert build_scenario(f"{folder}@ring").roads().road_edges == ("east", "north", "south", "west")


class TestUpToDate:
    def test_nothing_is_written_when_nothing_changed(self, built_folder):
        folder = built_folder
        built = build_scenario(folder)
        before = ages(folder)
        assert build_scenario(folder) == built
        assert ages(folder) == before

    def test_changes_lead_to_other_artefacts(self, scenario_folder):
        script = "from rates import RATE\n" + sources.SCRIPT.replace("rate=600", "rate=RATE")
        folder = scenario_folder(script, rates="RATE = 600\n")
        directories = [build_scenario(folder).directory]
        changes = {
            "scenario.py": script.replace("0, 20", "0, 21"),
            "map.edg.xml": sources.EDGES.replace("13.89", "16.67"),
            "rates.py": "RATE = 700\n",
        }
        for name, text in changes.items():
            (folder / name).write_text(text)
            directory = build_scenario(folder).directory
            assert directory not in directories, name
            directories.append(directory)
        assert all(directory.is_dir() for directory in directories)  # whoever runs one goes on

    def test_what_says_the_same_leads_to_the_same_artefacts(self, built_folder):
        folder = built_folder
        first = build_scenario(folder)
        (folder / "scenario.py").write_text("# A comment.\n" + sources.SCRIPT)
        assert build_scenario(folder).directory == first.directory


BUILD = """
import sys
from smarts.sstudio.build import build_scenario
print("ready", flush=True)
print(build_scenario(sys.argv[1]).directory)
"""

ATTEMPTS = 8
"""At killing a build; the last ones come after its end."""


def start_build(folder):
    return subprocess.Popen(
        [sys.executable, "-c", BUILD, str(folder)], stdout=subprocess.PIPE, text=True, start_new_session=True
    )


class TestProcesses:
    def test_killed_at_any_moment(self, scenario_folder):
        folder = scenario_folder()
        old = build_scenario(folder)
        old_contents = contents(old)
        expected = contents(build_scenario(scenario_folder(self.changed(0), name="reference")))
        process = start_build(folder)
        assert process.stdout.readline() == "ready\n"
        begin = time.monotonic()
        process.communicate()
        duration = time.monotonic() - begin
        for attempt in range(ATTEMPTS):
            (folder / "scenario.py").write_text(self.changed(attempt))
            (folder / "map.edg.xml").write_text(sources.EDGES.replace("13.89", f"{13 + attempt / 100}"))
            process = start_build(folder)
            assert process.stdout.readline() == "ready\n"
            time.sleep(1.5 * duration * attempt / ATTEMPTS)
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            assert contents(old) == old_contents
            for artefacts in (folder / "build").glob("[0-9a-f]*"):
                assert {"lanes.npz", "manifest.json", "map.net.xml", "scenario.json"} <= {
                    file.name for file in artefacts.iterdir()
                }
                json.loads((artefacts / "manifest.json").read_text())
        (folder / "scenario.py").write_text(self.changed(0))
        (folder / "map.edg.xml").write_text(sources.EDGES)
        assert contents(build_scenario(folder)) == expected
        assert not list((folder / "build").rglob(".partial-*"))

    @staticmethod
    def changed(attempt):
        return sources.SCRIPT.replace("rate=600", f"rate={700 + attempt}")


def test_variations_of_another_order_are_another_scenario(scenario_folder):
    body = "traffic={name: t.Traffic([flow()]) for name in 'ORDER'}"
    folder = scenario_folder(sources.scenario(body.replace("ORDER", "ab")))
    assert list(build_scenario(folder).traffic) == ["a", "b"]
    (folder / "scenario.py").write_text(sources.scenario(body.replace("ORDER", "ba")))
    assert list(build_scenario(folder).traffic) == ["b", "a"]


class TestByHand:
    def test_running_the_file_builds_it(self, scenario_folder):
        folder = scenario_folder("print('drawn up')\n" + sources.SCRIPT)
        done = subprocess.run(
            [sys.executable, "scenario.py"], cwd=folder, capture_output=True, text=True, check=True
        )
        assert "drawn up" in done.stdout
        before = ages(folder)
        assert build_scenario(folder).traffic.keys() == {"through"}
        assert ages(folder) == before

    def test_calls_from_elsewhere_add_up_and_replace(self, scenario_folder):
        folder = scenario_folder(script=None)
        mission = t.Mission(WEST_EAST)
        gen_traffic(folder, t.Traffic([t.Flow(WEST_EAST, 60, actors={CAR: 1})]), name="a")
        gen_missions(folder, [mission, mission])
        gen_missions(str(folder), [mission])
        gen_traffic(folder, t.Traffic([]), name="b")
        gen_bubbles(folder, [t.Bubble(t.PositionalZone((0, 0), (9, 9)), t.SocialAgentActor("x", "z:x-v0"))])
        built = build_scenario(folder)
        assert list(built.traffic) == ["a", "b"]
        assert built.scenario.ego_missions == (mission,)
        assert built.scenario.bubbles is not None


def test_what_has_no_effect_is_said_once(scenario_folder, caplog):
    history = "t.TrafficHistoryDataset('x', 'NGSIM', None)"
    folder = scenario_folder(sources.scenario(f"traffic_histories=[{history}]"))
    for _ in range(2):
        build_scenario(folder)
    (said,) = [record for record in caplog.records if record.name == "smarts"]
    assert said.levelname == "WARNING"
    assert f"{folder}/scenario.py: traffic_histories: 'x' without input_path" in said.getMessage()
