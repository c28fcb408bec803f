"""Traffic in SUMO's own files: what the simulation can carry of it, and the import of a configuration."""

from __future__ import annotations

import gzip
import shutil
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from smarts.errors import ScenarioError
from smarts.roads.sources import MAP_STEM, NET_SUFFIXES
from smarts.sstudio.locating import SCRIPT

CARRIED = """
    vType vTypeDistribution route routeDistribution vehicle trip flow interval busStop parkingArea
    chargingStation containerStop trainStop tlLogic WAUT wautJunction taz tazs param
"""
"""Elements of route and additional files that SUMO gets as they are."""
DRAWN = ("poly", "poi", "location")
"""Elements that only SUMO's window shows."""
OFF_ROAD = """
    tram rail_urban subway rail rail_electric rail_fast cable_car ship container drone aircraft pedestrian
    wheelchair
"""
"""Vehicle classes that drive on no road."""
OPTIONS = ("begin", "scale", "ignore-route-errors", "max-depart-delay", "random-depart-offset")
"""Options of SUMO that `Traffic.sumo_options` may have."""
FILES = ("net-file", "route-files", "additional-files")
"""Options of SUMO with a configuration's input."""
QUIET = ("output", "report", "gui_only", "random_number", "traci_server")
"""Sections of a configuration that change nothing on the road, but for the seed, which each episode has."""

_USERS = ("vehicle", "trip", "flow")
_TRUE = ("true", "t", "1", "yes", "on", "x")


def carried_files(files: Sequence[Path], folder: Path, stem: str) -> tuple[list[str], str]:
    """Copy SUMO's files without what the simulation cannot carry, such as persons and trains.

    Args:
        files: Route and additional files, perhaps compressed (`.gz`).
        folder: Where to copy them to.
        stem: Beginning of the copies' names.

    Returns:
        The copies' names, and what was left out, empty if nothing was.

    Raises:
        ScenarioError: A file cannot be read, or is not XML.
    """
    roots = [_root(file) for file in files]
    off_road = {
        kind.get("id")
        for root in roots
        for kind in root.iter("vType")
        if kind.get("vClass", "passenger") in OFF_ROAD.split()
    }
    lost: Counter[str] = Counter()
    names = []
    for number, root in enumerate(roots):
        for around in (root, *root.iterfind("interval")):
            for element in list(around):
                is_off_road = element.tag in _USERS and element.get("type") in off_road
                if element.tag in CARRIED.split() and not is_off_road:
                    continue
                around.remove(element)
                if element.tag not in DRAWN:
                    lost[f"{element.tag} of a type off the road" if is_off_road else element.tag] += 1
        names.append(f"{stem}.{number}.xml")
        ElementTree.ElementTree(root).write(folder / names[-1], encoding="UTF-8", xml_declaration=True)
    return names, ", ".join(f"{count} {name}" for name, count in sorted(lost.items()))


def left_out(root: ElementTree.Element) -> str:
    """Return what the traffic engine Native does not drive of a file, empty if it drives all."""
    lost = {"routeDistribution"} if root.find(".//routeDistribution") is not None else set()
    for user in (each for tag in _USERS for each in root.iter(tag)):
        if "route" not in user.attrib and user.find("route") is None and not {"from", "to"} <= {*user.attrib}:
            lost.add(f"{user.tag} without edges")
        has_times = {"period", "vehsPerHour"} & {*user.attrib} or {"number", "end"} <= {*user.attrib}
        if user.tag == "flow" and not has_times:
            lost.add("flow without period, vehsPerHour, or number and end")
    if any(not {"lane", "edge", "busStop"} & {*stop.attrib} for stop in root.iter("stop")):
        lost.add("stop without lane, edge and busStop")
    return ", ".join(sorted(lost))


