"""The agents that a user has added by `smarts-bench zoo add FOLDER`, in one file of the user's."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from smarts.errors import OwnCodeError, SmartsError, UnknownNameError, nearest_names
from smarts.registry import import_own, load_module
from smarts.shipped import local
from smarts.whole_files import written_whole
from smarts.zoo.entry import ZooEntry

PLACE = "SMARTS_ZOO"
"""Environment variable that names another file than `~/.config/smarts-bench/zoo.yaml`."""
_METADATA = ("author", "m_level", "provenance", "licence")


def zoo_file() -> Path:
    """Return the file that lists the added agents; it need not exist."""
    config = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
    return local(os.environ.get(PLACE) or config / "smarts-bench" / "zoo.yaml")


def added_agents() -> dict[str, ZooEntry]:
    """Return the added agents by name, without importing their folders.

    Raises:
        SmartsError: The file is not readable.
    """
    return {name: ZooEntry(name, "", **about) for name, about in _content().items()}


def write_added(entries: Sequence[ZooEntry]) -> None:
    """Add agents of folders to the file; an agent of the same name is replaced.

    Raises:
        SmartsError: The file is not readable or cannot be written.
    """
    content = dict(_content())
    for entry in entries:
        about = {name: getattr(entry, name) for name in ("folder", *_METADATA)}
        content[entry.name] = {key: text for key, text in about.items() if text}
    _write(content)


def remove_added(name: str) -> None:
    """Remove an agent from the file; its folder stays.

    Raises:
        SmartsError: No such agent was added, or the file is not readable or cannot be written.
    """
    content = dict(_content())
    if name not in content:
        raise UnknownNameError(
            f"no added agent is called {name!r}", place=str(zoo_file()), remedy=nearest_names(name, content)
        )
    del content[name]
    _write(content)


def import_folder(folder: str | Path) -> str:
    """Import a folder as a package, and return the package's name.

    Raises:
        OwnCodeError: There is no such folder, its name cannot be imported or is taken, or its code raises.
    """
    path = Path(folder).absolute()
    if not path.exists():
        raise OwnCodeError(
            "there is no such folder with agents",
            place=str(path),
            remedy="if it was moved, `smarts-bench zoo add` it from its new place",
        )
    import_own([path])
    load_module(path.stem, "folder")
    return path.stem


def _write(content: Mapping[str, Any]) -> None:
    with written_whole(zoo_file()) as written:
        written.write_text(yaml.safe_dump(content), encoding="utf-8")


def _content() -> Mapping[str, Any]:
    file = zoo_file()
    if not file.exists():
        return {}
    try:
        content = yaml.safe_load(file.read_text(encoding="utf-8")) or {}
    except (OSError, UnicodeError, yaml.YAMLError) as error:
        raise SmartsError(
            "the list of added agents is not readable", place=str(file), remedy="mend or remove it"
        ) from error
    return content
