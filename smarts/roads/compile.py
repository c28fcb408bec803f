"""Compiling a map of any format into a SUMO network with netconvert or netgenerate, reproducibly."""

from __future__ import annotations

import gzip
import itertools
import re
import tempfile
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import NamedTuple

from smarts.errors import MapError
from smarts.roads.converter_messages import ConverterMessages
from smarts.roads.dropped import dropped_parts, tapering_lanes
from smarts.roads.foreign import mended_opendrive
from smarts.roads.lanelets import LANELET_MAPS, plain_xml, read_lanelets
from smarts.roads.net_repairs import mended_net
from smarts.roads.osm_types import write_road_types
from smarts.roads.sources import MapSource
from smarts.roads.sumo_tools import run_tool, sumo_folder, try_in_sumo
from smarts.roads.validation import validate_net
from smarts.whole_files import written_whole

# Fine curves through junctions: SUMO's default of five points makes vehicles turn in visible kinks.
_JUNCTION_DETAIL = {"junctions.internal-link-detail": "20", "junctions.corner-detail": "5"}

# Foreign maps get `output.original-names`, so that the notes can say what was dropped.
_DEFAULTS: dict[str, dict[str, str]] = {
    # Only nets that are built again come here.
    "sumo_net": {
        **_JUNCTION_DETAIL,
        "no-internal-links": "false",
        "no-turnarounds": "true",
        "offset.disable-normalization": "true",
    },
    # Missions and zones are written in the coordinates of the source.
    **{
        key: {**_JUNCTION_DETAIL, "no-turnarounds": "true", "offset.disable-normalization": "true"}
        for key in ("sumo_plain", *LANELET_MAPS)
    },
    "netgenerate": {**_JUNCTION_DETAIL, "no-turnarounds": "true"},
    "opendrive": {
        **_JUNCTION_DETAIL,
        "no-turnarounds": "true",
        "offset.disable-normalization": "true",
        "opendrive.curve-resolution": "1",
        # Shoulders and sidewalks stay, closed to cars, so that lanes keep their place on the road.
        "opendrive.import-all-lanes": "true",
        # `opendrive.internal-shapes` stays off: it leaves gaps of metres and folded lanes in real maps.
        "output.original-names": "true",
        # Real maps have links to roads that do not exist; what netconvert leaves out becomes a warning.
        "ignore-errors": "true",
    },
    "osm": {
        **_JUNCTION_DETAIL,
        "geometry.remove": "true",
        "roundabouts.guess": "true",
        "ramps.guess": "true",
        "junctions.join": "true",
        "tls.guess-signals": "true",
        "tls.discard-simple": "true",
        "tls.join": "true",
        "keep-edges.by-vclass": "passenger,bus",
        "remove-edges.isolated": "true",
        "osm.turn-lanes": "true",
        "osm.lane-access": "true",
        # Bridges and tunnels have layers; of two that cross, only one is raised where the grade allows it.
        "osm.layer-elevation": "8",
        # A dead end must be left again, else most of a town cannot be reached from its edge.
        "no-turnarounds.except-deadend": "true",
        "output.original-names": "true",
        "ignore-errors": "true",
    },
}
# Messages are counted, and those of one kind put together, by `ConverterMessages`.
_COMMON = {"xml-validation": "never", "aggregate-warnings": "-1"}
_INPUT_OPTIONS = {
    ".net.xml": "sumo-net-file",
    ".net.xml.gz": "sumo-net-file",
    ".nod.xml": "node-files",
    ".edg.xml": "edge-files",
    ".con.xml": "connection-files",
    ".typ.xml": "type-files",
    ".tll.xml": "tllogic-files",
    ".xodr": "opendrive-files",
    ".osm": "osm-files",
    ".osm.xml": "osm-files",
}
_GENERATED_COMMENT = re.compile(rb"<!-- generated on .*?-->\s*", re.DOTALL)


class MapNotes(NamedTuple):
    """Notes for the user of a compiled map."""

    remarks: tuple[str, ...] = ()
    """Warnings of netconvert, and the roads of a foreign map that cars do not use."""
    warnings: tuple[str, ...] = ()
    """Parts of the map that are broken and were dropped, or were built again."""


def compile_map(source: MapSource, out: Path) -> MapNotes:
    """Write the map as a SUMO network to `out`: the same bytes for the same sources, wherever they lie.

    SUMO loads each network once (`try_in_sumo`). A compiled network is checked and copied as it is; one with
    connections to lanes that do not exist, or without lanes inside its junctions, is built again by
    netconvert, with the same edges and lanes. Links of OpenDRIVE and OSM maps that netconvert cannot use are
    left out. `map.netccfg` beside other sources overrides the options chosen here. The file appears complete
    or not at all.

    Raises:
        MapError: A file is broken (with netconvert's own message), or no car can drive anywhere on the map.
    """
    if source.kind == "sumo_net":
        net = _read_bytes(source.files[0])
        content, warnings = mended_net(net, source)
        if not warnings:
            _publish(net, MapNotes(), source, out)
            return MapNotes()
    else:
        content, warnings = mended_opendrive(source) if source.kind == "opendrive" else (None, ())
    out.parent.mkdir(parents=True, exist_ok=True)
    # Beside the map to be, where leftovers are cleared up; but SUMO mistakes commas in paths.
    beside = None if "," in str(out.resolve()) else out.parent
    with tempfile.TemporaryDirectory(prefix=".partial-map-", dir=beside, ignore_cleanup_errors=True) as name:
        work = Path(name).resolve()
        arguments = _arguments(source, _prepared(source, content, work))
        said = _convert(source, arguments, work / "compiled.net.xml")
        net = _GENERATED_COMMENT.sub(b"", _read_bytes(work / "compiled.net.xml"), count=1)
    changes = dropped_parts(source, net) + tapering_lanes(source)
    notes = MapNotes(said.remarks() + changes, warnings + said.left_out())
    _publish(net, notes, source, out)
    return notes


