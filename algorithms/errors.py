"""The errors of the algorithm library: each names what is wrong, where, and what to do about it."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class AlgorithmError(Exception):
    """A user error.

    Args:
        problem: What is wrong, with the offending value.
        place: The object that holds the value.
        remedy: What to do about it.
    """

    def __init__(self, problem: str, *, place: str = "", remedy: str = "") -> None:
        self.problem = problem
        self.place = place
        self.remedy = remedy
        super().__init__(problem, place, remedy)

    def __reduce__(self):
        # Keyword-only arguments do not survive the default pickling, and errors cross process borders.
        return _rebuild, (type(self), self.problem, self.place, self.remedy)

    def __str__(self) -> str:
        where = f"{self.place}: " if self.place else ""
        remedy = f"\n  remedy: {self.remedy}" if self.remedy else ""
        return f"{where}{self.problem}{remedy}"


def _rebuild(kind: type[AlgorithmError], problem: str, place: str, remedy: str) -> AlgorithmError:
    return kind(problem, place=place, remedy=remedy)


class UnknownAlgorithmError(AlgorithmError):
    """A name that is not in the registry."""

    @classmethod
    def of(cls, name: str, known: Iterable[str]) -> UnknownAlgorithmError:
        """Return the error for `name`, offering the nearest of the known names."""
        return cls(f"there is no algorithm {name!r}", place="algorithms", remedy=nearest_names(name, known))


class UnknownSettingError(AlgorithmError):
    """A training setting that the algorithm does not have."""


class SpaceError(AlgorithmError):
    """Spaces or turn-taking that an algorithm does not support."""


class EnvironmentFailure(AlgorithmError):  # noqa: N818 - names the event, and `EnvironmentError` is a builtin
    """An environment failed too often in a row."""


class RunnerFailure(AlgorithmError):  # noqa: N818
    """No environment runner has answered for several iterations."""


class LearnerFailure(AlgorithmError):  # noqa: N818
    """A learner's process is lost, or what it learned is not finite."""


class CheckpointError(AlgorithmError):
    """A checkpoint that does not match the algorithm, agents, spaces, groups or networks."""


class DamagedCheckpointError(CheckpointError):
    """A checkpoint with a file that is missing or cannot be read."""


def nearest_names(name: str, known: Iterable[str]) -> str:
    """Return a remedy that offers the known names closest to `name`."""
    known = sorted({*known})
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    if close:
        return f"did you mean {' or '.join(map(repr, close))}?"
    return f"known: {', '.join(map(repr, known))}"
