"""Serial numbers of unnamed objects, and the random stream, of a running scenario file.

Both restart with every build, so that the same file always describes the same scenario.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cached_property
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from numpy.random import Generator

DEFAULT_SEED = 42
"""The seed of a scenario that names none."""


class Drawing:
    """The serial numbers and the random stream of one run of a scenario file."""

    def __init__(self, seed: int = DEFAULT_SEED, generator: Generator | None = None) -> None:
        self._seed, self._given = seed, generator
        self._serials: Counter[str] = Counter()

    def serial(self, kind: str) -> str:
        """Return "kind-1" for the first unnamed thing of a kind, "kind-2" for the second, and so on."""
        self._serials[kind] += 1
        return f"{kind}-{self._serials[kind]}"

    @cached_property
    def generator(self) -> Generator:
        """The stream of zones' random offsets, and of distributions that are given no other."""
        if self._given is not None:
            return self._given
        # Local: a scenario file that samples nothing need not wait for NumPy.
        from smarts.types.streams import Purpose, stream

        return stream(self._seed, Purpose.BUILD)


_current: ContextVar[Drawing | None] = ContextVar("drawing", default=None)


def drawing() -> Drawing:
    """Return the numbers and the stream of the running scenario file."""
    current = _current.get()
    if current is None:
        current = Drawing()
        _current.set(current)
    return current


@contextmanager
def fresh_drawing(seed: int = DEFAULT_SEED, generator: Generator | None = None) -> Iterator[Drawing]:
    """Restart numbers and stream for one run of a scenario file.

    Args:
        seed: Seed of the stream.
        generator: The stream to draw from instead.
    """
    token = _current.set(Drawing(seed, generator))
    try:
        yield drawing()
    finally:
        _current.reset(token)
