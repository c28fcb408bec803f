"""Runs a scenario file in a process of its own and writes down what it says.

    python -m smarts.sstudio.runner SCENARIO_FILE ANSWER_PIPE SEED

A process of its own, so that the file meets the same world every time: fresh modules, a fixed order of
sets, fixed seeds, its own folder as the working directory; and so that nothing it does stays behind.
"""

from __future__ import annotations

import json
import runpy
import sys
import traceback
from pathlib import Path

from smarts.errors import ScenarioError, SmartsError
from smarts.sstudio.collecting import Collection, collecting
from smarts.sstudio.encoding import Json, encode
from smarts.sstudio.sstypes.drawing import fresh_drawing

PACKAGE = Path(__file__).resolve().parents[1]


def main(arguments: list[str]) -> None:
    """Run the file and write the answer: what it says, or the error."""
    script, pipe, seed = Path(arguments[0]), int(arguments[1]), int(arguments[2])
    sys.dont_write_bytecode = True
    sys.path.insert(0, str(script.parent))
    try:
        reply = _describe(script, seed)
    except SmartsError as error:
        reply = {"error": {"problem": error.problem, "place": error.place, "remedy": error.remedy}}
    with open(pipe, "w", encoding="utf-8") as answer:
        json.dump(reply, answer)


def _describe(script: Path, seed: int) -> Json:
    _seed_global_generators(seed)
    with collecting() as collection, fresh_drawing(seed):
        _run(script)
    return {
        "scenario": _encoded(collection, script),
        "seed": seed if collection.seed is None else collection.seed,
        "modules": _own_modules(script),
    }


def _run(script: Path) -> None:
    try:
        runpy.run_path(str(script), run_name="__main__")
    except SystemExit as stop:
        if stop.code not in (None, 0):
            raise ScenarioError(f"the scenario file exits with {stop.code!r}", place=str(script)) from stop
    except SmartsError as error:
        place = ", ".join(filter(None, (_culprit(error, script), error.place)))
        raise ScenarioError(error.problem, place=place, remedy=error.remedy) from error
    except Exception as error:
        problem = f"the scenario file raises {type(error).__name__}: {error}"
        raise ScenarioError(problem, place=_culprit(error, script)) from error


def _culprit(error: Exception, script: Path) -> str:
    """Return the innermost line of the scenario's own files that led to the error."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}, line {error.lineno}"
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if Path(frame.filename).parent == script.parent]
    return f"{own[-1].filename}, line {own[-1].lineno}" if own else str(script)


def _encoded(collection: Collection, script: Path) -> Json:
    if collection.scenario is None:
        raise ScenarioError(
            "the scenario file describes no scenario",
            place=str(script),
            remedy="end it with gen_scenario(Scenario(...), output_dir=Path(__file__).parent)",
        )
    try:
        return encode(collection.scenario)
    except ScenarioError as error:
        raise ScenarioError(error.problem, place=f"{script}: {error.place}", remedy=error.remedy) from error


def _own_modules(script: Path) -> list[str]:
    """Return the files of all imported modules that are neither installed packages nor part of SMARTS."""
    installed = [Path(prefix).resolve() for prefix in {sys.prefix, sys.base_prefix}]
    files = []
    for module in list(sys.modules.values()):
        name = getattr(module, "__file__", None)
        file = Path(name).resolve() if name else script
        foreign = any(file.is_relative_to(prefix) for prefix in (*installed, PACKAGE))
        if file != script and not foreign and file.is_file():
            files.append(str(file))
    return sorted(set(files))


def _seed_global_generators(seed: int) -> None:
    # The one place that touches the process-wide generators: scenario files written for the original draw
    # from them directly, and must say the same at every build. This process ends with the file.
    import random

    import numpy

    random.seed(seed)
    numpy.random.seed(seed % 2**32)  # noqa: NPY002


if __name__ == "__main__":
    main(sys.argv[1:])
