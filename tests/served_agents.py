"""Agents that a process of their own serves at an address."""

import os
import signal
import subprocess
import sys
from contextlib import contextmanager

KIT_AGENT = """
from smarts_agent_kit import BatchAgent, uniform

class Drawing(BatchAgent):
    interface = {"action": "Lane", "vehicle_model": "kinematic", "done_criteria": {"off_route": False}}
    observation = ["speed"]

    def act(self, batch):
        return (uniform(batch.seed, batch.step, 1)[:, 0] < 0.3).astype(int)
"""


@contextmanager
def served(*command, **environment):
    """Serve an agent in a process of its own; yield its address."""
    process = subprocess.Popen(
        [sys.executable, *command], stdout=subprocess.PIPE, text=True, env={**os.environ, **environment}
    )
    try:
        line = process.stdout.readline()
        assert line.startswith("serving tcp://"), line
        yield line.split()[1]
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(20)
        process.stdout.close()


@contextmanager
def kit_agent(folder, **environment):
    """Serve `KIT_AGENT` from a folder; yield its address."""
    (folder / "drawing.py").write_text(KIT_AGENT)
    command = ("-m", "smarts_agent_kit", "drawing:Drawing", "--address", "127.0.0.1:0")
    with served(*command, PYTHONPATH=str(folder), **environment) as address:
        yield address
