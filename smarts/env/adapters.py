"""Adapters: an observation and a reward of some agents, as environments use them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, ClassVar, Protocol

from numpy.typing import NDArray

from smarts.arrays import Bools, Singles
from smarts.registry import Registry
from smarts.types.frame import Frame
from smarts.types.interface import Field


class ArrayAdapter(Protocol):
    """Observations and rewards of some egos of all simulations at once, by kernels: no Python for each agent.

    A decision lasts several steps, each of which the adapter gets as a frame. Sums over agents or time are
    taken in a fixed order (kernels, not numpy reductions, whose order depends on B). An adapter is made by a
    call with `AdapterContext`, the agents' interface, and its own options.
    """

    sensors: ClassVar[Collection[str] | None]
    """Names of the agents' sensors whose readings in the frame it uses; None: all."""
    fields: tuple[Field, ...]
    """The observation of one agent. A field `action_mask` says which discrete actions are legal."""

    def collect(self, frame: Frame, is_last: bool) -> object:
        """Process one step of a decision, or a reset; `is_last` if the decision ends with it."""
        ...

    def reset(self, egos: Bools) -> None:
        """Begin episodes of these egos, shape (B, N); their observations become zero."""
        ...

    @property
    def observations(self) -> Mapping[str, NDArray]:
        """Array of each field, shape (B, G, *shape); an agent that ended keeps its last until the reset."""
        ...

    @property
    def rewards(self) -> Singles:
        """Of the decision, shape (B, G)."""
        ...


def _adopt(name: str, found: Any) -> Any:
    """Return a user's adapter: a class with the methods of `ArrayAdapter`, or a function that makes one."""
    if not callable(found):
        raise ValueError(f"is {found!r}, neither a class nor a function that makes one")
    missing = [each for each in ("collect", "reset") if not callable(getattr(found, each, None))]
    if isinstance(found, type) and missing:
        raise ValueError(
            f"has no method {missing[0]!r}: see smarts/env/adapters.py, or derive it from BenchmarkAdapter"
        )
    return found


ADAPTERS = Registry(
    "adapter",
    {name: f"smarts.env.array_adapters:{name.title()}Adapter" for name in ("benchmark", "paper", "raw")},
    _adopt,
)
"""Name -> "module:Class" of an `ArrayAdapter`; a user's own is such a "module:Class"."""
