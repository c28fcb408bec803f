"""The archive of code that Ray brings to the machines of a cluster, which have only third-party packages.

It holds this program with its compiled kernels, own code, and scenarios with their builds. `smarts.shipped`
says where the user's files are in it.
"""

from __future__ import annotations

import json
import os
import re
import sysconfig
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from glob import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmark.experiment.models import Experiment
from benchmark.experiment.runs import task_settings_of
from benchmark.results.files import ResultsError
from benchmark.running.machine import COMMIT, commit
from benchmark.running.played import held_out_of
from smarts.shipped import PROGRAM, SHIPPED, TIMES
from smarts.sstudio.build import build_scenario
from smarts.sstudio.cache import BuildCache
from smarts.sstudio.locating import Location, locate

PACKAGES = ("algorithms", "benchmark", "configs", "scenarios", "smarts", "smarts_agent_kit")
MOST_BYTES = 500 * 2**20
"""Largest size of the archive: Ray takes no larger ones."""
BUILD = "build"
SKIPPED = (BUILD, "__pycache__")
"""Folders that are left out, as hidden ones are."""
SET_UP = "smarts.shipped.restore_times"
"""What each process calls first."""
LIBRARIES = {"site-packages", "dist-packages"}
"""Folders of installed packages."""
_KERNEL = re.compile(r"(\w+)\.((?:callee_)?.*)_[0-9a-f]{12}-\d+\.py\d+\w*\.nbi")
"""Index of a compiled kernel: module, function, digest of the sources, line."""


@contextmanager
def shipped_code(experiment: Experiment) -> Iterator[dict[str, Any] | None]:
    """Provide the runtime environment that ships what an experiment's processes need; None without a cluster.

    Raises:
        ResultsError: A file cannot be read, or all of them are too large.
        SmartsError: A scenario cannot be built.
    """
    if experiment.resources.address is None:
        yield None
        return
    with tempfile.TemporaryDirectory(prefix="smarts-bench-") as folder:
        archive = Path(folder, "code.zip")
        try:
            _write(archive, experiment)
        except OSError as error:
            raise ResultsError(
                f"cannot be shipped to the cluster: {error.strerror or error}", place=str(error.filename)
            ) from error
        _check_size(archive)
        yield {"working_dir": str(archive), "worker_process_setup_hook": SET_UP}


def _check_size(archive: Path) -> None:
    if archive.stat().st_size <= MOST_BYTES:
        return
    with zipfile.ZipFile(archive) as written:
        every = written.infolist()
    own = [each for each in every if each.filename.startswith(f"{SHIPPED.name}/")]
    largest = max(own or every, key=lambda each: each.compress_size)
    raise ResultsError(
        f"the code for the cluster has {archive.stat().st_size / 2**20:.0f} MB, more than Ray takes",
        place=largest.filename.removeprefix(SHIPPED.name),
        remedy="keep data out of the folders of `imports` and of scenarios",
    )


def _write(archive: Path, experiment: Experiment) -> None:
    """Write all files, each once, in one order and with one date: equal contents make equal archives."""
    files = {_place(file): file for file in map(_normal, _files(experiment))}
    name, text = "smarts-bench", version("smarts-bench")
    texts = {
        **dict(_indexes(experiment)),
        COMMIT: commit() or "",
        f"{SHIPPED.name}/{TIMES}": json.dumps(_times(files), indent=0),
        f"smarts_bench-{text}.dist-info/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {text}\n",
    }
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as opened:
        for place, file in sorted(files.items()):
            opened.writestr(_entry(place), file.read_bytes())
        for place, content in sorted(texts.items()):
            opened.writestr(_entry(place), content)


def _entry(place: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(place)
    entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
    return entry


def _normal(file: Path) -> Path:
    return Path(os.path.normpath(file))


def _place(file: Path) -> str:
    """Return a file's place in the archive: as in this program's folder, or under its absolute path."""
    for package in PACKAGES:
        if file.is_relative_to(PROGRAM / package):
            return file.relative_to(PROGRAM).as_posix()
    return f"{SHIPPED.name}{file.as_posix()}"


def _files(experiment: Experiment) -> Iterator[Path]:
    """Yield all files to ship, by absolute paths."""
    for package in PACKAGES:
        yield from _in(PROGRAM / package)
    yield from _kernels()
    for path in experiment.imports:
        yield from _in(Path(path))
    for location, artefacts in _scenarios(experiment):
        folder = location.directory
        yield from _in(folder / location.map_file if location.map_file else folder)
        if artefacts is not None:
            yield from _in(artefacts)
            for _, entry in _entries(folder):
                yield from (folder / file for file in entry["files"] if (folder / file).is_file())


def _in(path: Path) -> Iterator[Path]:
    """Yield a file, or the files of a folder."""
    if path.is_file():
        yield path
        return
    for entry in sorted(path.iterdir()):
        if entry.name not in SKIPPED and not entry.name.startswith("."):
            yield from _in(entry)


def _scenarios(experiment: Experiment) -> Iterator[tuple[Location, Path | None]]:
    """Yield where scenarios and held-out variations are, and their artefacts if these are beside them."""
    for setting in task_settings_of(experiment):
        for name in [*setting.task.names, *held_out_of(setting)]:
            location, artefacts = locate(name), build_scenario(name).directory
            yield location, artefacts if artefacts.parent == location.directory / BUILD else None


def _indexes(experiment: Experiment) -> Iterator[tuple[str, str]]:
    """Yield the places and texts of the indexes of builds, by which the machines find artefacts."""
    for location, artefacts in _scenarios(experiment):
        if artefacts is not None:
            for file, entry in _entries(location.directory):
                yield _place(file), json.dumps(entry)


def _entries(folder: Path) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Yield the index of a scenario's builds; of their sources only those that lie in the archive as here."""
    cache = BuildCache(folder / BUILD)
    for file in sorted((folder / BUILD / "index").glob("*.json")):
        entry = cache.read(file.stem) or {}
        if isinstance(entry.get("files"), dict):
            sources = {
                name: digest
                for name, digest in entry["files"].items()
                if _is_beside(_normal(folder / name), folder)
            }
            yield file, {**entry, "files": sources}


def _is_beside(file: Path, folder: Path) -> bool:
    """Return whether a file and a folder are both the user's, or both of this program."""
    if not LIBRARIES.isdisjoint(file.parts) or file.is_relative_to(sysconfig.get_path("stdlib")):
        return False
    return file.is_relative_to(PROGRAM) == folder.is_relative_to(PROGRAM)


def _kernels() -> Iterator[Path]:
    """Yield the newest machine code of each kernel; a processor that it is not for compiles its own."""
    newest: dict[tuple[Path, str, str], Path] = {}
    for index in (PROGRAM / "smarts").rglob("__pycache__/*.nbi"):
        found = _KERNEL.fullmatch(index.name)
        if found is None:
            continue
        key = index.parent, found[1], found[2]
        if key not in newest or index.stat().st_mtime > newest[key].stat().st_mtime:
            newest[key] = index
    for (folder, *_), index in newest.items():
        yield index
        yield from folder.glob(f"{escape(index.stem)}.*.nbc")


def _times(files: Mapping[str, Path]) -> dict[str, int]:
    """Return when the sources of kernels were changed; see `smarts.shipped`."""
    folders = {place.rpartition("/__pycache__/")[0] for place in files if place.endswith(".nbi")}
    sources = {
        place: file
        for place, file in files.items()
        if place.endswith(".py") and place.rpartition("/")[0] in folders
    }
    return {place: file.stat().st_mtime_ns for place, file in sorted(sources.items())}
