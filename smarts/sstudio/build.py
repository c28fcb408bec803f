"""Builds scenarios; artefacts that are up to date are found by a hash of all their inputs.

The inputs are the scenario file, the seed and this program. The index maps them to a key, the hash of the
scenario and its map, and to the hashes of all other files that the scenario file imported or opened under its
folder. So a changed comment runs the scenario file again but writes nothing.
"""

from __future__ import annotations

import fnmatch
import glob
import json
import logging
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from smarts.errors import MapError, ScenarioError, nearest_names
from smarts.roads.sources import MAP_STEM, MapSource, find_map_source
from smarts.sstudio.artefacts import write_artefacts
from smarts.sstudio.built import BuiltScenario
from smarts.sstudio.cache import BuildCache, file_hash
from smarts.sstudio.checks import Checks
from smarts.sstudio.decoding import decode
from smarts.sstudio.encoding import digest, encode
from smarts.sstudio.episodes import check_egos
from smarts.sstudio.executing import Description, run_scenario_file
from smarts.sstudio.locating import SCRIPT, VARIATION_MARK, Location, locate, suite
from smarts.sstudio.recorded_traffic import recording_files, with_histories
from smarts.sstudio.sstypes.drawing import DEFAULT_SEED
from smarts.sstudio.sstypes.map_spec import MapSpec
from smarts.sstudio.sstypes.recording import Recording
from smarts.sstudio.sstypes.scenario import Scenario, Variation
from smarts.sstudio.sstypes.traffic import Traffic
from smarts.types.streams import check_seed

__all__ = ["build_described", "build_scenario", "build_scenarios", "matching", "read_scenario", "suite"]

DESCRIBED = "described"
"""The entry of the index with a scenario that was handed over by hand."""
PLAIN_KINDS = ("nod", "edg", "con", "typ", "tll")
"""The kinds of SUMO's plain XML that make up a map."""
PACKAGE = Path(__file__).resolve().parents[1]
CODE = ("arrays.py", "errors.py", "registry.py", "shipped.py", "whole_files.py")
CODE += ("types", "geometry", "roads", "recordings", "sstudio")
"""The parts of the package that decide what artefacts look like: what the build imports."""
LIBRARIES = ("eclipse-sumo", "numpy", "shapely")
"""Packages whose versions do."""


def build_scenario(path: str | Path, *, seed: int | None = None, egos: int = 0) -> BuiltScenario:
    """Return a built scenario; nothing is written if nothing has changed.

    Args:
        path: A scenario's folder, a map file, or a name of the suite; with "@variation" for one of the
            scenario's held-out variations.
        seed: For what is drawn when the scenario is built; unless given, what the scenario asks for, or 42.
        egos: How many learning agents it is for: if it has missions, at least that many.

    The logger "smarts" warns once of differences between the scenario's files and what is simulated.

    Raises:
        ScenarioError: The scenario cannot be found, run, or be on its map; the message says where and why.
        MapError: The map is missing or broken.
        UnknownNameError: There is no such scenario or variation.
    """
    with _named_failures(os.fspath(path)):
        if seed is not None:
            check_seed(seed, "seed")
        location = locate(path)
        inputs = _fingerprint_inputs(location, seed)
        built = _find_built(location, inputs) or _build(location, _describe(location, seed), inputs)
        check_egos(built.scenario.ego_missions or (), egos, location.label)
        _warn(_place(location), built.warnings)
        return built


def build_scenarios(
    names: Iterable[str], show: Callable[[int, int], object] = lambda built, count: None
) -> None:
    """Build the scenarios that are not built yet, those of several folders side by side.

    Args:
        names: Scenarios, as `build_scenario` takes them.
        show: Called after each with how many are built by now, and how many were to be built.

    Raises:
        SmartsError: As `build_scenario` does, of the first that fails; those that have not begun are left.
    """
    missing = [name for name in dict.fromkeys(names) if not _is_built(name)]
    # Those of one folder wait for each other.
    missing.sort(key=lambda name: name.partition(VARIATION_MARK)[2])
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        # Threads are enough: programs that are started do most of the work.
        for number, each in enumerate(as_completed([pool.submit(build_scenario, name) for name in missing])):
            each.result()
            show(number + 1, len(missing))
    finally:
        pool.shutdown(cancel_futures=True)


