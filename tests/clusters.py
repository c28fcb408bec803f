"""Ray clusters of several nodes on this machine, which share nothing that a cluster of machines would not."""

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path

from ray.cluster_utils import Cluster

from tests.commands import LIMIT, ROOT

HIDES = subprocess.run(["unshare", "-r", "-m", "true"], check=False, capture_output=True).returncode == 0
"""Whether the system lets a process have folders that others do not see."""
ON_A_NODE = "NODE_OF_A_TEST"
"""Environment variable of the nodes' processes."""
TOKEN = Path.home() / ".ray" / "auth_token"
"""Ray's, which all machines of a cluster need."""


class Nodes:
    """A cluster whose nodes have folders of their own: home, temporary files, Ray's files."""

    def __init__(self, root, cpus):
        # Not below pytest's folder: paths of sockets have 107 characters at most.
        self.root, self._cluster = root, Cluster()
        self.nodes = [self._add(f"n{number}", count) for number, count in enumerate(cpus)]
        self.address = self._cluster.address

    def _add(self, name, cpus):
        home = self.root / name
        (home / "tmp").mkdir(parents=True)
        # As users copy it: a process that has started Ray before asks for it.
        if TOKEN.exists():
            (home / TOKEN.parent.name).mkdir()
            shutil.copy(TOKEN, home / TOKEN.parent.name)
        places = {"HOME": home, "XDG_CACHE_HOME": home / "cache", "TMPDIR": home / "tmp", ON_A_NODE: name}
        # A node that is killed is missed after 2 s instead of 15 s.
        config = {"health_check_period_ms": 500, "health_check_failure_threshold": 4}
        return self._cluster.add_node(
            num_cpus=cpus,
            _system_config=None if self._cluster.head_node else config,
            env_vars={key: str(place) for key, place in places.items()},
            temp_dir=str(home / "ray"),
            object_store_memory=80 * 2**20,
        )

    def kill(self, node):
        """Kill all processes of a node, as a power cut does."""
        self._cluster.remove_node(node, allow_graceful=False)
        self.nodes.remove(node)

    def workers(self, title):
        """Return process id -> node of Ray's workers with a title."""
        raylets = {node.all_processes["raylet"][0].process.pid: node for node in self.nodes}
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
                if parent in raylets and title in (folder / "cmdline").read_bytes().decode():
                    found[int(folder.name)] = raylets[parent]
            except OSError:
                continue
        return found

    def left_over(self):
        """Return the temporary folders of runs on the driver's node that have not been removed."""
        return [*self.root.glob("n0/tmp/*smarts-bench-*")]

    def shutdown(self):
        """End all nodes."""
        self._cluster.shutdown()


@contextmanager
def nodes(*cpus):
    """Provide a cluster whose nodes have these numbers of CPUs; the first is the driver's."""
    root = Path("/tmp", f"sb{os.getpid()}")
    shutil.rmtree(root, ignore_errors=True)
    made = Nodes(root, cpus)
    try:
        yield made
    finally:
        workers = made.workers("ray::")
        made.shutdown()
        for process in workers:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        shutil.rmtree(root, ignore_errors=True)


class Driver:
    """The machine that commands run on: a folder that nodes see empty."""

    def __init__(self, folder):
        self.folder, self.content = folder / "driver", folder / "content"
        self.folder.mkdir()
        self.content.mkdir()
        if not HIDES:
            self.folder.rmdir()
            self.folder.symlink_to(self.content)

    def begin(self, *arguments):
        """Start `smarts-bench` with arguments, which name files in `folder`; they are in `content`."""
        command = [sys.executable, "-m", "benchmark.cli", *map(str, arguments)]
        if HIDES:
            hide = 'mount --bind "$1" "$2"; shift 2; exec "$@"'
            places = [str(self.content), str(self.folder)]
            command = ["unshare", "-r", "-m", "sh", "-c", hide, "sh", *places, *command]
        return subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=ROOT,
            start_new_session=True,
        )

    def is_hidden(self):
        """Return whether nothing was written into the folder that nodes see."""
        return not HIDES or not [*self.folder.iterdir()]


def eventually(condition):
    """Wait until a condition holds, and return what it is."""
    end = time.monotonic() + LIMIT
    while not (found := condition()):
        assert time.monotonic() < end, "nothing happened"
        time.sleep(0.1)
    return found
