"""Names of scenarios: of the suite, folders, map files, each with an optional variation."""

from __future__ import annotations

import difflib
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import yaml

from smarts.errors import SmartsError, UnknownNameError, nearest_names
from smarts.shipped import local
from smarts.sstudio.encoding import digest

SCRIPT = "scenario.py"
"""The file that describes the scenario of its folder."""
VARIATION_MARK = "@"
"""Separator between a scenario and the name of one of its held-out variations."""
SUITE = Path(__file__).resolve().parents[2] / "scenarios"
"""The folder of the scenarios that come with the package."""


@dataclass(frozen=True)
class Location:
    """The folders of a scenario's sources and artefacts."""

    name: str
    """Its name, without the variation."""
    directory: Path
    """The folder of its sources, absolute."""
    variation: str | None = None
    """One of its held-out variations."""
    map_file: str | None = None
    """The map in `directory`, if the scenario is a bare map file."""
    described_only: bool = False
    """Whether a scenario file counts as absent, since the scenario was handed over by hand."""

    @property
    def script(self) -> Path | None:
        """The file that describes it, if there is one."""
        script = self.directory / SCRIPT
        return script if script.is_file() and not (self.map_file or self.described_only) else None

    @property
    def builds(self) -> tuple[Path, ...]:
        """Folders for its artefacts: the best first, the others for where that one cannot be written."""
        beside = self.directory / "build"
        caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        name = digest([str(self.directory), self.map_file], size=8)
        apart = caches / "smarts-bench" / "scenarios" / name
        # SUMO takes a comma in a path for the end of one path and the begin of the next.
        return tuple(root for root in ([apart] if self.map_file else [beside, apart]) if "," not in str(root))

    @property
    def label(self) -> str:
        """The name with the variation."""
        return self.name if self.variation is None else f"{self.name}{VARIATION_MARK}{self.variation}"


def locate(path: str | Path) -> Location:
    """Return what `path` means: a folder, a map file or a name of the suite, maybe with "@variation".

    A scenario on disk under that name takes precedence over the suite, other folders do not.

    Raises:
        UnknownNameError: It is neither; the remedy names the nearest scenarios of the suite.
    """
    text, variation = os.fspath(local(path)), None
    if not Path(text).exists() and VARIATION_MARK in text:
        text, _, variation = text.rpartition(VARIATION_MARK)
        text = os.fspath(local(text))
    found = Path(text)
    if found.name == SCRIPT and found.is_file():
        found = found.parent
    if (SUITE / text / SCRIPT).is_file() and not _holds_scenario(found):
        found = SUITE / text
    if found.is_dir():
        folder = found.resolve()
        return Location(folder.name, folder, variation)
    if found.is_file():
        file = found.resolve()
        return Location(file.name.split(".")[0], file.parent, variation, map_file=file.name)
    raise _unknown(text)


def resolved(name: str) -> str:
    """Return a scenario's name that means the same from every folder.

    That is the name in the suite, also for a path to the suite's own folder; of other folders and map files
    the absolute path; of what does not exist, `name`. A variation stays.
    """
    try:
        found = locate(name)
    except SmartsError:
        return name
    mark = "" if found.variation is None else f"{VARIATION_MARK}{found.variation}"
    if found.map_file is None and found.directory.parent == SUITE and found.name in suite():
        return f"{found.name}{mark}"
    return f"{found.directory / (found.map_file or '')}{mark}"


@cache
def suite() -> dict[str, str]:
    """Return the scenarios that come with the package: name and one line each."""
    return yaml.safe_load((SUITE / "suite.yaml").read_text(encoding="utf-8"))


def _holds_scenario(path: Path) -> bool:
    """Return whether a path is a file, or a folder with a scenario file or a map."""
    return path.is_file() or (path / SCRIPT).exists() or any(path.glob("map*"))


def _unknown(text: str) -> UnknownNameError:
    if os.sep in text or text.startswith("."):
        parent = Path(text).parent
        beside = [entry.name for entry in parent.iterdir() if entry.is_dir()] if parent.is_dir() else []
        close = difflib.get_close_matches(Path(text).name, beside, n=1)
        remedy = (
            f"did you mean {str(parent / close[0])!r}?" if close else "give a folder, a map file or a name"
        )
        return UnknownNameError(f"there is no scenario folder {text!r}", remedy=remedy)
    return UnknownNameError(f"there is no scenario {text!r}", remedy=nearest_names(text, suite()))
