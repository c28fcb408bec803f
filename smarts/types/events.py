"""What happened to agents in a step, and how their episodes end."""

from __future__ import annotations

import enum
from typing import NamedTuple

import numpy as np

from smarts.arrays import Bools, Bytes, Floats, Ints
from smarts.types import columns


class Event(enum.IntFlag):
    """Events as bits, so that those of several steps can be joined and those that end an agent be masked."""

    NONE = 0
    COLLISION = 1
    OFF_ROAD = 2
    OFF_ROUTE = 4
    ON_SHOULDER = 8
    WRONG_WAY = 16
    NOT_MOVING = 32
    REACHED_GOAL = 64
    MISSED_GOAL = 128
    REACHED_MAX_EPISODE_STEPS = 256
    AGENTS_ALIVE_DONE = 512
    INTEREST_DONE = 1024
    VIA_HIT = 2048
    LAP_COMPLETED = 4096
    LEFT_BUBBLE = 8192


class Outcome(enum.IntEnum):
    """How an agent's episode ended; where several hold in one step, the first of COLLISION .. TIME_OUT."""

    NONE = 0
    COLLISION = 1
    OFF_ROAD = 2
    OFF_ROUTE = 3
    MISSED_GOAL = 4
    GOAL = 5
    NOT_MOVING = 6
    TIME_OUT = 7
    OTHER = 8
    """Too few agents or vehicles of interest are left."""
    OTHER_TERMINAL = 9
    """Ended for driving against the direction or on the shoulder."""
    INVALID = 10
    """The episode is to be discarded: vehicles overlapped at the start, or the traffic engine failed."""
    LEFT_BUBBLE = 11
    """The vehicle has left the bubble in which the agent learns."""


TRUNCATING = (Outcome.TIME_OUT, Outcome.OTHER, Outcome.INVALID, Outcome.LEFT_BUBBLE)
"""Outcomes that truncate: the learner bootstraps. All others terminate."""


class Contacts(NamedTuple):
    """Contacts of agents' vehicles in a step, shape (B, A), refilled in place."""

    partner: Ints
    """Slot of the first vehicle that the agent's vehicle touched, -1 for none."""
    partner_generation: Ints
    substep: Bytes
    """The sub-step of first contact."""
    closing_speed: Floats
    """How fast the two approached each other [m/s]."""
    side: Bytes
    """Side on which the agent's vehicle was touched: 0 front, 1 left, 2 rear, 3 right."""
    touching: Bools
    """Every vehicle that it touched, shape (B, A, V)."""

    @classmethod
    def allocate(cls, worlds: int, agents: int, capacity: int) -> Contacts:
        """Return buffers without contacts for B simulations of A agents and V slots."""
        return columns.allocate(cls, (worlds, agents), ("partner",), {"touching": (capacity,)})


class Events(NamedTuple):
    """The events of one step, shape (B, A), refilled in place. Rows that were not stepped have none."""

    bits: Ints
    """An `Event`."""
    just_done: Bools
    """Whether the agent's episode ended in this step."""
    terminated: Bools
    """The episode terminated (no bootstrapping). Never together with `truncated`."""
    truncated: Bools
    """The episode was cut short."""
    finished: Bools
    """Whether no agent is left or to come, shape (B,)."""

    @classmethod
    def allocate(cls, worlds: int, agents: int) -> Events:
        """Return buffers without events for B simulations of A agents."""
        return columns.allocate(cls, (worlds, agents))._replace(finished=np.zeros(worlds, np.bool_))