def _is_built(name: str) -> bool:
    location = locate(name)
    return _find_built(location, _fingerprint_inputs(location, None)) is not None


def matching(pattern: str) -> list[str]:
    """Return the scenarios that a pattern stands for: "maps/train-*", "*_v1", "intersection@three_*".

    These are scenarios of the suite, or else folders; behind an "@", held-out variations of a scenario. Any
    other name stands for itself, as does a pattern that fits nothing. Nothing is built.

    Raises:
        SmartsError: A scenario whose variations are asked for cannot be read.
    """
    base, mark, variation = pattern.partition(VARIATION_MARK)
    if mark and glob.has_magic(variation):
        location = locate(base)
        built = _find_built(location, _fingerprint_inputs(location, None))
        known = built.held_out if built else _read(location).held_out or ()
        found = [f"{base}{mark}{each}" for each in fnmatch.filter(known, variation)]
    else:
        found = fnmatch.filter(suite(), pattern) or sorted(glob.glob(pattern))
    return found if found and glob.has_magic(pattern) else [pattern]


def read_scenario(path: str | Path) -> Scenario:
    """Return a scenario without building it; its file runs only if there is no build of it, once for all.

    Of a family, whose maps are alike in what an experiment asks for, any map is the first one until it is
    built.

    Raises:
        SmartsError: As `build_scenario` does for what is found without building.
    """
    location = locate(path)
    built = _find_built(location, _fingerprint_inputs(location, None))
    if built is not None:
        return built.scenario
    whole = _read(replace(location, variation=None))
    scenario = whole if location.variation is None else replace(whole, **_changes(location, whole))
    with _map_source(location, scenario.map_spec):
        return scenario


def _read(location: Location) -> Scenario:
    """Return what a scenario's file describes; it runs again when it or a file that it reads has changed."""
    place = location, _fingerprint_inputs(location, None)
    scenario, files = _scenarios_read.get(place, (None, {}))
    if scenario is None or files != _hashes(location.directory, files):
        description = _describe(location, None)
        files = _hashes(location.directory, map(os.fspath, description.files))
        scenario = description.scenario
        _scenarios_read[place] = scenario, files
    return scenario


_scenarios_read: dict[tuple[Location, str], tuple[Scenario, dict[str, Any]]] = {}
"""What was read in this process, and the hashes of the files that it was read from."""


def build_described(directory: Path, scenario: Scenario, seed: int = DEFAULT_SEED) -> BuiltScenario:
    """Build a scenario given as an object into a folder, and remember it there.

    `build_scenario` finds it again, unless the folder has a scenario file, which counts before it.
    """
    with _named_failures(str(directory)):
        location = Location(directory.name, directory, described_only=True)
        check_seed(seed, str(directory))
        built = _build(location, Description(_portable(scenario, location), seed))
        _warn(_place(location), built.warnings)
        return built


@contextmanager
def _named_failures(place: str) -> Iterator[None]:
    """Turn errors of the file system into errors that name the user's file or folder, `place`."""
    try:
        yield
    except OSError as error:
        where = f" ({error.filename})" if error.filename and str(error.filename) != place else ""
        problem = f"building the scenario failed: {error.strerror or error}{where}"
        raise ScenarioError(
            problem, place=place, remedy="make room on that disk, or give yourself access"
        ) from error


@cache
def _warn(place: str, warnings: tuple[str, ...]) -> None:
    """Log the warnings of a built scenario once in a process."""
    for warning in warnings:
        logging.getLogger("smarts").warning("%s: %s", place, warning)


def _find_built(location: Location, inputs: str) -> BuiltScenario | None:
    for root in location.builds:
        built = _up_to_date(BuildCache(root), location, inputs)
        if built is not None:
            return built
    return None


def _up_to_date(cache: BuildCache, location: Location, inputs: str) -> BuiltScenario | None:
    entry = cache.read(inputs)
    artefacts = cache.artefacts(entry["key"]) if entry else None
    if entry is None or artefacts is None:
        return None
    files = entry["files"]
    if files != _hashes(location.directory, files):
        return None
    try:
        source = find_map_source(location.directory, entry["map"]) if "map" in entry else None
    except MapError:
        return None  # found again, and reported, by the build
    if source is not None and not set(_relative(location.directory, source.files)) <= set(files):
        return None
    return BuiltScenario(location.label, location.directory, artefacts)


