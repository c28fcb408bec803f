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
from smarts.zoo.entry import ZooEntry, check_name
from smarts.zoo.kit_wheel import build_wheel, kit_digest

PROJECT = "pyproject.toml"
GROUP = "smarts.zoo"
"""The group of a project's entry points that are agents."""
COMPLETE = ".complete"
"""The file that is written last into an environment."""
ENVIRONMENT = re.compile(r"(.+)-[0-9a-f]{16}-py[\d.]+\w*")
"""The form of an environment's name: its agent, a digest, the version of Python."""
OTHER_PYTHON = "name another interpreter: zoo install NAME --python PATH"
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
        SmartsError: The file is missing or not readable.
    """
    file = Path(folder) / PROJECT
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))["project"]
    except (OSError, UnicodeError, tomllib.TOMLDecodeError) as error:
        raise SmartsError(
            f"is not readable: {error}", place=str(file), remedy="mend the file: it is TOML in UTF-8"
        ) from error
    except KeyError as error:
        raise SmartsError(
            "has no section [project]", place=str(file), remedy='add one, with a line name = "my-agent"'
        ) from error


def python_of(entry: ZooEntry) -> Path:
    """Return the interpreter of an agent's environment, of several the one that was asked for last.

    Raises:
        HostError: The environment was not built, or of another state of the project.
    """
    built = [*_root().glob(f"{_key(entry)}-py*/{COMPLETE}")]
    if not built:
        raise HostError(
            "the agent's environment was not built, or its project or the kit has changed since",
            place=f"agent {entry.name!r}",
            remedy=f"smarts-bench zoo install {entry.name}",
        )
    return max(built, key=lambda file: file.stat().st_mtime_ns).parent / "bin" / "python"


def install(entry: ZooEntry, python: str = sys.executable) -> Path:
    """Build the environment of an agent, unless it is there; return its folder.

    Args:
        entry: The agent.
        python: The interpreter that it is made of.

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
    project, version = read_project(entry.folder), _version_of(python, place)
    _check_python(project, version, place)
    folder = _root() / f"{_key(entry)}-py{version}"
    with locked(folder.with_name(f"{folder.name}.lock")):
        if not (folder / COMPLETE).exists():
            shutil.rmtree(folder, ignore_errors=True)
            try:
                _build(folder, python, entry.folder, project, place)
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
        (folder / COMPLETE).touch()
    return folder


def uninstall(name: str) -> list[Path]:
    """Remove all environments of an agent; return their folders."""
    return _remove(folder for folder in _environments() if _agent_of(folder) == name)


def clean(entries: Iterable[ZooEntry]) -> list[Path]:
    """Remove the environments that none of some agents uses any more; return their folders.

    A project or a kit that has changed leaves one, and so does an agent whose folder is gone.
    """
    used = {_key(entry) for entry in entries if isinstance(entry, SeparateEntry)}
    return _remove(folder for folder in _environments() if folder.name.rpartition("-py")[0] not in used)


def _environments() -> list[Path]:
    return sorted(each for each in _root().glob("*-py*") if each.is_dir() and _agent_of(each))


def _agent_of(folder: Path) -> str:
    """Return the name of the agent whose environment a folder is, "" if it is none."""
    found = ENVIRONMENT.fullmatch(folder.name)
    return found[1] if found else ""


def _remove(folders: Iterable[Path]) -> list[Path]:
    removed = []
    for folder in folders:
        # The file of the lock stays, since another process may wait for it.
        with locked(folder.with_name(f"{folder.name}.lock")):
            shutil.rmtree(folder, ignore_errors=True)
        removed.append(folder)
    return removed


def _build(folder: Path, python: str, source: str, project: Mapping[str, Any], place: str) -> None:
    """Build an environment with the kit, the dependencies and the agent's own folder."""
    uv, own = shutil.which("uv"), str(folder / "bin" / "python")
    make = [uv, "venv", "--python", python, str(folder)] if uv else [python, "-m", "venv", str(folder)]
    _run(make, place)
    with tempfile.TemporaryDirectory() as temporary:
        wanted = [str(build_wheel(temporary)), *map(str, project.get("dependencies", ()))]
        pip = [uv, "pip", "install", "--python", own] if uv else [own, "-m", "pip", "install", "--quiet"]
        _run([*pip, *wanted], place)
    (packages,) = folder.glob("lib/python*/site-packages")
    root = Path(source) / "src"
    (packages / "smarts_agent.pth").write_text(f"{root if root.is_dir() else source}\n", encoding="utf-8")


def _run(command: list[str], place: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode:
        said = (done.stderr.strip() or done.stdout.strip())[-LAST_WORDS:]
        raise HostError(
            f"the environment cannot be built: {said}",
            place=place,
            remedy=f"mend the dependencies in its {PROJECT}, then give the same command again",
        )


def _version_of(python: str, place: str) -> str:
    """Return the version of an interpreter, as "3.11.7"."""
    show = "import platform; print(platform.python_version())"
    try:
        done = subprocess.run([python, "-I", "-c", show], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise HostError(f"{python!r} is no Python: {error}", place=place, remedy=OTHER_PYTHON) from error
    return done.stdout.strip()


def _check_python(project: Mapping[str, Any], version: str, place: str) -> None:
    wanted = SpecifierSet(str(project.get("requires-python", "")))
    if not wanted.contains(version, prereleases=True):
        raise HostError(
            f"the agent needs Python {wanted}, and this one is {version}", place=place, remedy=OTHER_PYTHON
        )


def _key(entry: ZooEntry) -> str:
    """Return what an environment is called, but for the Python version."""
    content = (Path(entry.folder) / PROJECT).read_bytes() if has_project(entry.folder) else b""
    digest = hashlib.sha256(content + kit_digest().encode() + entry.folder.encode()).hexdigest()
    return f"{entry.name}-{digest[:16]}"


def _root() -> Path:
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "smarts-bench" / "agents"


@contextmanager
def locked(file: Path) -> Iterator[None]:
    """Hold a lock, so that two processes do not write to one place."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield
