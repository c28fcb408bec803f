"""What a process may use, read from files as machines and containers have them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmark.running.machine import (
    cores_text,
    cpu_quota,
    memory_limit,
    memory_text,
    total_memory,
    usable_cores,
)

GIB = 2**30
V2 = "31 23 0:28 {top} /sys/fs/cgroup rw,nosuid - cgroup2 cgroup2 rw,nsdelegate\n"
V1 = "31 23 0:28 {top} /sys/fs/cgroup/{name} rw,nosuid shared:9 - cgroup cgroup rw,{name}\n"
DISK = "25 1 8:1 / / rw,relatime - ext4 /dev/sda1 rw\n"


@pytest.fixture
def machine(tmp_path):
    """Return a function that writes the files of a machine, and returns their root."""

    def write(groups="", mounts="", **files):
        (tmp_path / "proc/self").mkdir(parents=True)
        (tmp_path / "proc/self/cgroup").write_text(groups)
        (tmp_path / "proc/self/mountinfo").write_text(DISK + mounts)
        for name, text in files["files"].items() if files else ():
            file = tmp_path / "sys/fs/cgroup" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text + "\n")
        return tmp_path

    return write


def test_a_machine_without_control_groups(machine):
    root = machine()
    assert (memory_limit(root), cpu_quota(root)) == (None, None)


def test_a_group_of_version_2_and_those_around_it(machine):
    root = machine(
        "0::/box/job\n",
        V2.format(top="/"),
        files={
            "box/memory.max": str(2 * GIB),
            "box/cpu.max": "120000 100000",
            "box/job/memory.max": str(3 * GIB),
            "box/job/cpu.max": "150000 100000",
            "else/memory.max": str(GIB),
        },
    )
    assert (memory_limit(root), cpu_quota(root)) == (2 * GIB, 1.2)


def test_a_group_of_version_2_without_limits(machine):
    root = machine("0::/\n", V2.format(top="/"), files={"memory.max": "max", "cpu.max": "max 100000"})
    assert (memory_limit(root), cpu_quota(root)) == (None, None)


@pytest.mark.parametrize("path", ["/docker/4f/job", "/job"], ids=["as from outside", "as from inside"])
def test_a_container_of_version_2_that_sees_only_its_part_of_the_tree(machine, path):
    files = {"job/memory.max": str(GIB), "memory.max": str(2 * GIB), "cpu.max": "50000 100000"}
    root = machine(
        f"0::{path}\n",
        V2.format(top="/docker/4f"),
        files=files,
    )
    assert (memory_limit(root), cpu_quota(root)) == (GIB, 0.5)


def test_groups_of_version_1_each_in_its_own_tree(machine):
    mounts = V1.format(top="/", name="memory") + V1.format(top="/docker/4f", name="cpu,cpuacct")
    files = {
        "memory/memory.limit_in_bytes": str(2**63 - 4096),
        "memory/mine/memory.limit_in_bytes": str(4 * GIB),
        "cpu,cpuacct/cpu.cfs_quota_us": "250000",
        "cpu,cpuacct/cpu.cfs_period_us": "100000",
        # The place of its other controller: not around this process.
        "memory/docker/4f/memory.limit_in_bytes": str(GIB),
    }
    groups = "4:memory:/mine\n3:cpu,cpuacct:/docker/4f\n1:name=systemd:/\n0::/\n"
    root = machine(groups, mounts, files=files)
    assert (memory_limit(root), cpu_quota(root)) == (4 * GIB, 2.5)


def test_groups_of_version_1_without_limits(machine):
    mounts = V1.format(top="/", name="memory") + V1.format(top="/", name="cpu")
    files = {
        "memory/memory.limit_in_bytes": str(2**63 - 4096),
        "cpu/cpu.cfs_quota_us": "-1",
        "cpu/cpu.cfs_period_us": "100000",
    }
    root = machine("4:memory:/\n3:cpu:/\n", mounts, files=files)
    assert (memory_limit(root), cpu_quota(root)) == (None, None)


def test_cores_are_those_that_the_process_may_run_on():
    one = min(os.sched_getaffinity(0))
    code = f"import os; os.sched_setaffinity(0, [{one}])\nfrom benchmark.running.machine import usable_cores"
    code += "\nprint(usable_cores())"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out == "1\n"
    assert usable_cores() == len(os.sched_getaffinity(0))


def test_limits_in_words():
    assert memory_text(8 * GIB, None) == memory_text(8 * GIB, 8 * GIB) == "8.0 GiB"
    assert memory_text(8 * GIB, 3 * GIB // 2).startswith("1.5 GiB (")
    assert cores_text(4, 4, None) == cores_text(4, 4, 4.0) == "4 cores"
    assert cores_text(4, 2, 3.0) == "2 of 4 cores"
    assert cores_text(4, 2, 1.5).startswith("2 of 4 cores, 1.5 ")


def test_the_memory_of_this_machine_is_that_of_the_kernel():
    line = next(
        line for line in Path("/proc/meminfo").read_text().splitlines() if line.startswith("MemTotal")
    )
    assert total_memory() == 1024 * int(line.split()[1])