def _root(file: Path) -> ElementTree.Element:
    try:
        content = file.read_bytes()
        return ElementTree.fromstring(gzip.decompress(content) if file.suffix == ".gz" else content)
    except (OSError, EOFError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError(
            f"cannot read a file of SUMO: {reason}", place=str(file), remedy="name a file that is there"
        ) from error
    except ElementTree.ParseError as error:
        raise ScenarioError(f"not XML: {error}", place=str(file), remedy="mend the file") from error


def import_sumo(files: Sequence[Path], out: Path | None = None) -> tuple[Path, tuple[str, ...]]:
    """Make a scenario of a SUMO configuration, or of a network with route and additional files.

    Args:
        files: A `.sumocfg`; or a `.net.xml`, perhaps with route files (`.rou.xml` or other) and additional
            ones (`.add.xml`). The files are copied as they are.
        out: The scenario's folder, new or empty; by default named as the first file, in the working folder.

    Returns:
        The folder, and options of the configuration that the simulation does not have.

    Raises:
        ScenarioError: A file is missing or broken, there is no network, or the folder is not empty.
    """
    net, routes, additional, options = _configured(files[0]) if len(files) == 1 else _sorted(files)
    name = files[0].name.partition(".")[0]
    out = Path(name) if out is None else out
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ScenarioError("there is something already", place=str(out), remedy="choose another --out")
    taken = {net: f"{MAP_STEM}.net.xml{net.suffix if net.suffix == '.gz' else ''}"}
    for file in (*routes, *additional):
        plain = file.name if file.name not in taken.values() else f"{len(taken)}_{file.name}"
        taken.setdefault(file, plain)
    if missing := [str(file) for file in taken if not file.is_file()]:
        raise ScenarioError(f"there is no {', '.join(missing)}", place=str(files[0]), remedy="add the files")
    out.mkdir(parents=True, exist_ok=True)
    for file, copy in taken.items():
        shutil.copyfile(file, out / copy)
    known = {key: value for key, value in options.items() if key in OPTIONS}
    traffic = _traffic_text(
        name, [taken[file] for file in routes], [taken[file] for file in additional], known
    )
    (out / SCRIPT).write_text(
        f'"""{name}, imported from {files[0].name}. Missions are missing: agents begin anywhere."""\n\n'
        "from pathlib import Path\n\n"
        "from smarts.sstudio import gen_scenario\nfrom smarts.sstudio import types as t\n\n"
        f"scenario = t.Scenario(\n{traffic if routes or additional else ''})\n"
        "gen_scenario(scenario, output_dir=Path(__file__).parent)\n",
        encoding="utf-8",
    )
    return out, tuple(key for key in options if key not in (*OPTIONS, *FILES, "end"))


def _traffic_text(name: str, routes: list[str], additional: list[str], options: Mapping[str, str]) -> str:
    """Return the keyword `traffic` of an imported scenario, as its file has it."""
    return (
        f"    traffic={{\n        {name!r}: t.Traffic(\n            flows=[],\n"
        f"            route_files={routes!r},\n            additional_files={additional!r},\n"
        f"            sumo_options={options!r},\n        )\n    }}\n"
    )


def _sorted(files: Sequence[Path]) -> tuple[Path, list[Path], list[Path], dict[str, str]]:
    nets = [file for file in files if file.name.endswith(NET_SUFFIXES)]
    if len(nets) != 1:
        raise ScenarioError(
            f"{len(nets)} of the files are networks", place=str(files[0]), remedy="give one *.net.xml"
        )
    others = [file for file in files if file not in nets]
    additional = [file for file in others if ".add." in file.name]
    return nets[0], [file for file in others if file not in additional], additional, {}


def _configured(file: Path) -> tuple[Path, list[Path], list[Path], dict[str, str]]:
    """Return what a configuration names: network, route files, additional files, and all options."""
    if file.name.endswith(NET_SUFFIXES):
        return file, [], [], {}
    root = _root(file)
    options = {
        _SHORT.get(element.tag, element.tag): element.get("value", element.get("v", ""))
        for section in (root, *root)
        for element in section
        if section.tag not in QUIET and ("value" in element.attrib or "v" in element.attrib)
    }
    found = {
        name: [file.parent / each.strip() for each in options.get(name, "").split(",") if each.strip()]
        for name in FILES
    }
    if len(found["net-file"]) != 1:
        raise ScenarioError(
            "not a configuration of SUMO: it names no net-file", place=str(file), remedy="give a .sumocfg"
        )
    if "begin" in options:
        options["begin"] = f"{seconds(options['begin'], str(file)):g}"
    if "ignore-route-errors" in options:
        options["ignore-route-errors"] = str(options["ignore-route-errors"].lower() in _TRUE).lower()
    return found["net-file"][0], found["route-files"], found["additional-files"], options


_SHORT = {"net": "net-file", "n": "net-file", "routes": "route-files", "r": "route-files"}
_SHORT |= {"additional": "additional-files", "a": "additional-files", "b": "begin", "e": "end"}
"""Other names of options in SUMO."""


def seconds(text: str, place: str) -> float:
    """Return a time [s] given as seconds or as [days:]hours:minutes:seconds."""
    try:
        return clock_seconds(text)
    except ValueError as error:
        raise ScenarioError(f"begin is {text!r}", place=place, remedy="give seconds") from error


def clock_seconds(text: str) -> float:
    """Return a time [s] as `seconds` does; raise ValueError if it is none."""
    parts = [float(part) for part in text.split(":")]
    units = (1.0, 60.0, 3600.0, 86400.0)
    return sum(part * unit for part, unit in zip(reversed(parts), units, strict=False))
