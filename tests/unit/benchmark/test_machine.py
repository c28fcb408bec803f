"""What a process may use of a machine."""

import importlib.util
import os
import shutil
import subprocess
import sys

from benchmark.running import machine
from benchmark.running.machine import memory_text, usable_cores


def test_cores_are_those_that_the_process_may_run_on():
    one = min(os.sched_getaffinity(0))
    code = f"import os; os.sched_setaffinity(0, [{one}])\nfrom benchmark.running.machine import usable_cores"
    code += "\nprint(usable_cores())"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert float(out) == 1
    assert usable_cores() <= len(os.sched_getaffinity(0))


def test_memory_is_the_machines_or_the_containers(monkeypatch):
    with open("/proc/meminfo") as file:
        line = next(line for line in file if line.startswith("MemTotal"))
    whole = f"{int(line.split()[1]) / 2**20:.1f} GiB"
    monkeypatch.setattr(machine, "get_system_memory", lambda: 2**63)  # control groups 1 without a limit
    assert memory_text() == whole
    monkeypatch.setattr(machine, "get_system_memory", lambda: 2**28)
    assert memory_text().startswith("0.2 GiB (")
    assert whole in memory_text()


def test_the_repository_around_an_installation_is_not_its_commit(tmp_path):
    def git(*words):
        named = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
        subprocess.run(["git", "-C", str(tmp_path), *named, *words], check=True, capture_output=True)

    file = tmp_path / "lib" / "benchmark" / "running" / "machine.py"
    file.parent.mkdir(parents=True)
    shutil.copy(machine.__file__, file)
    spec = importlib.util.spec_from_file_location("installed", file)
    installed = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(installed)
    git("init")
    git("commit", "--allow-empty", "-m", "of another project")
    assert installed.commit() is None
    git("add", ".")
    assert installed.commit().endswith("+")
    git("commit", "-m", "with the file")
    assert len(installed.commit()) == 12
    (file.parent / "more").mkdir()
    for name in ("new.py", "tyre.yaml"):
        (file.parent / "more" / name).touch()
        assert installed.commit().endswith("+")
        (file.parent / "more" / name).unlink()
    assert not installed.commit().endswith("+")