def _build(location: Location, description: Description, inputs: str | None = None) -> BuiltScenario:
    """Build a scenario found by its inputs; without any it was handed over by hand, and is remembered."""
    with _map_source(location, description.scenario.map_spec) as source:
        return _build_on(source, location, description, inputs)


@contextmanager
def _map_source(location: Location, spec: MapSpec | None) -> Iterator[MapSource]:
    """Provide the files of a scenario's map: its own ones, or its texts in a temporary folder."""
    if spec is None or spec.plain is None:
        yield find_map_source(location.directory, spec and spec.source)
        return
    checks = Checks(_place(location))
    with tempfile.TemporaryDirectory() as folder:
        for kind, text in spec.plain.items():
            checks.choice(kind, PLAIN_KINDS, "map_spec.plain")
            Path(folder, f"{MAP_STEM}.{kind}.xml").write_text(text, encoding="utf-8")
        try:
            yield find_map_source(Path(folder))
        except MapError as error:
            if not error.place.startswith(folder):
                raise
            # The user has the texts, not the files.
            problem = error.problem.replace(f"{folder}/", "")
            raise MapError(problem, place=checks.at("map_spec.plain"), remedy=error.remedy) from error


def _build_on(
    source: MapSource, location: Location, description: Description, inputs: str | None
) -> BuiltScenario:
    directory, spec = location.directory, description.scenario.map_spec
    map_key = digest(
        [source.kind + source.part, [(file.name, file_hash(file)) for file in source.files], _toolchain()],
        size=8,
    )
    content = encode(description.scenario)
    # As text, in which mappings keep their order: episodes take variations in it.
    variations = (description.scenario.traffic or {}).values()
    files = [file for each in variations for file in (*each.route_files, *each.additional_files)]
    files += recording_files(description.scenario, directory)
    traffic_files = _hashes(directory, files)
    key = digest([json.dumps(content), map_key, description.seed, _toolchain(), traffic_files], size=8)
    entry: dict[str, Any] = {"key": key}
    entry["files"] = _hashes(directory, _relative(directory, description.files)) | traffic_files
    if spec is None or spec.plain is None:
        entry["map"] = spec and spec.source
        entry["files"] |= _hashes(directory, _relative(directory, source.files))
    cache = BuildCache.writable(location.builds)
    with cache.lock():
        if cache.artefacts(key) is None:
            twin = cache.read(f"map-{map_key}")
            like = cache.artefacts(twin["key"]) if twin else None
            with cache.publish(key) as folder:
                write_artefacts(folder, description, source, like, _place(location), directory)
            cache.write(f"map-{map_key}", {"key": key})
            cache.prune()
        if inputs is None:
            cache.write(DESCRIBED, {"scenario": content, "seed": description.seed})
            inputs = _fingerprint_inputs(location, None)
        cache.write(inputs, entry)
    return BuiltScenario(location.label, directory, cache.root / key)


def _describe(location: Location, seed: int | None) -> Description:
    description = _described_base(location, DEFAULT_SEED if seed is None else seed)
    scenario = _portable(description.scenario, location)
    description = replace(description, scenario=scenario)
    if location.variation is None or description.is_wanted:
        return description if seed is None else _seeded(description, seed)
    changed = replace(scenario, **_changes(location, scenario))
    own_seed = (scenario.held_out or {})[location.variation].seed
    varied = replace(description, scenario=changed, seed=description.seed if own_seed is None else own_seed)
    return varied if seed is None else _seeded(varied, seed)


def _seeded(description: Description, seed: int) -> Description:
    """Return a description of which all is drawn with one seed."""
    scenario = description.scenario
    traffic = {name: replace(each, seed=None) for name, each in (scenario.traffic or {}).items()}
    return replace(description, scenario=replace(scenario, traffic=traffic or None), seed=seed)


def _described_base(location: Location, seed: int) -> Description:
    if location.script is not None:
        return run_scenario_file(location.script, seed, location.variation)
    if location.map_file is not None:
        return Description(Scenario(map_spec=MapSpec(location.map_file)), seed)
    for root in location.builds:
        entry = BuildCache(root).read(DESCRIBED)
        if entry is not None:
            return Description(decode(entry["scenario"]), entry["seed"])
    try:
        find_map_source(location.directory)
    except MapError as error:
        raise ScenarioError(
            f"not a scenario: there is no {SCRIPT} and no map",
            place=str(location.directory),
            remedy=error.remedy,
        ) from error
    return Description(Scenario(), seed)


