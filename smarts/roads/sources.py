"""Finding a road map: which files in a folder make up the map, and in which format."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from smarts.errors import MapError

MapKind = Literal[
    "sumo_net", "sumo_plain", "netgenerate", "opendrive", "lanelet2", "osm",
    "commonroad", "argoverse", "waymo",
]  # fmt: skip

MAP_STEM = "map"
"""Default stem of a scenario's map files."""

NET_SUFFIXES = (".net.xml", ".net.xml.gz")
"""Suffixes of compiled networks, plain and compressed."""

# In order of precedence: the first kind whose principal files exist is the map.
_PRINCIPAL: dict[MapKind, tuple[tuple[str, ...], ...]] = {
    "sumo_net": tuple((suffix,) for suffix in NET_SUFFIXES),
    "sumo_plain": ((".nod.xml", ".edg.xml"),),
    "netgenerate": ((".netgcfg",),),
    "opendrive": ((".xodr",),),
    "lanelet2": ((".lanelet2.osm",),),
    "osm": ((".osm",), (".osm.xml",)),
    "commonroad": ((".cr.xml",),),
    "argoverse": ((".argoverse.json",), (".json",)),
    "waymo": (),
}
_PLAIN_EXTRAS = (".con.xml", ".typ.xml", ".tll.xml")
_OPTIONS = ".netccfg"


@dataclass(frozen=True)
class MapSource:
    """A road map as files on disk."""

    kind: MapKind
    files: tuple[Path, ...]
    """Everything that the compiled map depends on, the principal file first: hash these."""
    part: str = ""
    """What of the file is the map, "#" and a scenario of Waymo."""

    @property
    def options(self) -> Path | None:
        """The file with the user's own netconvert options, if there is one."""
        return next((file for file in self.files if file.name.endswith(_OPTIONS)), None)


def find_map_source(directory: Path, source: str | None = None) -> MapSource:
    """Return the map of a scenario folder.

    Args:
        directory: The scenario's folder.
        source: None for the files named "map.*". Otherwise a file, a folder (whose "map.*", or only map, is
            taken), a scenario of Waymo, FILE#ID, or a stem such as "three_lanes"; relative to `directory` or
            absolute.

    Where one stem has files of several kinds, a compiled `.net.xml` wins, then `.nod.xml` with `.edg.xml`,
    `.netgcfg`, `.xodr`, `.osm`.

    Raises:
        MapError: No map is there; the message says what was looked for.
    """
    if source is None:
        return _from_stem(directory, MAP_STEM)
    path = directory / source
    name, mark, part = path.name.partition("#")
    if ".tfrecord" in name and path.with_name(name).is_file():
        return MapSource("waymo", (path.with_name(name),), mark + part)
    if path.is_file():
        return _from_file(path)
    if path.is_dir():
        return _from_stem(path, _only_stem(path))
    return _from_stem(path.parent, path.name)


def _from_file(path: Path) -> MapSource:
    for kind, alternatives in _PRINCIPAL.items():
        for suffix in (suffix for suffixes in alternatives for suffix in suffixes):
            if path.name.endswith(suffix):
                return _from_stem(path.parent, path.name.removesuffix(suffix), only=kind)
    raise MapError(
        f"'{path.name}' is not a road map", place=str(path), remedy=f"give a file ending in {_expected('*')}"
    )


def _only_stem(folder: Path) -> str:
    """Return "map" if the folder has such a map, else the one stem that any map in it has."""
    stems = set()
    for suffixes in (alternative for kind in _PRINCIPAL.values() for alternative in kind):
        pattern = "log_map_archive_*.json" if suffixes == (".json",) else f"*{suffixes[0]}"
        stems |= {file.name.removesuffix(suffixes[0]) for file in folder.glob(pattern)}
    if len(stems) == 1:
        return stems.pop()
    if len(stems) > 1 and MAP_STEM not in stems:
        raise MapError(
            f"the folder holds several maps: {', '.join(sorted(stems))}",
            place=str(folder),
            remedy="name one of them as the map's source, or rename its files to map.*",
        )
    return MAP_STEM


def _from_stem(folder: Path, stem: str, only: MapKind | None = None) -> MapSource:
    for kind in (only,) if only else get_args(MapKind):
        for suffixes in _PRINCIPAL[kind]:
            files = [folder / f"{stem}{suffix}" for suffix in suffixes]
            if all(file.is_file() for file in files):
                return MapSource(kind, (*files, *_companions(kind, folder, stem)))
    raise MapError(
        f"there is no road map '{stem}': looked for {_expected(stem, only)}",
        place=str(folder),
        remedy="add one of these files, or name the map's file or folder as the source of the scenario's map",
    )


def _companions(kind: MapKind, folder: Path, stem: str) -> list[Path]:
    suffixes = {"sumo_plain": (*_PLAIN_EXTRAS, _OPTIONS), "opendrive": (_OPTIONS,), "osm": (_OPTIONS,)}
    candidates = [folder / f"{stem}{suffix}" for suffix in suffixes.get(kind, ())]
    configured = _configured(folder / f"{stem}{'.netgcfg' if kind == 'netgenerate' else _OPTIONS}")
    if kind == "sumo_net":
        configured = []
    return list(dict.fromkeys(file for file in (*candidates, *configured) if file.is_file()))


def _configured(options: Path) -> list[Path]:
    """Return the files that a file of options makes SUMO's tools read, as `type-files` does."""
    try:
        elements = list(ElementTree.parse(options).iter())
    except (OSError, ElementTree.ParseError):
        return []  # that it is broken is for the compiler to say
    values = [
        element.get("value", element.get("v", ""))
        for element in elements
        if element.tag.endswith(("-files", "-file")) and not element.tag.startswith("output")
    ]
    return [options.parent / name.strip() for value in values for name in value.split(",") if name.strip()]


def _expected(stem: str, only: MapKind | None = None) -> str:
    kinds = [_PRINCIPAL[only]] if only else _PRINCIPAL.values()
    return ", ".join(
        " with ".join(f"{stem}{suffix}" for suffix in suffixes)
        for alternatives in kinds
        for suffixes in alternatives
    )
