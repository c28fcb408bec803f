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
    whole_from: str | None = None
    """Line of the file that hands over a whole scenario, if any."""

    def add_whole(self, scenario: Scenario, seed: int | None, call: str) -> None:
        """Join a whole scenario to what came before.

        Args:
            scenario: The scenario.
            seed: The seed that it asks for, if it does.
            call: Which line hands it over.

        Raises:
            ScenarioError: It is the second one.
        """
        if self.whole_from is not None:
            raise ScenarioError(
                f"the file hands over two scenarios: gen_scenario is called at {self.whole_from} and {call}",
                remedy="call it once, or hand over parts with gen_traffic, gen_missions, ...",
            )
        self.whole_from = call
        self.add(scenario, seed)

    def add(self, part: Scenario, seed: int | None) -> None:
        """Join the part given to one `gen_*` function to the earlier ones."""
        self.scenario = part if self.scenario is None else join(self.scenario, part)
        self.seed = self.seed if seed is None else seed


_current: ContextVar[Collection | None] = ContextVar("collection", default=None)


def current_collection() -> Collection | None:
    """Return the collection of the running build, None outside of builds."""
    return _current.get()


@contextmanager
def collecting() -> Iterator[Collection]:
    """Collect the calls of the `gen_*` functions in the body."""
    collection = Collection()
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
