"""Importing a recording: from a file of any format to a folder, which is a scenario where it can be."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from smarts.recordings.checks import NOT_TRAFFIC, Report, check, on_lanes, share_of_vehicles
from smarts.recordings.reading import Source, read
from smarts.recordings.repairs import repaired
from smarts.recordings.tracks import GAP, RecordingError, Tracks, write_tracks
from smarts.roads.compile import MapNotes, compile_map
from smarts.roads.lanelets import LANELET_MAPS, read_lanelets
from smarts.roads.sources import MapKind, MapSource, find_map_source
from smarts.roads.sumo_net import read_net
from smarts.whole_files import written_whole

LEAST_ON_LANES = 0.9
"""With a smaller share of its positions on lanes, a recording is not of the map."""
LEAST_ON_CUT_MAP: dict[MapKind, float] = {"argoverse": 0.25, "waymo": 0.0}
"""The same for maps that end before vehicles do, and have no car parks; Waymo's are in the same file."""
NET, REPORT, SCRIPT = "map.net.xml", "import.txt", "scenario.py"
_MARKS: dict[MapKind, re.Pattern[bytes]] = {
    "commonroad": re.compile(rb"<commonRoad\b"),
    "lanelet2": re.compile(rb"v=['\"]lanelet['\"]"),
    "argoverse": re.compile(rb"\"lane_segments\""),
}
_SCENARIO = '''"""Recorded traffic; import.txt says where it comes from, and under which licence."""

from pathlib import Path

from smarts.sstudio import gen_scenario
from smarts.sstudio import types as t

scenario = t.Scenario(traffic={{"recorded": t.Traffic([], engine="Recorded", recording=t.Recording("."))}})
# To train on the first part and test on the rest, in windows: t.Recording(".", end={middle}, window={window})
# above, and in the scenario held_out={{"later": t.Variation("later", traffic={{"recorded": t.Traffic([],
# engine="Recorded", recording=t.Recording(".", begin={middle}, window={window}))}})}}
gen_scenario(scenario, output_dir=Path(__file__).parent)
'''


def import_recording(
    source: Source,
    out: Path,
    *,
    licence: str,
    format: str | None = None,
    attribution: str = "",
    map_file: Path | None = None,
    as_recorded: bool = False,
) -> list[str]:
    """Write a recording, its map and what there is to say about it to a folder, all of it or nothing.

    Args:
        source: What to import.
        out: The folder, new or empty.
        licence: The licence of the data.
        format: A name in `READERS`; None: recognised by the file.
        attribution: Whom to name; "": as the file says.
        map_file: Its map; None: the source's own, where the format has one.
        as_recorded: Whether to leave out the repairs.

    Returns:
        The report, by lines; `import.txt` in the folder holds the same.

    Raises:
        RecordingError: The source is no recording, has no licence, or is not of this map; or the folder is
            not empty.
        MapError: The map is broken.
    """
    _check_request(source, out, licence)
    tracks = read(source, format)
    said: list[str] = []
    if not as_recorded:
        tracks, said = repaired(tracks)
    with written_whole(out) as folder:
        folder.mkdir()
        map_source = _map_source(source.path, tracks.facts["source_format"], map_file)
        notes = compile_map(map_source, folder / NET) if map_source else MapNotes()
        roads = read_net(folder / NET) if map_source else None
        is_kept = np.ones(len(tracks.t), bool) if roads is None else on_lanes(tracks, roads)
        share = share_of_vehicles(is_kept, tracks) if roads else 1.0
        if map_source and share < LEAST_ON_CUT_MAP.get(map_source.kind, LEAST_ON_LANES):
            raise RecordingError(
                f"only {share:.0%} of its positions lie on lanes of {map_file or 'its own map'}",
                place=str(source.path),
                remedy="give the map of this recording, in the same coordinates; none if the file has one",
            )
        if map_source and map_source.kind in LEAST_ON_CUT_MAP:
            cut = [f"off the map: {1 - share:.0%} of the positions, which are left out"]
        else:
            cut, is_kept[:] = [], True
        names, tracks = {*tracks.names}, tracks.of_samples(is_kept)
        if gaps := len({*tracks.names} - names):
            cut.append(f"gaps: {gaps}, at which tracks are split, as they are longer than {GAP} time steps")
        report = check(tracks, roads)
        facts = {"licence": licence.strip(), "is_traffic": str(report.is_traffic).lower()}
        facts |= {"attribution": attribution} if attribution else {}
        assumed = [tracks.facts.get("assumed"), _assumed_limits(map_source)]
        facts |= {"assumed": "; ".join(filter(None, assumed))} if any(assumed) else {}
        tracks = replace(tracks, facts={**tracks.facts, **facts})
        lines = _lines(tracks, report, [*(f"repaired: {each}" for each in said), *cut], notes)
        _write(folder, tracks, lines, is_scenario=report.is_traffic and map_source is not None)
    return lines


