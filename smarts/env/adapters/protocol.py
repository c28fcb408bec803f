"""What environments need of observations and rewards as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from gymnasium.spaces import Space
from numpy.typing import NDArray

from smarts.arrays import Bools, Singles
from smarts.types.actions import Actions
from smarts.types.frame import Frame
from smarts.types.interface import Field


class ArrayAdapter(Protocol):
    """Observations and rewards of some egos of all simulations at once, by kernels: no Python for each agent.

    A decision lasts several steps, each of which the adapter gets as a frame. Sums over agents or time are
    taken in a fixed order (kernels, not numpy reductions, whose order depends on B).
    """

    fields: tuple[Field, ...]
    """The observation of one agent. A field `action_mask` says which discrete actions are legal."""
    action_space: Space

    def encode(self, given: NDArray, chosen: Bools, out: Actions) -> None:
        """Write the chosen agents' actions: checked, clipped, marked fresh. A decision begins.

        Args:
            given: Actions in the environment's action space, shape (B, G, ...).
            chosen: The agents whose actions are new, shape (B, G); the others keep their last ones.
            out: To write into, shape (B, A).

        Raises:
            ActionError: An action is not finite or not in the space; names agent and value.
        """
        ...

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
