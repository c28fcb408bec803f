"""Processes, files and sockets that agents in processes of their own may leave behind."""

import os
import tempfile
from pathlib import Path


def descendants():
    """Return the numbers of all processes below this one that still run."""
    parents = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            try:
                text = (folder / "stat").read_text()
            except OSError:
                continue
            status, parent = text.rpartition(")")[2].split()[:2]
            if status != "Z":
                parents[int(folder.name)] = int(parent)
    below = {os.getpid()}
    while True:
        more = {pid for pid, parent in parents.items() if parent in below} - below
        if not more:
            return below - {os.getpid()}
        below |= more


def resources():
    """Return what a host may leave behind: processes, files of its own, open sockets."""
    sockets = sum(Path(f"/proc/self/fd/{fd}").is_socket() for fd in os.listdir("/proc/self/fd"))
    return descendants(), {each.name for each in Path(tempfile.gettempdir()).iterdir()}, sockets


def is_running(pid):
    """Return whether a process runs; one that has ended and is not waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
