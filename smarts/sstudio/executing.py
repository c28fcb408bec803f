"""Runs a scenario file and returns the scenario that it describes."""

from __future__ import annotations

import json
import os
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from smarts.errors import ScenarioError
from smarts.roads.children import TIME_LIMIT_VARIABLE, run_child, time_limit
from smarts.sstudio.decoding import decode
from smarts.sstudio.sstypes.scenario import Scenario


@dataclass(frozen=True)
class Description:
    """A scenario as it was described."""

    scenario: Scenario
    seed: int
    """Seed of the build."""
    files: tuple[Path, ...] = ()
    """Files that the scenario file imports or reads; the scenario may change with them."""
    is_wanted: bool = False
    """Whether the scenario is the variation that was wanted, and not the one that may have it."""


def run_scenario_file(script: Path, seed: int, wanted: str | None = None) -> Description:
    """Run a scenario file and return its scenario; of a family of maps, the map named `wanted`.

    The file runs in its own folder and in a process of its own, for `smarts.roads.children.TIME_LIMIT` at
    the longest; what it prints is shown, and it cannot ask for input.

    Raises:
        ScenarioError: The file raises (the place is its line), takes too long, describes no scenario, or one
            that cannot be written down.
    """
    script = script.resolve()
    answer, code = _answer(script, seed, wanted)
    if not answer:
        raise ScenarioError(
            f"the scenario file ended its process with code {code} before it was done",
            place=str(script),
            remedy="run it with python to see what happens",
        )
    reply = json.loads(answer)
    if "error" in reply:
        raise ScenarioError(**reply["error"])
    files = tuple(Path(file) for file in reply["files"])
    return Description(decode(reply["scenario"]), reply["seed"], files, reply["is_wanted"])


def _answer(script: Path, seed: int, wanted: str | None) -> tuple[bytes, int]:
    """Return what the runner writes into a file without a name, and its exit code."""
    with tempfile.TemporaryFile() as answer:
        number = answer.fileno()
        command = [sys.executable, "-m", "smarts.sstudio.runner", str(script), str(number), str(seed)]
        command += [] if wanted is None else [wanted]
        try:
            code = run_child(command, cwd=script.parent, env=_environment(), keep=[number])
        except TimeoutError as error:
            raise ScenarioError(
                f"the scenario file was still running after {time_limit():g} s",
                place=str(script),
                remedy=f"make it end, or set {TIME_LIMIT_VARIABLE} to more seconds",
            ) from error
        answer.seek(0)
        return answer.read() if code == 0 else b"", code


def _environment() -> dict[str, str]:
    """Return this process's environment and import path, with a fixed order of sets."""
    path = os.pathsep.join(entry or os.getcwd() for entry in sys.path)
    return os.environ | {"PYTHONPATH": path, "PYTHONHASHSEED": "0"}
