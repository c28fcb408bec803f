"""Writes the artefacts of a scenario: the compiled map, SUMO's input, and the scenario as JSON.

The same scenario, map and seed give the same bytes, in whatever folder they are.
"""

from __future__ import annotations

import json
import os
import shutil
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from smarts.roads.compile import compile_map
from smarts.roads.lane_graph import LaneGraph
from smarts.roads.sources import MapSource
from smarts.roads.sumo_net import read_net, write_driven_lengths
from smarts.roads.sumo_tools import try_in_sumo
from smarts.sstudio.built import LANES, NET, SCENARIO
from smarts.sstudio.cache import MANIFEST
from smarts.sstudio.drawn_missions import with_sets
from smarts.sstudio.encoding import digest, encode
from smarts.sstudio.episodes import drawn_mission
from smarts.sstudio.executing import Description
from smarts.sstudio.recorded_traffic import WITHOUT_ROUTES, taken_vehicles, write_log
from smarts.sstudio.sstypes.map_spec import MapSpec
from smarts.sstudio.sstypes.traffic import Traffic
from smarts.sstudio.sumo_files import carried_files, left_out, seconds
from smarts.sstudio.sumo_writer import sumo_traffic
from smarts.sstudio.validation import validate
from smarts.types.streams import Purpose, stream
from smarts.types.traffic import TRAFFIC_ENGINES


def write_artefacts(
    folder: Path, description: Description, source: MapSource, like: Path | None, place: str, directory: Path
) -> None:
    """Check a scenario and write its artefacts.

    Args:
        folder: Where to; empty.
        description: The scenario.
        source: Its map.
        like: Artefacts of another scenario on the very same map, which is then not compiled again.
        place: The file that describes the scenario, for errors.
        directory: The scenario's folder, for SUMO's own files of its traffic.

    Raises:
        ScenarioError: The scenario cannot be on this map.
        MapError: The map is broken.
    """
    scenario, seed = description.scenario, description.seed
    of_map = _compile(source, folder) if like is None else _share(like, folder)
    roads = LaneGraph.load(folder / LANES)
    validate(scenario, roads, folder / NET, place)
    (folder / "traffic").mkdir()
    traffic, notes, warnings = {}, _notes(description), _warnings(description)
    if drawn := drawn_mission(scenario.ego_missions or ()):
        filled, note = with_sets(drawn, roads, seed, f"{place}: ego_missions[0]")
        scenario = replace(scenario, ego_missions=(filled,))
        notes.append(note)
    taken = taken_vehicles(scenario)
    for name, described in (scenario.traffic or {}).items():
        if described.recording:
            at, log = f"{place}: traffic[{name!r}].recording", f"traffic/{quote(name, safe='')}.log.npz"
            written, note = write_log(described.recording, roads, directory, folder / log, at, taken)
            traffic[name] = WITHOUT_ROUTES | {"recording": written | {"log": log}}
            notes.append(f"traffic[{name!r}] {note}")
            continue
        traffic[name], more = _write_traffic(folder, name, described, roads, seed, place)
        notes += more
        if described.route_files or described.additional_files:
            warnings += _add_sumo_files(folder, name, described, traffic[name], directory, place)
    _write_json(folder / SCENARIO, encode(replace(scenario, held_out=None)))
    manifest = {
        "seed": seed,
        "traffic": traffic,
        "held_out": {name: held.description for name, held in (scenario.held_out or {}).items()},
        **of_map,
        "notes": notes,
        "warnings": warnings,
    }
    _write_json(folder / MANIFEST, manifest)


def _compile(source: MapSource, folder: Path) -> dict[str, list[str]]:
    notes = compile_map(source, folder / NET)
    roads = read_net(folder / NET)
    roads.save(folder / LANES)
    remarks = list(notes.remarks)
    if count := write_driven_lengths(folder / NET, roads):
        remarks.append(
            f"{count} lanes are given a length that is not that of their shape: traffic drives the shape's, "
            "and positions on them in scenarios are scaled to it"
        )
    return {"map_notes": remarks, "map_warnings": list(notes.warnings)}


