"""Registries: names of parts that are imported only when one is asked for; `module:Class` of own code.

Own code is named as in `my_package.my_module:MyClass`. Its module is installed, or made importable by
`import_own`; a name is resolved when it is asked for, in whatever process that is.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from smarts.errors import OwnCodeError, SmartsError, UnknownNameError, nearest_names, shown
from smarts.shipped import local

OWN_NAME = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")
"""`module:Class`; everything else is a registered name."""

FAILURES = (Exception, SystemExit)
"""What own code may raise that is its error: `sys.exit` in it does not end the command."""

Called = TypeVar("Called", bound=Callable[..., Any])


def is_own_name(name: str) -> bool:
    """Return whether a name is a `module:Class`."""
    return OWN_NAME.fullmatch(name) is not None


def file_name(name: str) -> str:
    """Return a name for files and folders: of `my_module:MyClass` it is `my_module-MyClass`.

    Others stay as they are. Python's names have no "-", so different names stay different.
    """
    return name.replace(":", "-")


class Registry(Mapping[str, Any]):
    """Parts of one kind by name. Listing the names imports nothing.

    Args:
        kind: What the parts are, for errors: "sensor".
        places: "module:attribute" of each name.
        adopt: Checks what a `module:Class` of a user's stands for, and returns the part, under that name.
            It raises a ValueError that says what is wrong, as "has no method 'act'". None: there are only the
            registered parts.

    Own parts that have been asked for are listed behind the registered ones.
    """

    def __init__(
        self,
        kind: str,
        places: Mapping[str, str],
        adopt: Callable[[str, Any], Any] | None = None,
    ) -> None:
        self.kind = kind
        self._places = dict(places)
        self._adopt = adopt
        self._own: dict[str, Any] = {}
        self._added: set[str] = set()

    def __getitem__(self, name: str) -> Any:
        """Import and return a part.

        Raises:
            UnknownNameError: No part has this name; the remedy names the nearest ones.
            OwnCodeError: A `module:Class`, or what `add` registered, is not importable or not such a part.
        """
        if name in self._places and name not in self._added:
            module, _, attribute = self._places[name].partition(":")
            return getattr(importlib.import_module(module), attribute)
        adopt = self._adopt or (lambda name, found: found)
        if name in self._places:
            return adopted(self.kind, self._places[name], adopt)
        if self._adopt is None or not is_own_name(name):
            raise UnknownNameError(
                f"there is no {self.kind} {name!r}", remedy=nearest_names(name, self._places)
            )
        if name not in self._own:
            self._own[name] = adopted(self.kind, name, adopt)
        return self._own[name]

    def add(self, name: str, place: str) -> None:
        """Register a part of the caller's, for this process.

        Args:
            name: Its name.
            place: "module:attribute".

        Raises:
            SmartsError: The name is taken, in a registry that checks users' parts.
        """
        if self._adopt is not None and self._places.get(name, place) != place:
            raise SmartsError(
                f"there is a {self.kind} {name!r} already, {self._places[name]}", remedy="choose another name"
            )
        self._places[name] = place
        self._added.add(name)

    def __contains__(self, name: object) -> bool:
        return name in self._places or name in self._own

    def __iter__(self) -> Iterator[str]:
        return iter((*self._places, *self._own))

    def __len__(self) -> int:
        return len(self._places) + len(self._own)


def adopted(kind: str, name: str, adopt: Callable[[str, Any], Any]) -> Any:
    """Import `module:Class` and return what `adopt` makes of it.

    Raises:
        OwnCodeError: It cannot be imported, or `adopt` raises; names the file and line of the user's code.
    """
    found = load_own(name, kind)
    try:
        return adopt(name, found)
    except SmartsError:
        raise
    except FAILURES as error:  # whatever a constructor of the user's raises
        own = place_of(error)
        place = own or definition_of(found) or str(sys.modules[name.partition(":")[0]].__file__)
        if isinstance(error, ValueError) and not own:
            raise OwnCodeError(f"{name!r} is no {kind}: it {error}", place=place) from error
        raise own_error(error, f"{kind} {name!r}", place) from error


def load_own(name: str, kind: str = "part") -> Any:
    """Import what a `module:Class` names.

    Args:
        name: Name of the part.
        kind: What it should be, for errors.

    Raises:
        OwnCodeError: There is no such module or nothing of that name in it, or importing it raises.
    """
    module, _, path = name.partition(":")
    found: Any = load_module(module, kind, name)
    file = str(getattr(found, "__file__", None) or module)
    for attribute in path.split("."):
        if not hasattr(found, attribute):
            raise OwnCodeError(
                f"there is no {attribute!r} for the {kind} {name!r}",
                place=file,
                remedy=nearest_names(attribute, [each for each in vars(found) if not each.startswith("_")]),
            )
        found = getattr(found, attribute)
    return found


def load_module(module: str, kind: str, name: str = "") -> ModuleType:
    """Import a module of the user's.

    Args:
        module: Its name.
        kind: What it holds, for errors.
        name: Name of what it holds, by default the module's.

    Raises:
        OwnCodeError: There is no such module, or importing it raises.
    """
    part, top = f"{kind} {name or module!r}", module.partition(".")[0]
    place = place_of_module(top)
    if place is not None and top != __name__.partition(".")[0]:  # our zoo's modules are no own code
        _OWN_ROOTS.setdefault(top, place)
    try:
        return importlib.import_module(module)
    except FAILURES as error:
        if isinstance(error, ModuleNotFoundError) and f"{module}.".startswith(f"{error.name}."):
            raise OwnCodeError(
                f"there is no module {error.name!r} for the {part}",
                place=str(place or ""),
                remedy="install it, or give its file or folder: --import PATH, or `imports: [PATH]`",
            ) from error
        raise own_error(error, f"importing the {part}", place_of(error)) from error


def own_error(error: BaseException, doing: str, place: str) -> OwnCodeError:
    """Return the error for what a user's code raised.

    Args:
        error: That.
        doing: What raised: "the metric 'my_file:MY_METRIC'".
        place: File and line.
    """
    text = str(error.msg if isinstance(error, SyntaxError) else error)
    if type(error).__module__.startswith("numba."):  # of a kernel; the message has several lines, and colours
        text = re.sub(r"\x1b\[\d*m", "", text)
        if found := re.search(r" at (\S+\.py) \((\d+)\)", text):
            place = f"{found[1]}:{found[2]}"
        text = next(line for line in text.splitlines() if line and not line.startswith("Failed in "))
    said = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return OwnCodeError(f"{doing} raises {said}", place=place)


def guarded(function: Called, doing: str) -> Called:
    """Return a function of a user's whose errors name its file and line.

    Args:
        function: The user's function.
        doing: What raises, for errors: "the metric 'my_file:MY_METRIC'".

    Raises:
        OwnCodeError: Whatever it raises, but for errors of this project; or it is no function.
    """
    if not callable(function):
        raise OwnCodeError(f"{doing} gives {shown(function)} in place of a function")

    @functools.wraps(function)
    def call(*values: Any, **named: Any) -> Any:
        try:
            return function(*values, **named)
        except SmartsError:
            raise
        except FAILURES as error:
            if is_of_ray(error):
                raise
            *_, last = traceback.extract_tb(error.__traceback__)
            # One that cannot be called with these arguments has no line in the traceback.
            place = definition_of(function) if last.filename == __file__ else f"{last.filename}:{last.lineno}"
            raise own_error(error, doing, place_of(error) or place) from error

    return call  # type: ignore[return-value]


def is_of_ray(error: BaseException) -> bool:
    """Return whether an exit is Ray's, which ends its process, whatever runs in it."""
    return hasattr(error, "ray_terminate_msg")