def _check_request(source: Source, out: Path, licence: str) -> None:
    if not licence.strip():
        raise RecordingError(
            "the licence of the data is not named",
            place=str(source.path),
            remedy="read it where the data was had, and name it: --licence 'CC BY 4.0'",
        )
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise RecordingError("there is something already", place=str(out), remedy="choose another --out")


def _write(folder: Path, tracks: Tracks, lines: list[str], *, is_scenario: bool) -> None:
    write_tracks(tracks, folder)
    (folder / REPORT).write_text("\n".join(lines) + "\n", encoding="utf-8")
    if is_scenario:
        middle, window = (f"{share * float(tracks.facts['duration']):.1f}" for share in (0.75, 0.1))
        (folder / SCRIPT).write_text(_SCENARIO.format(middle=middle, window=window), encoding="utf-8")
    else:
        (folder / NET).unlink(missing_ok=True)


def _map_source(path: Path, format: str, map_file: Path | None) -> MapSource | None:
    """Return the map that was named, else the recording's own file where it holds one, else None."""
    if map_file is None and format == "Waymo":
        return find_map_source(path.absolute().parent, path.name)
    if map_file is None:
        if format == "Argoverse":
            path = next(path.glob("scenario_*.parquet"), path)
            beside = path.with_name(f"{path.stem.replace('scenario', 'log_map_archive', 1)}.json")
            return MapSource("argoverse", (beside,)) if beside.exists() else None
        return MapSource("commonroad", (path,)) if format == "CommonRoad" else None
    if map_file.suffix and not map_file.exists():
        raise RecordingError("there is no such file", place=str(map_file), remedy="give the file of the map")
    if map_file.is_file() and map_file.suffix in (".xml", ".osm", ".json"):
        # Files of these formats are named by what they show: their ending does not tell the format.
        content = map_file.read_bytes()
        for kind, mark in _MARKS.items():
            if mark.search(content):
                return MapSource(kind, (map_file,))
    return find_map_source(Path(), str(map_file.absolute()))


def _assumed_limits(source: MapSource | None) -> str:
    """Return on how many lanelets a map names no speed limit, "" if on none."""
    if source is None or source.kind not in LANELET_MAPS:
        return ""
    lanelets = read_lanelets(source.kind, source.files[0].with_name(source.files[0].name + source.part))
    count = sum(each.assumes_limit for each in lanelets)
    return f"limits of {count} of {len(lanelets)} lanelets" if count else ""


def _lines(tracks: Tracks, report: Report, changes: list[str], notes: MapNotes) -> list[str]:
    """Return the report, the gravest first."""
    facts = tracks.facts
    untrue = [each for each in report.findings if each.kind == NOT_TRAFFIC]
    loud = [f"{each.kind.upper()}: {each.text}; so no scenario is written" for each in untrue]
    found = [f"found: {each.kind}: {each.text}" for each in report.findings if each.kind != NOT_TRAFFIC]
    lines = [*loud, f"{facts['name']} ({facts['source_format']}): {report.contents}"]
    if report.on_lanes is None:
        lines.append("map: none" + ", so no scenario is written: name it with --map FILE" * report.is_traffic)
    else:
        lines.append(f"map: {report.on_lanes:.2%} of the positions lie on its lanes")
    lines += [f"map: {note}" for note in (*notes.warnings, *notes.remarks)]
    lines += changes
    lines += [f"assumed: {facts['assumed']}"] if "assumed" in facts else []
    lines += [f"left out: {facts['left_out']}"] if "left_out" in facts else []
    lines += found or ["found: nothing implausible"] * report.is_traffic
    lines.append("; ".join([f"licence: {facts['licence']}", *filter(None, [facts.get("attribution")])]))
    return lines
