"""The command line as a user starts it, in a process of its own."""

import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
LIMIT = 400.0
"""Time limit of a command [s]."""


def begin(*arguments, **options):
    """Start `smarts-bench` with these arguments, by these options of `subprocess.Popen`."""
    return subprocess.Popen(
        [sys.executable, "-m", "benchmark.cli", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        **options,
    )


def finish(process):
    """Wait for a command; return its exit code, output and error output."""
    out, err = process.communicate(timeout=LIMIT)
    return process.returncode, out, err


def wait_for(condition, process):
    """Wait until a condition holds; fail if the command ends before that."""
    end = time.monotonic() + LIMIT
    while not condition():
        assert process.poll() is None, process.communicate()
        if time.monotonic() > end:
            process.kill()
            raise AssertionError("nothing happened")
        time.sleep(0.05)
