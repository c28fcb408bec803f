"""Colours and texts of vehicles by their drivers."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.patches import Patch

from smarts.envision.bubble_shapes import BUBBLE
from smarts.envision.episode_owners import EpisodeOwners, Holder
from smarts.envision.scenario_picture import CAR, EGOS
from smarts.envision.vehicle_shapes import HATCH

SOCIAL = "#ff7f0e"
"""Colour of social agents' vehicles."""
LEGEND_ENTRY = 125
"""Width of an entry of the legend [pixels]."""


def holder_colour(holder: Holder) -> str:
    """Return the colour of an agent."""
    return EGOS[holder.agent_id % len(EGOS)] if holder.policy < 0 else SOCIAL


def vehicle_colour(holder: Holder | None) -> str:
    """Return the colour of a vehicle: that of the agent that drives, or of traffic."""
    return CAR if holder is None or holder.observes else holder_colour(holder)


def group_colour(policy: int) -> str:
    """Return the colour of the agents of a policy of `EpisodeOwners.groups`."""
    return EGOS[0] if policy < 0 else SOCIAL


def count_line(name: str, holders: Sequence[Holder]) -> str:
    """Return how many vehicles a group of agents drives, observes, and is to give back."""
    leaving, observed = sum(each.leaves for each in holders), sum(each.observes for each in holders)
    driven = len(holders) - leaving - observed
    return f"{name}: {driven} driven, {observed} in the air-lock, {leaving} leaving"


def legend(owners: EpisodeOwners, has_bubbles: bool) -> list[Patch]:
    """Return the entries of the legend, none for an episode of egos alone."""
    if not (owners.groups or has_bubbles):
        return []
    entries = [
        Patch(facecolor=EGOS[0], label="ego"),
        Patch(facecolor=SOCIAL, label="social agent"),
        Patch(facecolor=CAR, label="traffic"),
        Patch(facecolor=CAR, edgecolor=SOCIAL, hatch="|||", label="in the air-lock"),
        Patch(facecolor=SOCIAL, edgecolor=HATCH, hatch="////", label="leaving"),
    ]
    if has_bubbles:
        entries.append(Patch(facecolor=BUBBLE, edgecolor=BUBBLE, alpha=0.4, label="bubble"))
    return entries
