"""Transfers: vehicles changing hands, as rows of one array."""

from __future__ import annotations

import enum
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


class Reason(enum.IntEnum):
    """Why a vehicle changes hands. Of several transfers in one step, lower numbers go first."""

    LEAVE = 0
    """The vehicle leaves the simulation."""
    RELEASE = 1
    """An agent lets go of it."""
    TAKE = 2
    """An agent takes it over."""
    SHADOW = 3
    """An agent begins to observe it."""


class Refusal(enum.IntEnum):
    """Why a provider cannot drive on with a vehicle, as its `can_accept` answers."""

    NONE = 0
    """It can."""
    OFF_LANES = 1
    """The vehicle stands on no lane."""
    KIND = 2
    """The provider cannot drive vehicles of this kind."""


TRANSFER = np.dtype(
    [
        ("row", np.int32),
        ("slot", np.int32),
        ("generation", np.int32),
        ("from_owner", np.int8),
        ("from_agent", np.int16),
        ("to_owner", np.int8),
        ("to_agent", np.int16),
        ("reason", np.int8),
    ]
)
"""Vehicle (slot, generation) of simulation `row` goes from an owner and an agent to others; agent -1 is none.
The `from` side is what the proposer saw: a transfer that finds something else is refused."""

Transfers = NDArray[np.void]
"""Of dtype `TRANSFER`, shape (T,)."""

NO_TRANSFERS: Transfers = np.zeros(0, TRANSFER)
NO_TRANSFERS.flags.writeable = False


def transfers(rows: Sequence[tuple[int, int, int, int, int, int, int, int]]) -> Transfers:
    """Return an array of transfers, each given in the order of `TRANSFER`'s columns."""
    return np.array([*rows], TRANSFER) if rows else NO_TRANSFERS
