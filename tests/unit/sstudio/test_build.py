"""Building: implicit, cached by content, byte-identical, and safe whatever happens meanwhile."""

import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from smarts.errors import ScenarioError
from smarts.sstudio import gen_bubbles, gen_missions, gen_traffic
from smarts.sstudio import types as t
from smarts.sstudio.build import build_described, build_scenario, suite
from smarts.sstudio.locating import SUITE
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

    def test_another_seed_gives_other_random_routes(self, scenario_folder):
        body = 'traffic={"x": t.Traffic([flow(t.RandomRoute()) for _ in range(9)])}'
        folder = scenario_folder(sources.scenario(body))
        routes = [build_scenario(folder, seed=seed).traffic["x"].routes[0].read_text() for seed in (1, 2, 1)]
        assert routes[0] == routes[2] != routes[1]
        assert build_scenario(folder, seed=42).directory == build_scenario(folder).directory

    def test_a_seed_in_the_file_counts_unless_another_is_asked_for(self, scenario_folder):
        script = sources.SCRIPT.replace("output_dir=", "seed=7, output_dir=")
        folder = scenario_folder(script)
        assert build_scenario(folder).seed == 7
        assert build_scenario(folder, seed=3).seed == 3

    def test_sumo_drives_the_traffic_of_another_engine(self, scenario_folder, caplog):
        body = 'traffic={"x": t.Traffic([flow()], engine="SMARTS"), "y": t.Traffic([flow()])}'
        built = build_scenario(scenario_folder(sources.scenario(body)))
        flows = [built.traffic_files(name).routes[0].read_text() for name in ("x", "y")]
        assert flows[0] == flows[1]
        assert built.warnings == ("SUMO drives the traffic 'x', which names the engine 'SMARTS'",)
        assert built.warnings[0] in caplog.text

    def test_what_was_left_out_of_a_map_is_a_warning_of_every_build_on_it(self, scenario_folder):
        folder = scenario_folder(script=None)
        net = folder / "map.net.xml"
        text = build_scenario(folder).net_file.read_text()
        net.write_text(text.replace("</net>", '<connection from="gone" to="west_out"/></net>'))
        for seed in (1, 1, 2):  # new, as it was, another on the same map
            (warning,) = build_scenario(folder, seed=seed).warnings
            assert "left out 1 of " in warning
            assert "gone" in warning

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

    def test_notes(self, scenario_folder):
        spec = "t.MapSpec('.', shift_to_origin=True, lanepoint_spacing=0.5)"
        traffic = "t.Traffic([flow(repeat_route=True)])"
        body = f"map_spec={spec}, traffic={{'x': {traffic}}}"
        notes = build_scenario(scenario_folder(sources.scenario(body))).notes
        for name in ("shift_to_origin", "lanepoint_spacing"):
            assert f"map_spec.{name} has no effect: the map is taken as it is" in notes
        assert any("traffic['x'].flows[0]: no way leads back" in note for note in notes)

    def test_vehicles_on_streets_that_are_closed_to_them(self, tmp_path):
        kind = "truck"
        folder = sources.write_fork(tmp_path / "fork")
        closed = t.Route(("ab", 1, 5), ("bd", 0, "max"))
        for route in (closed, t.Route(("bd", 0, 5), ("bd", 0, 50))):
            trips = [t.Trip("v", route, kind)]
            mixed = t.Flow(
                route, 60, actors={t.TrafficActor("car"): 1, t.TrafficActor("v", vehicle_type=kind): 1}
            )
            values = [
                ".route",
                "'bd",
                f"is closed to vehicles of type '{kind}'",
                "use another" if route.begin[0] == "bd" else "another vehicle type",
            ]
            for traffic in (t.Traffic([], trips=trips), t.Traffic([mixed])):
                with raises(ScenarioError, values=values):
                    build_described(folder, t.Scenario(traffic={"x": traffic}))
        drawn = [t.RandomRoute(str(number)) for number in range(9)]
        cars = [t.Trip("car", closed), t.Trip("v", t.Route(("ab", 1, 5), ("bc", 0, "max")), kind)]
        trips = [t.Trip(f"v{number}", route, kind) for number, route in enumerate(drawn)]
        mixed = t.Flow(drawn[0], 60, actors={t.TrafficActor("car"): 1})
        traffic = t.Traffic([mixed], trips=[*cars, *trips])
        routes = _routes(build_described(folder, t.Scenario(traffic={"x": traffic})))
        assert routes["car"][-1] == "bd"
        assert all(edges[-1] != "bd" for vehicle, edges in routes.items() if vehicle != "car")
        alone = t.Traffic([], trips=[t.Trip(f"c{number}", route) for number, route in enumerate(drawn)])
        of_cars = _routes(build_described(folder, t.Scenario(traffic={"x": alone})))
        assert any(edges[-1] == "bd" for edges in of_cars.values())

    @pytest.mark.parametrize(
        ("closed", "route", "kinds", "problem"),
        [
            (
                "passenger",
                DETOUR,
                ["passenger", "truck"],
                "no way for vehicles of types 'passenger' and 'truck' together leads from edge 'east'",
            ),
            ("truck", DETOUR, ["truck"], "no way for vehicles of type 'truck' leads from edge 'east'"),
            ("all", t.RandomRoute("1"), ["truck"], "no road of the map is open to vehicles of type 'truck'"),
        ],
    )
    def test_errors_name_the_vehicles_without_a_way(self, tmp_path, closed, route, kinds, problem):
        """The way over "middle" is closed to trucks; that over "down", or all roads, to others, too."""
        folder = sources.write_detour(tmp_path / "detour")
        edges = (folder / "map.edg.xml").read_text()
        if closed == "all":
            edges = re.sub("( disallow=.truck.|) ?/>", ' disallow="truck"/>', edges)
        else:
            edges = edges.replace('"down"', f'"down" disallow="{closed}"')
        (folder / "map.edg.xml").write_text(edges)
        flow = t.Flow(route, 60, actors={t.TrafficActor(kind, vehicle_type=kind): 1 for kind in kinds})
        with raises(ScenarioError, values=["traffic['x'].flows[0].route", problem, "vehicle type"]):
            build_described(folder, t.Scenario(traffic={"x": t.Traffic([flow])}))

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

    def test_folders_can_be_moved(self, built_folder):
        folder = built_folder
        build_scenario(folder)
        moved = folder.rename(folder.parent / "moved")
        before = ages(moved)
        assert build_scenario(moved).directory.is_relative_to(moved)
        assert ages(moved) == before

    def test_folders_that_cannot_be_written_build_into_the_cache(self, scenario_folder, tmp_path):
        folder = scenario_folder()
        (folder / "build").write_text("A file in the way, which even root cannot make a folder in.")
        built = build_scenario(folder)
        assert built.directory.is_relative_to(tmp_path / "cache")
        assert build_scenario(folder) == built

    def test_no_place_at_all(self, scenario_folder, tmp_path):
        folder = scenario_folder()
        for name in (folder / "build", tmp_path / "cache"):
            name.write_text("in the way")
        with raises(ScenarioError, values=["XDG_CACHE_HOME"]):
            build_scenario(folder)


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
    @pytest.mark.slow
    def test_several_at_once(self, scenario_folder):
        folder, count = scenario_folder(), 4
        processes = [start_build(folder) for _ in range(count)]
        outputs = {process.communicate()[0] for process in processes}
        assert [process.returncode for process in processes] == [0] * count
        assert len(outputs) == 1
        built = build_scenario(folder)
        assert outputs == {f"ready\n{built.directory}\n"}
        assert sorted(entry.name for entry in (folder / "build").iterdir()) == sorted(
            [".lock", "index", built.directory.name]
        )

    @pytest.mark.slow
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

    def test_each_traffic_is_drawn_by_its_own_seed(self, scenario_folder):
        folder = scenario_folder(script=None)
        drawn = t.Traffic([], trips=[t.Trip(f"v{n}", t.RandomRoute(str(n))) for n in range(9)])

        def files(**seeds):
            for name, seed in seeds.items():
                gen_traffic(folder, drawn, name=name, seed=np.int64(seed))
            built = build_scenario(folder)
            return {name: built.traffic[name].routes[0].read_text() for name in seeds}

        first, second = files(a=1, b=2), files(b=3)
        assert files(a=1)["a"] == first["a"]
        assert second["b"] != first["b"]
        gen_missions(folder, [t.Mission(WEST_EAST)], seed=8)
        gen_missions(folder, [t.Mission(WEST_EAST)] * 2)
        built = build_scenario(folder)
        assert built.traffic["a"].routes[0].read_text() == first["a"]
        again = build_scenario(folder, seed=1)
        assert again.traffic["a"].routes[0].read_text() == first["a"]
        assert again.traffic["b"].routes[0].read_text() == files(b=1)["b"]


class TestSuite:
    def test_the_list_names_folders(self):
        assert {name for name in suite() if not (SUITE / name / "scenario.py").is_file()} == set()
        assert all(suite().values())

    def test_names_are_found(self, monkeypatch, tmp_path):
        monkeypatch.chdir(tmp_path)
        assert build_scenario("intersection").source == SUITE / "intersection"


def test_what_has_no_effect_is_said_once(scenario_folder, caplog):
    history = "t.TrafficHistoryDataset('x', 'NGSIM', None)"
    folder = scenario_folder(sources.scenario(f"traffic_histories=[{history}]"))
    for _ in range(2):
        build_scenario(folder)
    (said,) = [record for record in caplog.records if record.name == "smarts"]
    assert said.levelname == "WARNING"
    assert f"{folder}/scenario.py: traffic_histories: without effect" in said.getMessage()
