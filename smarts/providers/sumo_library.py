"""Loads independent copies of libsumo: a library holds one simulation, so each simulation has its own copy.

The loader treats files with different inodes as different libraries. A copy is an anonymous file with SUMO's
extension module and leaves nothing on disk; its dependencies and the Python side of the package are used from
the installation. All copies share their code pages (`shared_code`), so each takes about 4 MB. Threads do not
help: libsumo holds the GIL.
"""

from __future__ import annotations

import ctypes
import importlib
import importlib.machinery
import importlib.util
import os
import re
import shutil
import sys
import threading
import types
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from smarts.errors import TrafficError
from smarts.providers.shared_code import share_code

SYSTEM_PACKAGES = "libgl1 libx11-6 libxext6 libxrender1 libexpat1 libatomic1"
"""Debian packages of the system libraries that libsumo's wheel needs."""

_SUMO_ERRORS = {"TraCIException", "FatalTraCIError", "RuntimeError"}

_MODULE = "_libsumo"
_EXTENSION = f"{_MODULE}.so"
_FILE = "/proc/self/fd/{}"
_INPUTS = ("--net-file", "--route-files", "--additional-files")


def _is_from_sumo(error: Exception) -> bool:
    """Return whether libsumo raised an error; by the class name, since each copy has its own classes."""
    return type(error).__name__ in _SUMO_ERRORS


class SumoLibrary:
    """One copy of libsumo, reserved until `close`.

    Attributes:
        index: Index of the copy, the lowest that is free in this process; it does not affect results.
        vehicle: libsumo's functions of the domain "vehicle"; likewise `lane`, `simulation`, `trafficlight`
            and `vehicletype`.
    """

    def __init__(self) -> None:
        self.index = _claim()
        self._files = _Files()
        # Free the copy even if the caller never calls `close`.
        self._closer = weakref.finalize(self, _give_back, self.index, self._files)
        try:
            extension = _load(self.index)
        except BaseException:
            self._closer()
            raise
        self.lane = _domain(extension, "lane")
        self.simulation = _domain(extension, "simulation")
        self.trafficlight = _domain(extension, "trafficlight")
        self.vehicle = _domain(extension, "vehicle")
        self.vehicletype = _domain(extension, "vehicletype")
        self._place = ""
        self._onward: dict[str, tuple[str, ...]] = {}

    def start(self, options: Sequence[str], place: str = "traffic") -> None:
        """Begin a simulation; it does not depend on the library's earlier simulations.

        Args:
            options: SUMO's command line.
            place: The place that error messages name, now and later.

        Raises:
            TrafficError: SUMO cannot start; the error holds its message.
        """
        self._place = place
        self._onward.clear()
        with self.errors("failed to start"):
            short = self._files.begin(options)
            try:
                self.simulation.load([*short, "--error-log", _FILE.format(self._files.log)])
            except BaseException:
                self._flush_log()
                raise

    @contextmanager
    def errors(self, what: str) -> Iterator[None]:
        """Convert SUMO's errors in the body to a `TrafficError`; the next `start` works."""
        try:
            yield
        except Exception as error:
            if not _is_from_sumo(error):
                raise
            raise self._named(what, error) from None

    def accepts(self, call: Callable[..., object], *arguments: object) -> bool:
        """Make a call, and return whether SUMO raised no error."""
        try:
            call(*arguments)
        except Exception as error:
            if not _is_from_sumo(error):
                raise
            return False
        return True

    def route_ahead(self, name: str) -> tuple[str, ...]:
        """Return the remaining edges of a vehicle's route, the current one first."""
        # The index is -1 before departure.
        return self.vehicle.getRoute(name)[max(self.vehicle.getRouteIndex(name), 0) :]

    def edges_onward(self, lane: str) -> tuple[str, ...]:
        """Return the edges that a lane leads into, those straight on first."""
        if lane not in self._onward:
            links = sorted(self.lane.getLinks(lane), key=lambda link: link[6] != "s")
            self._onward[lane] = tuple(dict.fromkeys(link[0].rpartition("_")[0] for link in links))
        return self._onward[lane]

    def copy_stop(self, name: str, stop: Any) -> None:
        """Give a vehicle a stop of another, unless SUMO does not accept it."""
        edge, _, index = stop.lane.rpartition("_")
        place = stop.stoppingPlaceID or edge
        # The lowest bit says that the stop has been reached; the others are those that `setStop` takes.
        times = stop.duration, stop.stopFlags >> 1, stop.startPos, stop.until
        self.accepts(self.vehicle.setStop, name, place, stop.endPos, int(index), *times)

    def is_out_of_order(self, name: str, lane: str, own: float) -> bool:
        """Return whether SUMO's order on a lane contradicts a vehicle's (`own` [m]) and others' positions."""
        order = self.lane.getLastStepVehicleIDs(lane)
        if len(order) < 2:
            return False
        place, position = order.index(name), self.vehicle.getLanePosition
        if place > 0 and position(order[place - 1]) > own:
            return True
        return place + 1 < len(order) and position(order[place + 1]) < own

    def close(self) -> None:
        """End the simulation and free the copy."""
        if self._closer.alive:
            with self.errors("failed to stop"):
                self.simulation.close()
            self._closer()

    def _named(self, what: str, error: Exception) -> TrafficError:
        """Return a `TrafficError` for an error of SUMO, with the reason that SUMO logged."""
        logged = self._files.logged()
        message = str(error).strip()
        reason = logged.removeprefix("Error: ") if message == "Process Error" and logged else message
        for name, descriptor in self._files.inputs.items():
            reason = re.sub(rf"{_FILE.format(descriptor)}\b", lambda _, name=name: name, reason)
        return TrafficError(
            f"SUMO {what}: {reason}",
            place=self._place,
            remedy="mend the traffic of the scenario and build it again; other simulations are not affected",
        )

    def _flush_log(self) -> None:
        """Make SUMO write its log after a failed start; it does so when the next simulation ends."""
        net = os.memfd_create("empty-net")
        os.write(net, b'<net version="1.20"/>')
        self.simulation.load(["--net-file", _FILE.format(net), "--no-step-log", "--no-warnings"])
        self.simulation.close()
        os.close(net)


