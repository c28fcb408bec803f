"""Transfers: vehicles changing hands."""

from __future__ import annotations

import enum
from typing import NamedTuple

from smarts.types.agent_states import UNSET


class Reason(enum.IntEnum):
    """Why a vehicle changes hands. Of several transfers in one step, those with lower numbers come first."""

    LEAVE = 0
    """The vehicle leaves the simulation."""
    RELEASE = 1
    """An agent gives it back."""
    TAKE = 2
    """An agent takes it over."""
    SHADOW = 3
    """An agent begins to observe it."""


class Refusal(enum.IntEnum):
    """Why a vehicle does not change hands now; the transfer can be proposed again in the next step."""

    NONE = 0
    """It does."""
    OFF_LANES = 1
    """The vehicle stands on no lane."""
    KIND = 2
    """The provider cannot drive vehicles of this kind."""
    STALE = 3
    """The vehicle is gone, or has another owner or agent than the proposer saw."""
    FULL = 4
    """All columns of the agent's interface are held."""
    NO_ACTION = 5
    """The agent that is to drive has not acted yet."""
    TOO_CLOSE = 6
    """Another vehicle is too near."""
    IN_JUNCTION = 7
    """A part of the vehicle is inside a junction, or will be within two steps."""
    HEADING = 8
    """The vehicle is not aligned with its lane."""
    OFFSET = 9
    """The vehicle is beside its lane's centreline."""
    OTHER_LANE = 10
    """The traffic engine has the vehicle on another lane."""
    NO_WAY = 11
    """No route continues from the vehicle's lane."""
    SPEED = 12
    """Traffic would have to brake the vehicle hard."""
    SIDEWAYS = 13
    """The vehicle moves sideways faster than a vehicle drives, or leans to its lane."""
    WITHOUT_PRIORITY = 14
    """Traffic has the vehicle on its way through a junction without priority: it can no longer stop."""
    TIGHT_TURN = 15
    """A turn within the next 100 m is too tight for a vehicle of its kind."""


class Departure(enum.IntEnum):
    """Why an agent's vehicle leaves the simulation."""

    NONE = 0
    """It does not."""
    OWN = 1
    """The vehicle came with the agent, whose episode is over."""
    COLLISION = 2
    """The vehicle has stood as an obstacle for its time."""
    OFF_LANES = 3
    """The vehicle stands beside all lanes."""
    ARRIVED = 4
    """The vehicle has reached the end of a lane that leads nowhere."""


class Transfer(NamedTuple):
    """Vehicle (slot, generation) of simulation `row` goes from an owner and an agent to others.

    The `from` side is what the proposer saw: a transfer that finds something else is refused.
    """

    row: int
    slot: int
    generation: int
    from_owner: int
    from_agent: int
    """The agent_id that holds the vehicle, -1 for none."""
    to_owner: int
    to_agent: int
    """The agent_id that gets the vehicle, -1 for none."""
    reason: int
    """A `Reason`."""
    number: int = UNSET
    """Number of an agent that has no column yet: the transfer gives it one of its interface's columns.
    Needs `to_agent` -1; -1 for none."""
    departure: int = Departure.NONE
    """A `Departure`; of LEAVE."""


class CarriedOut(NamedTuple):
    """A transfer that has been carried out."""

    transfer: Transfer
    refusals: int = 0
    """Steps in which it was refused before."""
    last_refusal: int = Refusal.NONE
    """The `Refusal` of the last of them."""
