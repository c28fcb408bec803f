"""Agents with environments of their own: a folder with a `pyproject.toml` that names their dependencies.

The environment is built by `smarts-bench zoo install`, before a run and never within it.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from packaging.specifiers import SpecifierSet

from smarts.agents.hosting.links import InChildProcess
from smarts.agents.hosting.options import HERE, HostError
from smarts.agents.hosting.remote import remote_spec
from smarts.agents.spec import AgentSpec
from smarts.errors import SmartsError
from smarts.whole_files import PARTIAL, writing
from smarts.zoo.entry import ZooEntry, check_name
from smarts.zoo.kit_wheel import build_wheel, kit_digest

PROJECT = "pyproject.toml"
GROUP = "smarts.zoo"
"""The group of a project's entry points that are agents."""
ENVIRONMENT = re.compile(r"(.+)-[0-9a-f]{16}")
"""The form of an environment's name: its agent, and a digest."""
LAST_WORDS = 800
"""Characters of an installer's output that an error repeats."""


@dataclass(frozen=True)
class SeparateEntry(ZooEntry):
    """An agent in an environment of its own, which this process never imports."""

    def load(self) -> Callable[..., Any]:
        """Raise: nothing of it is imported here.

        Raises:
            HostError: Always.
        """
        raise HostError(
            "the agent has an environment of its own, and is not imported here",
            place=f"agent {self.name!r}",
            remedy="name it as an agent; it is started where its environment is",
        )

    def description(self) -> str:
        """Return the description of its project."""
        return str(read_project(self.folder).get("description", ""))

    def options(self) -> dict[str, Any]:
        """Return nothing: its class alone knows its options."""
        return {}

    def spec(self, **options: Any) -> AgentSpec:
        """Return the agent's interface and how it is started.

        Raises:
            HostError: Its environment was not built, or the agent cannot be made.
        """
        values = {"agent": self.entry_point, "options": {**self.defaults, **options}}
        place = f"agent {self.name!r}"
        python = str(python_of(self))
        return remote_spec(InChildProcess("smarts_agent_kit.service", values, place, HERE.memory, python))


def has_project(folder: str | Path) -> bool:
    """Return whether a folder's agents have an environment of their own."""
    return (Path(folder) / PROJECT).is_file()


def read_entries(folder: str | Path) -> list[SeparateEntry]:
    """Return the agents that a folder's project names as entry points; nothing is imported.

    Raises:
        SmartsError: It names none, or a name is wrong.
    """
    project, place = read_project(folder), str(Path(folder).absolute())
    points = project.get("entry-points", {}).get(GROUP, {})
    if not points:
        raise SmartsError(
            "the project names no agent",
            place=f"{place}/{PROJECT}",
            remedy=f'add [project.entry-points."{GROUP}"] with a line "my-agent-v0" = "my_module:MyAgent"',
        )
    found = []
    for name, point in points.items():
        check_name(name)
        found.append(SeparateEntry(name, point, folder=place, provenance=f"project {project.get('name')}"))
    return found


def read_project(folder: str | Path) -> Mapping[str, Any]:
    """Return the section `project` of a folder's `pyproject.toml`.

    Raises:
        SmartsError: The file is missing or not readable, or has no such section.
    """
    file = Path(folder) / PROJECT
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))["project"]
    except (OSError, UnicodeError, tomllib.TOMLDecodeError, KeyError) as error:
        raise SmartsError(
            f"is not readable: {error!r}",
            place=str(file),
            remedy='it is TOML in UTF-8 with a section [project], in it a line name = "my-agent"',
        ) from error


def python_of(entry: ZooEntry) -> Path:
    """Return the interpreter of an agent's environment.

    Raises:
        HostError: The environment was not built, or of another state of the project.
    """
    python = _environment(entry) / "bin" / "python"
    if not python.exists():
        raise HostError(
            "the agent's environment was not built, or its project or the kit has changed since",
            place=f"agent {entry.name!r}",
            remedy=f"smarts-bench zoo install {entry.name}",
        )
    return python