def _prepared(source: MapSource, content: bytes | None, work: Path) -> dict[str, str]:
    """Write what netconvert is to read in place of the user's files; return its options for them."""
    prepared = {}
    if content is not None:
        suffix, option = next(
            pair for pair in _INPUT_OPTIONS.items() if source.files[0].name.endswith(pair[0])
        )
        mended = work / f"mended{suffix.removesuffix('.gz')}"
        mended.write_bytes(content)
        prepared[option] = str(mended)
    if source.kind == "osm":
        prepared["type-files"] = str(write_road_types(sumo_folder(), work))
    if source.kind in LANELET_MAPS:
        file = source.files[0].with_name(source.files[0].name + source.part)
        for part, text in plain_xml(read_lanelets(source.kind, file)).items():
            (work / f"map.{part}.xml").write_text(text, encoding="utf-8")
            prepared[_INPUT_OPTIONS[f".{part}.xml"]] = str(work / f"map.{part}.xml")
    return prepared


def _publish(net: bytes, notes: MapNotes, source: MapSource, out: Path) -> None:
    """Check the network, also by SUMO itself, and put it into place in one step."""
    try:
        validate_net(net, source)
    except MapError as error:
        lost = "; ".join(notes.warnings + notes.remarks)
        if not lost:
            raise
        raise MapError(f"{error.problem} ({lost})", place=error.place, remedy=error.remedy) from error
    with written_whole(out) as partial:
        partial.write_bytes(net)
        files = {"net-file": [partial.name]}
        try_in_sumo(partial.parent, files, ("--end", "1"), str(source.files[0]), "map")


def _read_bytes(path: Path) -> bytes:
    content = path.read_bytes()
    return gzip.decompress(content) if path.suffix == ".gz" else content


def _convert(source: MapSource, arguments: list[str], product: Path) -> ConverterMessages:
    """Write the product; return what the tool said."""
    tool = "netgenerate" if source.kind == "netgenerate" else "netconvert"
    place = str(source.files[0])
    # In the map's folder file names are enough: SUMO splits paths at commas, and repeats them.
    arguments = [*arguments, "--output-file", str(product)]
    code, messages = run_tool(tool, arguments, source.files[0].parent, place)
    if code != 0 or not product.is_file():
        problem = " ".join(messages.errors) or f"exit code {code}"
        if "No edges loaded" in problem:
            problem = " ".join([problem, *dropped_parts(source, b"<net/>")])
        raise MapError(
            f"{tool} refused the map: {problem}",
            place=place,
            remedy=f"mend the file; {tool} --help lists the options",
        )
    if not _ends_whole(product):
        raise MapError(
            f"{tool} could not write the whole network to {product.parent.parent}",
            place=place,
            remedy="make room on that disk",
        )
    return messages


def _ends_whole(product: Path) -> bool:
    # On a full disk netconvert stops writing and says nothing.
    with open(product, "rb") as file:
        file.seek(max(product.stat().st_size - 64, 0))
        return file.read().rstrip().endswith(b"</net>")


def _arguments(source: MapSource, prepared: dict[str, str]) -> list[str]:
    """Return the command line: the user's options file, then our choices for what it leaves open."""
    config = source.files[0] if source.kind == "netgenerate" else source.options
    chosen = _configured_options(config) if config else set()
    files = {} if source.kind in ("netgenerate", *LANELET_MAPS) else _input_files(source)
    arguments = ["--configuration-file", config.name] if config else []
    for option, value in (files | _COMMON | _DEFAULTS[source.kind] | prepared).items():
        if option in files or option not in chosen:
            arguments += [f"--{option}", value]
    return arguments


def _input_files(source: MapSource) -> dict[str, str]:
    """Return the names of the map's files by their options."""
    pairs = itertools.product(source.files, _INPUT_OPTIONS.items())
    return {option: file.name for file, (suffix, option) in pairs if file.name.endswith(suffix)}


def _configured_options(config: Path) -> set[str]:
    try:
        tree = ElementTree.parse(config)
    except ElementTree.ParseError as error:
        raise MapError(f"cannot read the options: {error}", place=str(config)) from error
    return {element.tag for element in tree.iter() if "value" in element.attrib or "v" in element.attrib}
