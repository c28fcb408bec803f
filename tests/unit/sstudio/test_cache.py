"""What becomes of artefacts: damaged ones are built anew, old ones go, commas and full disks are survived."""

import itertools
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import ClassVar

import pytest

from smarts.errors import ScenarioError
from smarts.sstudio.build import CODE, PACKAGE, build_scenario, fingerprint_program
from smarts.sstudio.cache import KEPT_DAYS, damaged_file, file_table
from tests.raising import raises

from . import sources

FILES = ("lanes.npz", "manifest.json", "scenario.json", "map.net.xml", "traffic/through.rou.xml")
DAMAGES = {
    "truncated": lambda file: os.truncate(file, 100),
    "emptied": lambda file: os.truncate(file, 0),
    "deleted": lambda file: file.unlink(),
    "garbled": lambda file: file.write_bytes(bytes(range(250))),
}


class TestDamage:
    @pytest.mark.parametrize("names", [FILES[:1], pytest.param(FILES[1:], marks=pytest.mark.slow)])
    def test_damaged_artefacts_are_built_anew(self, built_folder, names):
        directory = build_scenario(built_folder).directory
        whole = {name: (directory / name).read_bytes() for name in FILES}
        for name, damage in zip(names, itertools.cycle(DAMAGES.values()), strict=False):
            damage(directory / name)
            assert Path(damaged_file(directory)).name == Path(name).name
            assert build_scenario(built_folder).directory == directory
            assert {name: (directory / name).read_bytes() for name in FILES} == whole
        assert not list((built_folder / "build").glob(".partial-*"))

    @pytest.mark.parametrize("damage", DAMAGES)
    @pytest.mark.parametrize("name", ["a", "manifest.json"])
    def test_every_damage_is_found(self, tmp_path, name, damage):
        (tmp_path / "a").write_text("a" * 1000)
        (tmp_path / "manifest.json").write_text(json.dumps({"files": file_table(tmp_path)}))
        assert damaged_file(tmp_path) is None
        DAMAGES[damage](tmp_path / name)
        assert damaged_file(tmp_path) == name

    @pytest.mark.parametrize("manifest", ["null", "[]", "{}", '{"files": 5}', '{"files": {"a": 1}}'])
    def test_manifests_of_another_shape(self, tmp_path, manifest):
        (tmp_path / "a").write_text("a")
        (tmp_path / "manifest.json").write_text(manifest)
        assert damaged_file(tmp_path) == "manifest.json"

    def test_damage_of_equal_size_is_mended_at_the_next_start(self, built_folder):
        directory = build_scenario(built_folder).directory
        for name in ("map.net.xml", "traffic/through.rou.xml"):
            whole = (directory / name).read_bytes()
            (directory / name).write_bytes(whole.replace(b"from_west", b"from_wset"))
            assert damaged_file(directory) == name
            build_scenario(built_folder)
            assert (directory / name).read_bytes() == whole

    def test_damage_that_is_done_later_is_found_when_it_is_read_and_mended_next_time(self, built_folder):
        folder = built_folder
        built = build_scenario(folder)
        lanes = built.directory / "lanes.npz"
        lanes.write_bytes(bytes(lanes.stat().st_size))
        with raises(ScenarioError, values=["lanes.npz"]) as caught:
            built.roads()
        assert str(folder) in caught.value.place
        assert build_scenario(folder).roads().edge_number("from_west") >= 0

    @pytest.mark.parametrize(
        "body",
        ["{", *(pytest.param(body, marks=pytest.mark.slow) for body in ("[]", '{"key": 5, "files": 1}'))],
    )
    def test_damaged_entries_of_the_index(self, built_folder, body):
        built = build_scenario(built_folder)
        for entry in (built_folder / "build" / "index").iterdir():
            entry.write_text(body)
        assert build_scenario(built_folder) == built

    def test_a_damaged_map_is_not_shared(self, built_folder):
        folder = built_folder
        net = build_scenario(folder).net_file
        whole = net.read_bytes()
        net.write_bytes(bytes(len(whole)))
        (folder / "scenario.py").write_text(sources.SCRIPT.replace("600", "700"))
        assert build_scenario(folder).net_file.read_bytes() == whole