class _Files:
    """The files of one simulation, by their descriptors."""

    def __init__(self) -> None:
        self.log = -1
        """SUMO's error log: an anonymous file per start, so that a killed process leaves nothing behind and a
        forked child does not write to its parent's log."""
        self.inputs: dict[str, int] = {}

    def begin(self, options: Sequence[str]) -> list[str]:
        """Open a log, and return the options with input files by descriptor instead of by name.

        SUMO 1.28 leaks the memory of each name about ten times per load (`XMLSubSys::transcodeToLocal`).
        """
        self.close()
        self.log = os.memfd_create("sumo-errors")
        short = [*options]
        for place, option in enumerate(options[:-1]):
            if option in _INPUTS:
                short[place + 1] = ",".join(map(self._opened, options[place + 1].split(",")))
        return short

    def logged(self) -> str:
        """Return the content of the log."""
        return os.pread(self.log, 4096, 0).decode(errors="replace").strip() if self.log >= 0 else ""

    def close(self) -> None:
        """Close all files; may be called repeatedly."""
        while self.inputs:
            os.close(self.inputs.popitem()[1])
        if self.log >= 0:
            os.close(self.log)
            self.log = -1

    def _opened(self, name: str) -> str:
        """Return the short name of a file, or `name` if it cannot be opened: SUMO then reports it."""
        if name not in self.inputs:
            try:
                self.inputs[name] = os.open(name, os.O_RDONLY | os.O_CLOEXEC)
            except OSError:
                return name
        return _FILE.format(self.inputs[name])


def _give_back(index: int, files: _Files) -> None:
    files.close()
    _held.discard(index)


_held: set[int] = set()
_claiming = threading.Lock()


def _claim() -> int:
    with _claiming:
        index = next(number for number in range(len(_held) + 1) if number not in _held)
        _held.add(index)
        return index


def _domain(extension: types.ModuleType, name: str) -> Any:
    """Return libsumo's functions of one domain without their Python wrappers, which double a call's cost."""
    prefix = f"{name}_"
    functions = {key: value for key, value in vars(extension).items() if key.startswith(prefix)}
    return types.SimpleNamespace(**{key.removeprefix(prefix): value for key, value in functions.items()})


def _load(index: int) -> types.ModuleType:
    """Import copy `index`; a copy stays loaded, since extension modules cannot be unloaded."""
    name = f"_smarts_libsumo_{index}"
    known = sys.modules.get(f"{name}.{_MODULE}")
    if known is not None:
        return known
    installed = _installed_package("libsumo")
    _point_to_projections()
    package = types.ModuleType(name)
    package.__path__ = [str(installed)]
    sys.modules[name] = package
    try:
        with os.fdopen(os.memfd_create(_EXTENSION), "wb") as copy:
            shutil.copyfile(installed / _EXTENSION, _FILE.format(copy.fileno()))
            # Anonymous copies cannot find their dependencies by folder, but use those that are loaded.
            ctypes.CDLL(str(installed / _EXTENSION))
            extension = _imported(f"{name}.{_MODULE}", _name_of(copy.fileno(), index))
            setattr(package, _MODULE, extension)
            # The Python side registers the classes of results and errors with the extension.
            importlib.import_module(f"{name}.libsumo")
            share_code(copy.fileno(), installed / _EXTENSION)
    except BaseException as error:
        for part in (name, f"{name}.{_MODULE}", f"{name}.libsumo"):
            sys.modules.pop(part, None)
        # That of a missing library has no number; others are no reason to install one.
        if not isinstance(error, ImportError | OSError) or getattr(error, "errno", None):
            raise
        raise TrafficError(
            f"libsumo does not load: {error}",
            remedy=f"install the system's libraries: apt-get install -y {SYSTEM_PACKAGES}",
        ) from error
    return extension


def _imported(name: str, path: str) -> types.ModuleType:
    """Import an extension module from a file with any name."""
    loader = importlib.machinery.ExtensionFileLoader(name, path)
    module = importlib.util.module_from_spec(importlib.machinery.ModuleSpec(name, loader, origin=path))
    sys.modules[name] = module
    loader.exec_module(module)
    return module


def _name_of(descriptor: int, index: int) -> str:
    """Return a path of an open file that is unique to the copy: the loader identifies libraries by path too.

    Descriptors are reused, so the path encodes the copy's index: "/" for each 0 bit, "./" for each 1 bit.
    """
    number = "".join("./" if digit == "1" else "/" for digit in f"{index:b}")
    return f"/proc/self/{number}fd/{descriptor}"


def _installed_package(name: str) -> Path:
    # `find_spec` does not import the package, which would load an unused copy.
    spec = importlib.util.find_spec(name)
    if spec is None or not spec.submodule_search_locations:
        raise TrafficError(f"{name} is not installed", remedy="pip install libsumo==1.28.0")
    return Path(spec.submodule_search_locations[0])


def _point_to_projections() -> None:
    """Set the environment variables of the projection data, as libsumo's package does."""
    if not os.environ.get("PROJ_LIB") and not os.environ.get("PROJ_DATA"):
        data = str(_installed_package("sumo_data") / "data" / "proj")
        os.environ["PROJ_LIB"] = os.environ["PROJ_DATA"] = data
