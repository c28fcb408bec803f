"""Runs SUMO's own programs: its converters, and SUMO itself on each new map before it is simulated here."""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

from smarts.errors import MapError
from smarts.roads.children import (
    MEMORY_LIMIT_VARIABLE,
    TIME_LIMIT_VARIABLE,
    memory_limit,
    run_child,
    time_limit,
)
from smarts.roads.converter_messages import ConverterMessages

# SUMO 1.28 takes 0.08 s and 15 MB of memory for a megabyte of a network (a grid of 35 MB).
_SECONDS, _SECONDS_A_MEGABYTE = 20.0, 1.0
_GIGABYTES, _GIGABYTES_A_MEGABYTE = 1.0, 0.1
_OUT_OF_MEMORY = ("bad_alloc", "failed to map")
_QUIETLY = ("--no-step-log", "--no-warnings", "--xml-validation", "never")


def try_in_sumo(
    folder: Path, inputs: Mapping[str, Sequence[str]], options: Sequence[str], place: str, what: str
) -> None:
    """Let SUMO load files in a child process: what kills SUMO there would kill the simulation.

    Args:
        folder: The files' folder.
        inputs: The files' names by SUMO's options for them.
        options: Further options, with an end.
        place: What they were made of, for errors.
        what: What they are, "map" or "traffic".

    Raises:
        MapError: SUMO refuses the files, crashes on them, or needs more than files of their size do.
    """
    size = sum((folder / name).stat().st_size for names in inputs.values() for name in names) / 1e6
    seconds = time_limit(_SECONDS + _SECONDS_A_MEGABYTE * size)
    memory = memory_limit(_GIGABYTES + _GIGABYTES_A_MEGABYTE * size)
    named = [text for option, names in inputs.items() if names for text in (f"--{option}", ",".join(names))]
    remedy = f"mend the file{', or compile the map again with netconvert' if what == 'map' else ''}"
    try:
        code, said = run_tool("sumo", [*named, *options, *_QUIETLY], folder, seconds=seconds, memory=memory)
    except TimeoutError:
        problem = f"SUMO was still loading the {what} after {seconds:g} s"
        remedy += f", or set {TIME_LIMIT_VARIABLE} to more seconds"
    else:
        if code == 0:
            return
        reason = " ".join(said.errors)
        problem = f"SUMO refuses the {what}: {reason or f'exit code {code}'}"
        if any(each in reason for each in _OUT_OF_MEMORY):
            problem = f"SUMO needs more than {memory:.3g} GB of memory for the {what}"
            remedy += f", or set {MEMORY_LIMIT_VARIABLE} to more gigabytes"
        elif code < 0:
            problem = f"SUMO crashes on the {what} ({signal.Signals(-code).name})"
    raise MapError(problem, place=place, remedy=remedy)


def run_tool(
    tool: str,
    arguments: Sequence[str],
    folder: Path,
    *,
    seconds: float | None = None,
    memory: float | None = None,
) -> tuple[int, ConverterMessages]:
    """Run one of SUMO's programs in a folder; return its exit code and messages.

    Args:
        tool: Its name.
        arguments: Its arguments.
        folder: Its working directory.
        seconds: See `run_child`, as for `memory` [GB].
        memory: See `seconds`.

    Raises:
        MapError: SUMO is not installed, or the program does not start.
        TimeoutError: It ran too long.
    """
    program = sumo_folder() / "bin" / tool
    with tempfile.TemporaryFile() as said:
        try:
            code = run_child(
                [str(program), *arguments],
                cwd=folder,
                env=_environment(),
                stderr=said,
                seconds=seconds,
                memory=memory,
            )
        except TimeoutError:
            raise
        except OSError as error:
            raise MapError(
                f"{tool} does not start: {error.strerror}",
                place=str(program),
                remedy="reinstall SUMO: pip install --force-reinstall eclipse-sumo",
            ) from error
        said.seek(0)
        return code, ConverterMessages.parse(said.read().decode(errors="replace"))


def sumo_folder() -> Path:
    """Return the folder of the SUMO package.

    Raises:
        MapError: SUMO is not installed.
    """
    # Importing the package would set SUMO_HOME for the whole process; only its place is needed.
    spec = find_spec("sumo")
    if spec is None or spec.origin is None:
        raise MapError("SUMO is not installed", remedy="pip install eclipse-sumo==1.28.0")
    return Path(spec.origin).parent


def _environment() -> dict[str, str]:
    # SUMO_HOME would bring in another installation's type maps, and messages follow the locale.
    inherited = {key: value for key, value in os.environ.items() if key != "SUMO_HOME"}
    projections = str(sumo_folder() / "data" / "proj")
    return inherited | {"LC_ALL": "C", "PROJ_DATA": projections, "PROJ_LIB": projections}
