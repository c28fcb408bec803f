"""Scenario files and maps that never come to an end."""

import os
import signal
import subprocess
import sys
import time

from smarts.errors import ScenarioError
from smarts.roads.children import TIME_LIMIT_VARIABLE
from smarts.sstudio.build import build_scenario
from tests.raising import raises

from . import sources


def test_scenario_files_that_never_end(scenario_folder, monkeypatch):
    monkeypatch.setenv(TIME_LIMIT_VARIABLE, "1")
    folder = scenario_folder("while True: pass")
    with raises(ScenarioError, values=["1 s"]) as caught:
        build_scenario(folder)
    assert caught.value.place == str(folder / "scenario.py")
    assert TIME_LIMIT_VARIABLE in caught.value.remedy


def test_what_scenario_files_leave_running_holds_nobody_up(scenario_folder):
    left = "import subprocess, threading, time\nsubprocess.Popen(['sleep', '60'])\n"
    threads = "threading.Thread(target=time.sleep, args=(60,)).start()\n"
    begin = time.monotonic()
    build_scenario(scenario_folder(left + threads + sources.SCRIPT))
    assert time.monotonic() - begin < 50


def test_interrupted_builds_say_nothing_of_the_runner(scenario_folder):
    folder = scenario_folder("import time\nprint('begun', flush=True)\ntime.sleep(60)")
    code = (
        "import signal, sys\n"
        # Who was started in the background ignores it.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from smarts.sstudio import build_scenario; build_scenario(sys.argv[1])"
    )
    build = subprocess.Popen(
        [sys.executable, "-c", code, str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    with build:
        assert build.stdout.readline() == "begun\n"
        os.killpg(build.pid, signal.SIGINT)  # as Ctrl-C does
        said = build.stderr.read()
    assert said.rstrip().endswith("KeyboardInterrupt")
    assert said.count("Traceback") == 1
    assert "runner.py" not in said
