"""What a scenario file says, found out by running it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from smarts.errors import ScenarioError
from smarts.sstudio.decoding import decode
from smarts.sstudio.sstypes.scenario import Scenario


@dataclass(frozen=True)
class Description:
    """A scenario as it was described."""

    scenario: Scenario
    seed: int
    """For what is drawn when the scenario is built."""
    modules: tuple[Path, ...] = ()
    """Python files that the scenario file imports: it says something else when they change."""


def run_scenario_file(script: Path, seed: int) -> Description:
    """Run a scenario file and return what it says.

    The file runs in its own folder and in a process of its own; what it prints is shown.

    Raises:
        ScenarioError: The file raises (the place is its line), describes no scenario, or one that cannot be
            written down.
    """
    answer, code = _answer(script, seed)
    if not answer:
        raise ScenarioError(
            f"the scenario file ended its process with code {code} before it was done",
            place=str(script),
            remedy="run it with python to see what happens",
        )
    reply = json.loads(answer)
    if "error" in reply:
        raise ScenarioError(**reply["error"])
    modules = tuple(Path(file) for file in reply["modules"])
    return Description(decode(reply["scenario"]), reply["seed"], modules)


def _answer(script: Path, seed: int) -> tuple[str, int]:
    """Return what the runner writes into a pipe, and its exit code."""
    reader, writer = os.pipe()
    command = [sys.executable, "-m", "smarts.sstudio.runner", str(script), str(writer), str(seed)]
    with open(reader, encoding="utf-8") as answer:
        try:
            process = subprocess.Popen(command, cwd=script.parent, env=_environment(), pass_fds=[writer])
        finally:
            os.close(writer)  # so that the pipe ends when the runner does
        with process:
            return answer.read(), process.wait()


def _environment() -> dict[str, str]:
    """Return this process's environment and import path, with a fixed order of sets."""
    path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
    return os.environ | {"PYTHONPATH": path, "PYTHONHASHSEED": "0"}