class TestPruning:
    def age(self, directory, days):
        then = time.time() - days * 86400
        os.utime(directory, (then, then))

    def test_what_nobody_asked_for_goes_with_the_next_build(self, scenario_folder):
        folder = scenario_folder()
        built = []
        for rate in (600, 700, 800):
            (folder / "scenario.py").write_text(sources.SCRIPT.replace("600", str(rate)))
            built.append(build_scenario(folder).directory)
        forgotten, used, newest = built
        self.age(forgotten, KEPT_DAYS + 1)
        self.age(used, KEPT_DAYS + 1)
        (folder / "scenario.py").write_text(sources.SCRIPT.replace("600", "700"))
        assert build_scenario(folder).directory == used
        (folder / "scenario.py").write_text(sources.SCRIPT.replace("600", "900"))
        latest = build_scenario(folder).directory
        assert [directory.is_dir() for directory in (forgotten, used, newest, latest)] == [False] + [True] * 3
        entries = [json.loads(file.read_text())["key"] for file in (folder / "build" / "index").iterdir()]
        assert set(entries) == {used.name, newest.name, latest.name}

    def test_folders_of_the_author_stay(self, scenario_folder):
        folder = scenario_folder()
        own = [folder / "build" / name for name in ("map", "my_results", "0123456789abcdef")]
        for directory in own:
            directory.mkdir(parents=True)
            self.age(directory, KEPT_DAYS + 1)
        build_scenario(folder)
        assert all(directory.is_dir() for directory in own)

    def test_what_a_run_plays_stays_however_long_it_runs(self, scenario_folder):
        folder = scenario_folder()
        played = build_scenario(folder)
        for rate, is_played in ((700, True), (800, True), (900, False)):
            self.age(played.directory, KEPT_DAYS + 1)
            if is_played:
                played.traffic_files("through")
            (folder / "scenario.py").write_text(sources.SCRIPT.replace("600", str(rate)))
            build_scenario(folder)
            assert played.directory.is_dir() == is_played

    def test_scenarios_handed_over_by_hand_stay(self, scenario_folder):
        from smarts.sstudio import gen_scenario
        from smarts.sstudio import types as t

        folder = scenario_folder(script=None)
        mission = t.Mission(t.Route(("from_south", 0, 20), ("to_north", 0, 50)))
        built = []
        for count in (1, 2, 3):
            if count == 3:
                self.age(built[0].directory, KEPT_DAYS + 1)
            gen_scenario(t.Scenario(ego_missions=[mission] * count), output_dir=folder)
            built.append(build_scenario(folder))
        assert [one.directory.is_dir() for one in built] == [False, True, True]
        assert built[2].scenario.ego_missions == (mission,) * 3


class TestWhatScenarioFilesRead:
    SCRIPT = "from pathlib import Path\nHERE = Path(__file__).parent\n" + sources.SCRIPT.replace(
        "rate=600", "rate=RATE"
    )

    READINGS: ClassVar = {
        "data/rate.csv": "float((HERE / 'data/rate.csv').read_text())",
        "rate.txt": "float(open('rate.txt').read())",
        "rate.bin": "float(Path('rate.bin').read_bytes())",
        "deep/er/rate": "float(numpy.loadtxt('deep/er/rate'))",
    }

    def test_changes_are_noticed(self, scenario_folder):
        script = f"import numpy\n{self.SCRIPT}".replace("RATE", "+".join(self.READINGS.values()))
        folder = scenario_folder(script)
        for name in self.READINGS:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text("100")
        built = build_scenario(folder)
        assert build_scenario(folder) == built
        for number, name in enumerate(self.READINGS, start=1):
            (folder / name).write_text("200")
            routes = build_scenario(folder).traffic["through"].routes[0].read_text()
            assert f'vehsPerHour="{400 + 100 * number}"' in routes

    def test_files_that_are_not_there_yet(self, scenario_folder):
        read = "try:\n    RATE = float(open('rate').read())\nexcept OSError:\n    RATE = 5\n"
        folder = scenario_folder(read + self.SCRIPT)
        first = build_scenario(folder)
        (folder / "rate").write_text("900")
        assert build_scenario(folder) != first

    def test_what_a_scenario_file_writes_does_not_count(self, scenario_folder):
        folder = scenario_folder("open('log', 'a').write('x')\n" + sources.SCRIPT)
        built = build_scenario(folder)
        (folder / "log").write_text("cleared")
        assert build_scenario(folder) == built
        assert (folder / "log").read_text() == "cleared"  # it did not run again


