"""Frames: the results of one step, or of a reset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from numpy.typing import NDArray

from smarts.arrays import Bools, Ints
from smarts.errors import SmartsError
from smarts.types.actions import Actions, Commands
from smarts.types.bubbles import BubbleStates
from smarts.types.episode import EpisodeStart
from smarts.types.events import Contacts, Events
from smarts.types.transfers import CarriedOut
from smarts.types.world import World


@dataclass(frozen=True)
class Readings:
    """The sensors' readings, by group of agents with equal options.

    Only the entries of observed agents are of this step; the others are left as they were.
    """

    blocks: Mapping[str, Mapping[str, NDArray]]
    """Sensor -> field -> array of shape (B, G, ...), G the agents that have the sensor."""
    agent_ids: Mapping[str, Ints]
    """Sensor -> the agent of each column, shape (G,)."""


@dataclass(frozen=True, slots=True)
class Frame:
    """Everything about one step, as views: valid until the next step or reset, and to be read only."""

    world: World
    """The state after the step."""
    env_mask: Bools
    """Simulations that were stepped or reset, shape (B,); those that failed are not among them."""
    actions: Actions | None
    """The actions given on the state before; None in the frame of a reset."""
    commands: Commands | None
    """What the vehicles carried out; None in the frame of a reset."""
    contacts: Contacts
    events: Events
    """Events of this step alone; a caller that steps several times per decision joins them."""
    observe_mask: Bools
    """Agents whose readings are of this step, shape (B, A)."""
    readings: Readings
    failures: Mapping[int, SmartsError] = field(default_factory=dict)
    """Simulations whose traffic or vehicles failed in this step: invalid episodes, whose next reset works."""
    starts: Mapping[int, EpisodeStart] = field(default_factory=dict)
    """Episodes that begin, by row, in the frame of a reset."""
    transfers: Sequence[CarriedOut] = ()
    """Transfers of vehicles at the beginning of this step."""
    bubbles: BubbleStates | None = None
    """States of the bubbles; None: not known."""
    social_failures: Mapping[tuple[int, int], str] = field(default_factory=dict)
    """Social agents that have failed before this step, by (row, number of the agent in its episode), and why:
    the fallback controller drives their vehicles."""
