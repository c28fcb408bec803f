"""Children end with their parent, after a while, and with all that they have started."""

import os
import signal
import subprocess
import sys
import time

import pytest

from smarts.roads.children import TIME_LIMIT_VARIABLE, run_child

SLEEP = "import time; time.sleep(60)"
PARENT = """
import os, sys
from pathlib import Path
from smarts.roads.children import run_child
child = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
run_child([sys.executable, "-c", child], cwd=Path("."), env=os.environ)
"""


def ends(pid, within=20.0):
    """Return whether a process is gone, or only waits for its parent to notice, before long."""
    deadline = time.monotonic() + within
    while time.monotonic() < deadline:
        try:
            with open(f"/proc/{pid}/stat") as file:
                if file.read().rpartition(")")[2].split()[0] in "ZX":
                    return True
        except FileNotFoundError:
            return True
        time.sleep(0.05)
    return False


def run(code, tmp_path, **more):
    return run_child([sys.executable, "-c", code], cwd=tmp_path, env=os.environ, **more)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_children_end_with_their_parent(tmp_path, number):
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    with parent:
        child = int(parent.stdout.readline())
        parent.send_signal(number)
        parent.wait()
        assert ends(child)


def test_the_time_limit(tmp_path, monkeypatch):
    monkeypatch.setenv(TIME_LIMIT_VARIABLE, "0.5")
    with pytest.raises(TimeoutError, match=r"0\.5 s"):
        run(SLEEP, tmp_path)


def test_what_a_child_leaves_behind_ends_with_it(tmp_path):
    start = f"subprocess.Popen([sys.executable, '-c', {SLEEP!r}])"
    code = f"import subprocess, sys; print({start}.pid, file=open('pid', 'w'))"
    assert run(code, tmp_path) == 0
    assert ends(int((tmp_path / "pid").read_text()))
