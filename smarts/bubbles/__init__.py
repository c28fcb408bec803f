"""Bubbles: areas in which agents drive vehicles of traffic. Outlines, phases and conditions on arrays."""
