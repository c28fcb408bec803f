"""Recorded traffic: vehicles that drive as in a recording, and give way to what is in their way."""