def install(entry: ZooEntry, python: str = "") -> Path:
    """Build the environment of an agent, unless it is there; return its folder.

    Args:
        entry: The agent.
        python: The interpreter that it is made of, in place of an environment that is there; "": this one.

    Raises:
        HostError: The agent has no project, or its dependencies cannot be installed; nothing is left then.
    """
    place = f"agent {entry.name!r}"
    if not isinstance(entry, SeparateEntry):
        raise HostError(
            "the agent has no environment of its own",
            place=place,
            remedy=f"agents in folders with a {PROJECT} have one: smarts-bench zoo add FOLDER",
        )
    folder = _environment(entry)
    if python or not folder.exists():
        project = read_project(entry.folder)
        _check_python(project, python or sys.executable, place)
        with locked(_root() / ".lock"):
            if folder.exists() and not python:  # another process has built it in the meantime
                return folder
            _remove(_root().glob(f"{PARTIAL}*"))  # of processes that were killed
            with tempfile.TemporaryDirectory(prefix=PARTIAL, dir=_root()) as temporary:
                partial = Path(temporary, folder.name)
                _build(partial, python or sys.executable, entry.folder, project, place)
                shutil.rmtree(folder, ignore_errors=True)
                partial.rename(folder)
    return folder


def uninstall(name: str) -> list[Path]:
    """Remove all environments of an agent; return their folders."""
    return _remove(folder for folder in _environments() if _agent_of(folder) == name)


def clean(entries: Iterable[ZooEntry]) -> list[Path]:
    """Remove the environments that none of some agents uses any more; return their folders.

    A project or a kit that has changed leaves one, and so does an agent whose folder is gone.
    """
    used = {_environment(entry) for entry in entries if isinstance(entry, SeparateEntry)}
    return _remove(folder for folder in _environments() if folder not in used)


def _environments() -> list[Path]:
    return sorted(each for each in _root().glob("*") if each.is_dir() and _agent_of(each))


def _agent_of(folder: Path) -> str:
    """Return the name of the agent whose environment a folder is, "" if it is none."""
    found = ENVIRONMENT.fullmatch(folder.name)
    return found[1] if found else ""


def _remove(folders: Iterable[Path]) -> list[Path]:
    removed = [*folders]
    for folder in removed:
        shutil.rmtree(folder, ignore_errors=True)
    return removed


def _build(folder: Path, python: str, source: str, project: Mapping[str, Any], place: str) -> None:
    """Build an environment with the kit, the dependencies and the agent's own folder."""
    uv, own = shutil.which("uv"), str(folder / "bin" / "python")
    make = [uv, "venv", "--python", python, str(folder)] if uv else [python, "-m", "venv", str(folder)]
    _run(make, place)
    wanted = [str(build_wheel(folder)), *map(str, project.get("dependencies", ()))]
    pip = [uv, "pip", "install", "--python", own] if uv else [own, "-m", "pip", "install", "--quiet"]
    _run([*pip, *wanted], place)
    (packages,) = folder.glob("lib/python*/site-packages")
    root = Path(source) / "src"
    (packages / "smarts_agent.pth").write_text(f"{root if root.is_dir() else source}\n", encoding="utf-8")


def _run(command: list[str], place: str) -> str:
    """Return what a command prints.

    Raises:
        HostError: It fails.
    """
    try:
        done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        said = str(getattr(error, "stderr", "") or getattr(error, "stdout", "") or error).strip()
        raise HostError(
            f"the environment cannot be built: {said[-LAST_WORDS:]}",
            place=place,
            remedy=f"mend the dependencies in its {PROJECT}, then give the same command again",
        ) from error
    return done.stdout.strip()


def _check_python(project: Mapping[str, Any], python: str, place: str) -> None:
    wanted = SpecifierSet(str(project.get("requires-python", "")))
    version = _run([python, "-I", "-c", "import platform; print(platform.python_version())"], place)
    if not wanted.contains(version, prereleases=True):
        raise HostError(
            f"the agent needs Python {wanted}, and this one is {version}",
            place=place,
            remedy="name another interpreter: zoo install NAME --python PATH",
        )


def _environment(entry: ZooEntry) -> Path:
    """Return the folder of an agent's environment, which depends on the states of its project and the kit."""
    content = (Path(entry.folder) / PROJECT).read_bytes() if has_project(entry.folder) else b""
    digest = hashlib.sha256(content + kit_digest().encode() + entry.folder.encode()).hexdigest()
    return _root() / f"{entry.name}-{digest[:16]}"


def _root() -> Path:
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "smarts-bench" / "agents"


@contextmanager
def locked(file: Path) -> Iterator[None]:
    """Hold a lock, so that two processes do not write to one place.

    Raises:
        SmartsError: The file of the lock cannot be written.
    """
    with writing(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        opened = file.open("w")
    with opened as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield
