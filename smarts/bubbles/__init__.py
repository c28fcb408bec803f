"""Bubbles: areas in which agents drive vehicles of traffic. Outlines, phases and conditions on arrays."""

from smarts.bubbles.placing import Driver, agent_actor, columns_needed, place_bubbles

__all__ = ["Driver", "agent_actor", "columns_needed", "place_bubbles"]
