"""What an adapter for arrays is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from smarts.types.actions import Actions
from smarts.types.frame import Frame
from smarts.types.interface import Field

Bools = NDArray[np.bool_]


class ArrayAdapter(Protocol):
    """Serves the ego seats of all simulations at once, by kernels: there is no Python per agent.

    A decision lasts several steps. In each, the adapter is shown the frame; at the end of the decision it
    hands out what has come together. Sums over agents or time are taken in a fixed order (kernels, not numpy
    reductions, whose order depends on B).
    """

    fields: tuple[Field, ...]
    """The observation of one agent."""

    def encode(self, given: NDArray, chosen: Bools, out: Actions) -> None:
        """Take the chosen agents' actions in: checked, clipped, marked fresh.

        Args:
            given: Actions of all egos in the environment's action space, shape (B, N, ...).
            chosen: Whose actions are new, shape (B, N); the others' last ones go on.
            out: To write into, shape (B, A).

        Raises:
            ActionError: An action is not finite or not in the space; names agent and value.
        """
        ...

    def collect(self, frame: Frame, is_last: bool) -> None:
        """See one step of a decision, or a reset; `is_last` if the decision ends with it."""
        ...

    def reset(self, seats: Bools) -> None:
        """Forget what is remembered of these seats, shape (B, N)."""
        ...

    @property
    def observations(self) -> Mapping[str, NDArray]:
        """Array of each field, shape (B, N, *shape); an agent that ended keeps its last until the reset."""
        ...

    @property
    def rewards(self) -> NDArray[np.float32]:
        """Of the decision, shape (B, N)."""
        ...
