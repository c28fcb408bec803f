"""Collects the calls of the `gen_*` functions of a scenario file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields, replace
from typing import Any

from smarts.errors import ScenarioError
from smarts.sstudio.sstypes.scenario import Scenario
from smarts.sstudio.sstypes.standard_metadata import StandardMetadata


@dataclass
class Collection:
    """The scenario that a running file has described so far."""

    scenario: Scenario | None = None
    """None until the file calls the first `gen_*` function."""
    seed: int | None = None
    """The seed that the file names, if any."""
    is_whole: bool = False
    """Whether the file has handed over a whole scenario."""
    wanted: str | None = None
    """The variation that is being built, if any."""
    is_wanted: bool = False
    """Whether `scenario` is that variation already, as it is of a family of maps."""

    def add(self, part: Scenario, seed: int | None, is_whole: bool = False) -> None:
        """Join the part given to one `gen_*` function to the earlier ones.

        Raises:
            ScenarioError: It is the second whole scenario.
        """
        if is_whole and self.is_whole:
            raise ScenarioError(
                "the file hands over a second scenario",
                remedy="call gen_scenario once, or hand over parts with gen_traffic, gen_missions, ...",
            )
        self.is_whole = is_whole or self.is_whole
        self.scenario = part if self.scenario is None else join(self.scenario, part)
        self.seed = self.seed if seed is None else seed


_current: ContextVar[Collection | None] = ContextVar("collection", default=None)


def current_collection() -> Collection | None:
    """Return the collection of the running build, None outside of builds."""
    return _current.get()


@contextmanager
def collecting(wanted: str | None = None) -> Iterator[Collection]:
    """Collect the calls of the `gen_*` functions in the body, of which a family of maps draws `wanted`."""
    collection = Collection(wanted=wanted)
    token = _current.set(collection)
    try:
        yield collection
    finally:
        _current.reset(token)


def join(first: Scenario, second: Scenario) -> Scenario:
    """Return both as one: lists follow each other; of equal names and single things the later wins."""
    defaults = Scenario()
    changes = {}
    for field in fields(Scenario):
        added = getattr(second, field.name)
        if added != getattr(defaults, field.name):
            changes[field.name] = _joined(getattr(first, field.name), added)
    return replace(first, **changes)


def _joined(first: Any, second: Any) -> Any:
    if isinstance(second, StandardMetadata):
        return second  # metadata are a mapping, too, but say one thing as a whole
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        return {**first, **second}
    if isinstance(first, list | tuple) and isinstance(second, Sequence):
        return (*first, *second)
    return second
