"""What becomes of artefacts: old ones go, commas and full disks are survived."""

import json
import os
import subprocess
import sys
import time
from typing import ClassVar

from smarts.sstudio.build import CODE, PACKAGE, build_scenario
from smarts.sstudio.cache import KEPT_DAYS
from smarts.sstudio.locating import Location

from . import sources


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


class TestWhatScenarioFilesRead:
    SCRIPT = "from pathlib import Path\nHERE = Path(__file__).parent\n" + sources.SCRIPT.replace(
        "rate=600", "rate=RATE"
    )

    READINGS: ClassVar = {
        "data/rate.csv": "float((HERE / 'data/rate.csv').read_text())",
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
            assert f'vehsPerHour="{200 + 100 * number}"' in routes

    def test_what_a_scenario_file_writes_does_not_count(self, scenario_folder):
        folder = scenario_folder("open('log', 'a').write('x')\n" + sources.SCRIPT)
        built = build_scenario(folder)
        (folder / "log").write_text("cleared")
        assert build_scenario(folder) == built
        assert (folder / "log").read_text() == "cleared"  # it did not run again


def test_a_folder_whose_name_sumo_would_split_is_built_elsewhere(tmp_path):
    (elsewhere,) = Location("maps", tmp_path / "a, b").builds
    assert "," not in str(elsewhere)


def test_the_build_imports_no_code_that_does_not_count():
    probe = (
        "import sys, smarts.sstudio.build, smarts.sstudio.runner\n"
        "print(*{name.split('.')[1] for name in sys.modules if name.startswith('smarts.')})"
    )
    run = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True)
    assert set(run.stdout.split()) <= {part.removesuffix(".py") for part in CODE}
    assert all((PACKAGE / part).exists() for part in CODE)


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