def _changes(location: Location, scenario: Scenario) -> dict[str, Any]:
    """Return the parts of a scenario that its variation replaces.

    Raises:
        ScenarioError: There is no such variation.
    """
    name, held_out = str(location.variation), scenario.held_out or {}
    if name not in held_out:
        raise ScenarioError(
            f"there is no held-out variation {name!r}",
            place=_place(location),
            remedy=nearest_names(name, held_out) if held_out else "it has none: leave out @...",
        )
    parts = {part: getattr(held_out[name], part) for part in ("map_spec", "traffic", "ego_missions")}
    return {"held_out": None, **{part: given for part, given in parts.items() if given is not None}}


def _portable(scenario: Scenario, location: Location) -> Scenario:
    """Return the scenario with its paths relative to its folder, so that it can be moved with it.

    Raises:
        ScenarioError: A part that is needed before the build's checks is of another type.
    """
    directory, checks = location.directory, Checks(_place(replace(location, variation=None)))
    checks.named(scenario.traffic, Traffic, "traffic")
    for where, variation in checks.named(scenario.held_out, Variation, "held_out"):
        checks.named(variation.traffic, Traffic, f"{where}.traffic")
    if scenario.map_spec is not None:
        checks.type(scenario.map_spec, MapSpec, "map_spec")
        checks.named(scenario.map_spec.plain, str, "map_spec.plain")

    def portable(traffic: Mapping[str, Traffic] | None) -> Mapping[str, Traffic] | None:
        return traffic and {name: _portable_traffic(each, directory) for name, each in traffic.items()}

    scenario = with_histories(scenario, checks)
    held_out = {
        name: replace(
            variation,
            map_spec=_portable_spec(variation.map_spec, directory),
            traffic=portable(variation.traffic),
        )
        for name, variation in (scenario.held_out or {}).items()
    }
    return replace(
        scenario,
        map_spec=_portable_spec(scenario.map_spec, directory),
        traffic=portable(scenario.traffic),
        held_out=held_out or None,
    )


def _portable_traffic(traffic: Traffic, directory: Path) -> Traffic:
    if not isinstance(traffic.recording, Recording):
        return traffic
    source = _from_folder(traffic.recording.source, directory) or "."
    return replace(traffic, recording=replace(traffic.recording, source=source))


def _portable_spec(spec: MapSpec | None, directory: Path) -> MapSpec | None:
    return spec and replace(spec, source=_from_folder(spec.source, directory) or ".")


def _from_folder(path: str | None, directory: Path) -> str | None:
    if path is None or not os.path.isabs(path):
        return path
    return Path(os.path.relpath(path, directory)).as_posix()


def _place(location: Location) -> str:
    file = str(
        location.directory / SCRIPT if location.script else location.directory / (location.map_file or "")
    )
    return file if location.variation is None else f"{file}: held_out[{location.variation!r}]"


def _fingerprint_inputs(location: Location, seed: int | None) -> str:
    files: list[Path] = []
    if location.script is not None:
        files = [location.script]
    elif location.map_file is None:
        files = [root / "index" / f"{DESCRIBED}.json" for root in location.builds]
    contents = [(file.name, file_hash(file)) for file in files if file.is_file()]
    return digest([contents, seed, location.variation, _toolchain()], size=8)


def _relative(directory: Path, files: Iterable[Path]) -> list[str]:
    return [Path(os.path.relpath(file, directory)).as_posix() for file in files]


def _hashes(directory: Path, files: Iterable[str]) -> dict[str, Any]:
    return {file: file_hash(directory / file) for file in files}


@cache
def _toolchain() -> str:
    """Return a hash of this program's code and libraries, which turn sources into artefacts."""
    code = sorted(file for part in CODE for file in [*(PACKAGE / part).rglob("*.py"), PACKAGE / part])
    hashes = [(file.relative_to(PACKAGE).as_posix(), file_hash(file)) for file in code]
    return digest([[version(library) for library in LIBRARIES], hashes], size=8)
