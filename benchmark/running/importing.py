"""Own code in further processes: workers import the same files, and what they raise is told with its line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from algorithms.errors import AlgorithmError
from smarts.errors import SmartsError
from smarts.registry import import_own, own_error, place_of


class _Imports:
    """Paths that are imported wherever this is unpickled."""

    def __init__(self, paths: Sequence[str]) -> None:
        self._paths = tuple(paths)
        import_own(self._paths)

    def __reduce__(self):
        return _Imports, (self._paths,)


def importing_runner(kind: type, paths: Sequence[str]) -> type:
    """Return a class of environment runners that imports own code before anything else in its process.

    RLlib's runners are actors of their own, whose arguments name classes of the user's: Ray unpickles the
    actor's class first. That class is in no module, so it is pickled whole, with the paths.
    """
    if not paths:
        return kind
    return type(f"Importing{kind.__name__}", (kind,), {"__module__": __name__, "imports": _Imports(paths)})


@contextmanager
def named_own_code(doing: str) -> Iterator[None]:
    """Raise what comes from own code as an error that names its file and line, and leave other errors.

    Args:
        doing: What is done: the run's name.

    Raises:
        OwnCodeError: The innermost line of own code that the error passed through.
    """
    try:
        yield
    except (SmartsError, AlgorithmError):
        raise
    except Exception as error:
        if place := place_of(error):
            raise own_error(error, doing, place) from error
        raise
