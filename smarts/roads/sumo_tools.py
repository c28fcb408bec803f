"""Runs SUMO's own programs: its converters, and SUMO itself on each new map before it is simulated here."""

from __future__ import annotations

import os
import signal
import tempfile
from collections.abc import Mapping, Sequence
from importlib.metadata import distribution
from pathlib import Path

from smarts.errors import MapError
from smarts.roads.children import TIME_LIMIT_VARIABLE, run_child, time_limit
from smarts.roads.converter_messages import ConverterMessages

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
        MapError: SUMO refuses the files or crashes on them.
    """
    named = [text for option, names in inputs.items() if names for text in (f"--{option}", ",".join(names))]
    code, said = run_tool("sumo", [*named, *options, *_QUIETLY], folder, place)
    if code == 0:
        return
    problem = f"SUMO refuses the {what}: {' '.join(said.errors) or f'exit code {code}'}"
    if code < 0:
        problem = f"SUMO crashes on the {what} ({signal.Signals(-code).name})"
    remedy = f"mend the file{', or compile the map again with netconvert' if what == 'map' else ''}"
    raise MapError(problem, place=place, remedy=remedy)


def run_tool(tool: str, arguments: Sequence[str], folder: Path, place: str) -> tuple[int, ConverterMessages]:
    """Run one of SUMO's programs in a folder; return its exit code and messages.

    Args:
        tool: Its name.
        arguments: Its arguments.
        folder: Its working directory.
        place: The user's file, for errors.

    Raises:
        MapError: It ran too long.
    """
    program = sumo_folder() / "bin" / tool
    with tempfile.TemporaryFile() as said:
        try:
            code = run_child([str(program), *arguments], cwd=folder, env=_environment(), stderr=said)
        except TimeoutError as error:
            raise MapError(
                f"{tool} was still at work after {time_limit():g} s",
                place=place,
                remedy=f"give a smaller map, or set {TIME_LIMIT_VARIABLE} to more seconds",
            ) from error
        said.seek(0)
        return code, ConverterMessages.parse(said.read().decode(errors="replace"))


def sumo_folder() -> Path:
    """Return the folder of the SUMO package."""
    # Importing the package would set SUMO_HOME for the whole process; only its place is needed.
    return Path(str(distribution("eclipse-sumo").locate_file("sumo")))


def _environment() -> dict[str, str]:
    # SUMO_HOME would bring in another installation's type maps, and messages follow the locale.
    inherited = {key: value for key, value in os.environ.items() if key != "SUMO_HOME"}
    projections = str(sumo_folder() / "data" / "proj")
    return inherited | {"LC_ALL": "C", "PROJ_DATA": projections, "PROJ_LIB": projections}
