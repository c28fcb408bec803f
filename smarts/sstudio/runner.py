"""Runs a scenario file in its own process and writes the scenario as JSON.

    python -m smarts.sstudio.runner SCENARIO_FILE ANSWER_FILE_DESCRIPTOR SEED [VARIATION]

Its own process, so that each run is the same (fresh modules, a fixed order of sets, fixed seeds, its own
folder as the working directory) and leaves nothing behind.
"""

from __future__ import annotations

import contextlib
import inspect
import json
import os
import re
import runpy
import site
import sys
import sysconfig
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from smarts.errors import ScenarioError, SmartsError, nearest_names
from smarts.sstudio import types
from smarts.sstudio.collecting import Collection, collecting
from smarts.sstudio.encoding import Json, encode
from smarts.sstudio.sstypes.drawing import fresh_drawing

PACKAGE = Path(__file__).resolve().parents[1]
NOT_SOURCES = {"build", "__pycache__"}
"""Folders beside a scenario file that others write to."""
_WRONG_KEYWORD = re.compile(r"(\w+)\.__init__\(\) got an unexpected keyword argument '(\w+)'")


def main(arguments: list[str]) -> None:
    """Run the file and write the answer: what it says, or the error."""
    script, answer_file, seed = Path(arguments[0]), int(arguments[1]), int(arguments[2])
    wanted = arguments[3] if len(arguments) > 3 else None
    sys.dont_write_bytecode = True
    sys.path.insert(0, str(script.parent))
    try:
        answer = json.dumps(_describe(script, seed, wanted))
    except BaseException as error:
        # Even exceptions that end a process: the answer is the only way to report them.
        problem = f"writing it down failed: {type(error).__name__}: {error}"
        said = error if isinstance(error, SmartsError) else ScenarioError(problem, place=str(script))
        reply = {"problem": said.problem, "place": said.place, "remedy": said.remedy}
        answer = json.dumps({"error": reply})
    with open(answer_file, "w", encoding="utf-8") as file:
        file.write(answer)
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
    os._exit(0)  # at once, whatever threads the file has left running


def _describe(script: Path, seed: int, wanted: str | None) -> Json:
    _seed_global_generators(seed)
    opened = _record_opened(script.parent)
    with collecting(wanted) as collection, fresh_drawing(seed):
        _run(script)
        read = set(opened)
        scenario = _encoded(collection, script)
    return {
        "scenario": scenario,
        "seed": seed if collection.seed is None else collection.seed,
        "files": sorted((read | _own_modules()) - {str(script)}),
        "is_wanted": collection.is_wanted,
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
    except BaseException as error:
        problem = f"the scenario file raises {type(error).__name__}: {error}".removesuffix(": ")
        raise ScenarioError(problem, place=_culprit(error, script), remedy=_known_names(error)) from error


def _known_names(error: BaseException) -> str:
    """Return the remedy for a name that `sstudio.types`, or a constructor of its classes, does not have."""
    if isinstance(error, AttributeError) and getattr(error.obj, "__name__", "") == types.__name__:
        return nearest_names(str(error.name), [name for name in vars(types) if name[0].isupper()])
    wrong = _WRONG_KEYWORD.fullmatch(str(error))
    if wrong and hasattr(types, wrong[1]):
        return nearest_names(wrong[2], inspect.signature(getattr(types, wrong[1])).parameters)
    return ""


def _culprit(error: BaseException, script: Path) -> str:
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


def _record_opened(folder: Path) -> set[str]:
    """Return a set that from now on takes in every file under `folder` that is opened for reading.

    Missing files count too: the scenario may change once they exist.
    """
    opened: set[str] = set()
    root = str(folder) + os.sep

    def record(event: str, arguments: Sequence[Any]) -> None:
        if event not in ("open", "sqlite3.connect") or not isinstance(
            arguments[0], str | bytes | os.PathLike
        ):
            return
        mode = arguments[1] if len(arguments) > 1 else None
        if isinstance(mode, str) and mode[:1] in ("w", "x", "a"):
            return
        path = os.path.realpath(os.fsdecode(arguments[0]))
        if path.startswith(root) and path[len(root) :].split(os.sep)[0] not in NOT_SOURCES:
            opened.add(path)

    sys.addaudithook(record)
    return opened


def _own_modules() -> set[str]:
    """Return the files of all imported modules that are neither installed packages nor part of SMARTS."""
    paths = sysconfig.get_paths()
    places = [paths[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    places += [*site.getsitepackages(), site.getusersitepackages()]
    installed = [PACKAGE, *(Path(place).resolve() for place in places)]
    names = [getattr(module, "__file__", None) for module in list(sys.modules.values())]
    files = {Path(name).resolve() for name in names if isinstance(name, str)}
    return {
        str(file)
        for file in files
        if file.is_file() and not any(file.is_relative_to(place) for place in installed)
    }


def _seed_global_generators(seed: int) -> None:
    # The one place that touches the process-wide generators: scenario files written for the original draw
    # from them directly, and must give the same scenario at every build. This process ends with the file.
    import random  # noqa: TID251

    import numpy

    random.seed(seed)
    numpy.random.seed(seed % 2**32)  # noqa: NPY002


if __name__ == "__main__":
    main(sys.argv[1:])