def test_files_that_options_of_the_map_name(scenario_folder):
    folder = scenario_folder(script=None)
    edges = sources.EDGES.replace('numLanes="2" speed="13.89"', 'type="road"')
    (folder / "map.edg.xml").write_text(edges)
    (folder / "roads.typ.xml").write_text('<types><type id="road" numLanes="1"/></types>')
    options = '<configuration><type-files value="roads.typ.xml"/></configuration>'
    (folder / "map.netccfg").write_text(options)
    assert build_scenario(folder).roads().edge_lane_count.max() == 1
    (folder / "roads.typ.xml").write_text('<types><type id="road" numLanes="3"/></types>')
    assert build_scenario(folder).roads().edge_lane_count.max() == 3


def test_all_code_that_decides_artefacts_counts(tmp_path, monkeypatch):
    for part in CODE:
        file = tmp_path / part if part.endswith(".py") else tmp_path / part / "code.py"
        file.parent.mkdir(exist_ok=True)
        file.write_text("x = 1\n")
    seen = {fingerprint_program(tmp_path)}
    for file in tmp_path.rglob("*.py"):
        file.write_text("x = 2\n")
        seen.add(fingerprint_program(tmp_path))
    assert len(seen) == len(CODE) + 1
    monkeypatch.setattr("smarts.sstudio.build.version", lambda library: "another")
    assert fingerprint_program(tmp_path) not in seen


def test_the_build_imports_no_code_that_does_not_count():
    probe = (
        "import sys, smarts.sstudio.build, smarts.sstudio.runner\n"
        "print(*{name.split('.')[1] for name in sys.modules if name.startswith('smarts.')})"
    )
    run = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert set(run.stdout.split()) <= {part.removesuffix(".py") for part in CODE}
    assert all((PACKAGE / part).exists() for part in CODE)


class TestCommas:
    def test_folders_with_a_comma_build_where_sumo_can_read(self, scenario_folder, tmp_path):
        built = build_scenario(scenario_folder(name="com,ma"))
        assert built.directory.is_relative_to(tmp_path / "cache")
        assert "," not in str(built.directory)

    def test_nowhere_without_a_comma(self, scenario_folder, tmp_path, monkeypatch):
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "a,b"))
        with raises(ScenarioError, values=["XDG_CACHE_HOME"]):
            build_scenario(scenario_folder(name="com,ma"))


def build_in_shell(limits, folder):
    code = (
        "import sys\nfrom smarts.errors import SmartsError\nfrom smarts.sstudio.build import build_scenario\n"
        "try:\n    build_scenario(sys.argv[1])\nexcept SmartsError as error:\n    sys.exit(f'named: {error}')"
    )
    command = f'{limits}; exec "$@"'
    return subprocess.run(
        ["sh", "-c", command, "sh", sys.executable, "-c", code, str(folder)], capture_output=True, text=True
    )


def test_files_that_cannot_grow(scenario_folder):
    """The limit on file sizes stands for a full disk: writing fails in the middle."""
    folder = scenario_folder()
    run = build_in_shell("ulimit -f 24; trap '' XFSZ", folder)
    assert run.stderr.startswith("named: ")
    assert str(folder) in run.stderr
    assert [entry.name for entry in (folder / "build").iterdir() if entry.name[0] not in ".i"] == []
    assert build_in_shell("true", folder).returncode == 0
    assert not list((folder / "build").rglob(".partial-*"))