def definition_of(part: Any) -> str:
    """Return the file and line that define a function, a class or what calls an object; "" if unknown."""
    if not (inspect.isroutine(part) or isinstance(part, type)):
        part = type(part).__call__ if callable(part) else None
    try:
        part = inspect.unwrap(part)
        return f"{inspect.getsourcefile(part)}:{inspect.getsourcelines(part)[1]}"
    except (TypeError, OSError):
        return ""


_OWN_ROOTS: dict[str, Path] = {}
"""Top-level module of own code -> its file or folder."""
_GIVEN: dict[str, Path] = {}
"""Those among them that `import_own` has made importable."""


class _GivenFinder(MetaPathFinder):
    """Finds the files and folders that users have given, and nothing beside them."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return where a given module is (importlib)."""
        if path is not None or fullname not in _GIVEN:
            return None
        return PathFinder.find_spec(fullname, [str(_GIVEN[fullname].parent)])


_FINDER = _GivenFinder()


def own_paths() -> list[str]:
    """Return the files and folders that `import_own` has made importable."""
    return [str(path) for path in _GIVEN.values()]


def import_own(paths: Iterable[str | Path]) -> None:
    """Make Python files and folders importable: `x.py` as module `x`, a folder `x` as package `x`.

    Nothing else beside them becomes importable, and nothing is imported yet. A path may be given again.

    Raises:
        OwnCodeError: A path is no Python file or folder, or its name cannot be imported or is taken.
    """
    for given in paths:
        path = local(Path(given).absolute())
        name = path.stem if path.suffix == ".py" else path.name
        if not path.exists() or (path.is_file() and path.suffix != ".py"):
            raise OwnCodeError(
                "there is no such Python file or folder",
                place=str(given),
                remedy="give its place: --import PATH, or `imports: [PATH]`; from Python imports=[PATH]",
            )
        if not name.isidentifier():
            raise OwnCodeError(
                f"{name!r} cannot be the name of a module",
                place=str(given),
                remedy="rename it: letters, digits and '_'",
            )
        taken = None if _GIVEN.get(name) == path else place_of_module(name)
        if taken is not None and taken.resolve() != path.resolve():
            raise OwnCodeError(
                f"the name {name!r} is taken by {taken}", place=str(given), remedy="rename the file or folder"
            )
        _GIVEN[name] = _OWN_ROOTS[name] = path
    importlib.invalidate_caches()  # the files may be newer than what Python knows of their folder
    if _GIVEN and _FINDER not in sys.meta_path:
        sys.meta_path.insert(0, _FINDER)


def place_of_module(name: str) -> Path | None:
    """Return a module's file, or a package's folder; None of what is built in, or is not there."""
    try:
        spec = importlib.util.find_spec(name)
    except ValueError:  # of __main__
        return None
    if spec is None:
        return None
    if spec.submodule_search_locations:
        return Path(next(iter(spec.submodule_search_locations)))
    return Path(spec.origin) if spec.has_location and spec.origin else None


def place_of(error: BaseException) -> str:
    """Return file and line of own code where an error was raised, "FILE:LINE"; "" if it is not from there.

    Of several places the innermost counts. A syntax error is where it says.
    """
    if isinstance(error, SyntaxError) and error.filename and error.filename.endswith(".py"):
        return f"{error.filename}:{error.lineno}"
    places = [
        f"{frame.filename}:{frame.lineno}"
        for frame in traceback.extract_tb(error.__traceback__)
        if any(Path(frame.filename).is_relative_to(root) for root in _OWN_ROOTS.values())
    ]
    return places[-1] if places else ""