def _share(like: Path, folder: Path) -> dict[str, list[str]]:
    for name in (NET, LANES):
        try:
            os.link(like / name, folder / name)  # artefacts never change, so they may be one file
        except OSError:
            shutil.copyfile(like / name, folder / name)
    manifest = json.loads((like / MANIFEST).read_text(encoding="utf-8"))
    return {name: manifest[name] for name in ("map_notes", "map_warnings")}


def _write_traffic(
    folder: Path, name: str, traffic: Traffic, roads: LaneGraph, seed: int, place: str
) -> tuple[dict[str, Any], list[str]]:
    # A stream for each variation, so that a change to one leaves the others as they are.
    own_seed = seed if traffic.seed is None else traffic.seed
    generator = stream(int(digest([own_seed, name], size=6), 16), Purpose.BUILD)
    contents = sumo_traffic(traffic, roads, folder / NET, generator, f"traffic[{name!r}]", place)
    stem = f"traffic/{quote(name, safe='')}"
    files = {"routes": [f"{stem}.rou.xml"], "additional": [], "warm_up": traffic.warm_up}
    files["options"] = dict(traffic.sumo_options)
    if begin := files["options"].get("begin"):
        files["options"]["begin"] = str(seconds(begin, f"{place}: traffic[{name!r}].sumo_options"))
    files["reaction_time"] = contents.reaction_time
    (folder / files["routes"][0]).write_text(contents.routes, encoding="utf-8")
    if contents.additional:
        files["additional"] = [f"{stem}.add.xml"]
        (folder / files["additional"][0]).write_text(contents.additional, encoding="utf-8")
    return files, list(contents.notes)


def _add_sumo_files(
    folder: Path, name: str, traffic: Traffic, files: dict[str, Any], directory: Path, place: str
) -> list[str]:
    """Add copies of SUMO's own files to those of a variation, try them in SUMO, and return warnings."""
    sources = [directory / file for file in (*traffic.additional_files, *traffic.route_files)]
    copies, lost = carried_files(sources, folder, f"traffic/{quote(name, safe='')}")
    count = len(traffic.additional_files)
    files["additional"] += copies[:count]
    files["routes"] += copies[count:]
    files["reaction_time"] = None
    inputs = {"net-file": [NET], "route-files": files["routes"], "additional-files": files["additional"]}
    options = [text for option, value in files["options"].items() for text in (f"--{option}", value)]
    # All of the routes at once, so that every mistake in them is found.
    options += ["--end", str(float(files["options"].get("begin", 0.0)) + 1.0), "--route-steps", "0"]
    try_in_sumo(folder, inputs, options, f"{place}: traffic[{name!r}]", "traffic")
    warnings = [f"traffic[{name!r}] without what is not simulated: {lost}"] if lost else []
    if traffic.engine == "Native":
        roots = [ElementTree.parse(folder / copy).getroot() for copy in copies]
        left = ", ".join(dict.fromkeys(found for root in roots if (found := left_out(root))))
        warnings += [f"traffic[{name!r}]: its engine Native does not drive {left}"] if left else []
    return warnings


def _notes(description: Description) -> list[str]:
    spec = description.scenario.map_spec
    if spec is None:
        return []
    unused = {
        "lanepoint_spacing": spec.lanepoint_spacing != MapSpec.lanepoint_spacing,
        "default_lane_width": spec.default_lane_width is not None,
        "shift_to_origin": spec.shift_to_origin,
    }
    return [
        f"map_spec.{name} has no effect: the map is taken as it is" for name, given in unused.items() if given
    ]


def _warnings(description: Description) -> list[str]:
    scenario = description.scenario
    described = scenario.traffic or {}
    other = [name for name, traffic in described.items() if traffic.engine not in TRAFFIC_ENGINES]
    warnings = []
    if other:
        names = ", ".join(map(repr, other))
        warnings.append(f"SUMO drives the traffic {names}, which names the engine 'SMARTS'")
    if scenario.traffic_histories:
        names = ", ".join(repr(each.name) for each in scenario.traffic_histories if not isinstance(each, str))
        warnings.append(f"traffic_histories: {names} without input_path are played without")
    return warnings


def _write_json(path: Path, data: Any) -> None:
    path.write_text(json.dumps(data, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
